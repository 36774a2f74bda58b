"""`wheelchair studio`: a page in the browser on which people drive and plan in the simulator.

    page/ (JavaScript) <- WebSocket -> server.py -> session -> drive.py -> NavigationEnv

The page draws and reads keys; the chair, its sensors and its judge are those of the environment. It
drives the simulated chair only.
"""

from importlib.util import find_spec

from wheelchair_gym.base.settings import InputError


def check_extra() -> None:
    """Refuse to begin where a package is missing.

    Raises:
        InputError: the extra 'studio' is not installed.
    """
    for name in ("starlette", "uvicorn", "websockets"):
        if find_spec(name) is None:
            raise InputError(
                f"wheelchair studio needs {name}: pip install 'wheelchair_gym[studio]'"
            )
