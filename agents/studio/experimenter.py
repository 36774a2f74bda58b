"""The experimenter's page: progress of all participants, remarks about them, and abort of a drive.

It has a token of its own, which opens nothing else; the participants' token does not open it.
"""

import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs

from starlette.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from agents.evaluation.tables import templates
from agents.people.folder import claim
from agents.people.protocol import Protocol
from agents.people.session import Session, progress_of, read_people
from agents.studio import PAGE
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.rendering.palette import style_sheet

HOME: Final = "/experimenter"
REMARKS: Final = ("note", "adverse_event")
_LONGEST = 20_000  # bytes of a remark


class Desk:
    """The sessions of an experiment that pages have open, and its folder.

    Args:
        folder: of the data.
        protocol: the experiment.

    Attributes:
        open: the page session of each participant with an open page, by number.
        lock: held while a session opens or closes, so that a remark finds it open or closed.
    """

    def __init__(self, folder: Path, protocol: Protocol) -> None:
        claim(folder, protocol)
        self.folder, self.protocol = folder, protocol
        self.open: dict[int, Any] = {}
        self.lock = threading.Lock()

    def act(self, number: int, action: str, text: str) -> None:
        """Record a remark about a participant, or abort the drive of one whose page is open.

        Raises:
            InputError: the number has no records, the text is empty, or it cannot be written.
        """
        if action != "abort" and (action not in REMARKS or not text.strip()):
            raise InputError("expected a text, and note or adverse_event")
        with self.lock:
            page = self.open.get(number)
            if page is not None and action == "abort":
                page.receive({"type": "abort"})
            elif page is not None:
                page.remark(action, text)
            elif action == "abort":
                raise InputError(f"participant {number} has no page open")
            elif progress_of(self.folder, self.protocol, number).last:
                with closing(Session(self.folder, self.protocol, number)) as session:
                    session.mark(action, text=text)
            else:
                raise InputError(f"participant {number} has not begun")

    def page(self, error: str = "") -> str:
        """Return the page as HTML."""
        people, faults = read_people(self.folder)
        error = "; ".join(filter(None, [error, *map(str, faults)]))
        rows = [one.row() | {"open": one.participant in self.open} for one in people]
        said = [
            remark | {"participant": one.participant} for one in people for remark in one.remarks
        ]
        return templates().get_template("experimenter.html").render(
            title=self.protocol.title, rows=rows, error=error, home=HOME,
            remarks=sorted(said, key=lambda remark: str(remark["at"]), reverse=True),
        )  # fmt: skip

    def routes(self, body: Callable[[Any, int], Any]) -> list[Any]:
        """Return the routes of the page; `body` reads a request of limited length."""

        async def act(request: Any) -> Any:
            form = parse_qs((await body(request, _LONGEST)).decode("utf-8", "replace"))
            number, action, text = (form.get(key, [""])[0] for key in ("number", "action", "text"))
            try:
                # Python reads no numbers of thousands of digits; five are too many already.
                self.act(int(number[:5]) if number.isdecimal() else 0, action, text)
            except InputError as error:
                return HTMLResponse(self.page(str(error)), 400)
            return RedirectResponse(HOME, 303)

        return [
            Route(HOME, lambda request: HTMLResponse(self.page())),
            Route(HOME, act, methods=["POST"]),
            Route(f"{HOME}/theme.css", lambda _: Response(style_sheet(), media_type="text/css")),
            Route(f"{HOME}/style.css", lambda request: FileResponse(PAGE / "style.css")),
        ]
