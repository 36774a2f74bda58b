"""The program `wheelchair`, also as `python -m wheelchair_gym`.

The commands lie in the package `agents`, whose name other distributions may use, too: where another
`agents` or `planners` is found first, this says so in one line.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path


def hidden() -> str:
    """The first of our packages that another one of the same name hides, and where that lies."""
    here = Path(__file__).resolve().parents[1]
    for name in ("planners", "agents"):
        found = find_spec(name)
        places = (
            [] if found is None else list(found.submodule_search_locations or [str(found.origin)])
        )
        if not places or Path(str(places[0])).resolve().parent != here:
            return f"{name} ({places[0] if places else 'nowhere'})"
    return ""


def main() -> int:
    """Run the command line; the exit code."""
    if other := hidden():
        text = f"another package hides ours: {other}; install wheelchair_gym in its own environment"
        print(f"wheelchair: {text}", file=sys.stderr)
        return 2
    code: int = import_module("agents.cli").main()
    return code


if __name__ == "__main__":
    sys.exit(main())
