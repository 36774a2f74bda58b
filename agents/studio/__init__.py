"""`wheelchair studio`: a page in the browser on which people drive and plan in the simulator.

    page/ (JavaScript) <- WebSocket -> server.py -> session -> drive.py -> NavigationEnv

The page draws and reads keys; the chair, its sensors and its judge are those of the environment. It
drives the simulated chair only.
"""

from pathlib import Path
from typing import Any

from wheelchair_gym.base.files import read_json
from wheelchair_gym.base.settings import InputError

PAGE = Path(__file__).with_name("page")
UPLOADS = "uploads"  # folder of maps that pages have sent


def page_texts() -> dict[str, Any]:
    """Return the texts of the page by language: each file of the page's folder `texts` is one."""
    return {file.stem: read_json(file) for file in sorted((PAGE / "texts").glob("*.json"))}


class PageError(InputError):
    """An error that the page tells in its language; as an exception, in English.

    Args:
        key: of a text of the page.
        values: in the text.
    """

    def __init__(self, key: str, **values: object) -> None:
        super().__init__(page_texts()["en"][key].format(**values))
        self.key, self.values = key, values
