"""Compare the number of lines of each part of the project with `budget.toml`.

A part over its budget fails, and so does a budget above that of an earlier commit (`raised` apart).
"""

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUDGET = Path(".ci/budget.toml")


def git(*arguments: str) -> str:
    """Return the output of git; an empty string where it fails, as outside of a checkout."""
    ran = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    return ran.stdout if ran.returncode == 0 else ""


def count(patterns: list[str]) -> int:
    """Count the lines of the files that git tracks, or would track, under some patterns."""
    listed = git("ls-files", "--cached", "--others", "--exclude-standard", "--", *patterns)
    files = (ROOT / name for name in set(listed.splitlines()))
    return sum(len(file.read_bytes().splitlines()) for file in files if file.is_file())


def faults() -> list[str]:
    """Return one line for each part over its budget, and for each budget that was raised."""
    budget = tomllib.loads((ROOT / BUDGET).read_text())
    found = []
    for part, entry in budget.items():
        lines = count(entry["files"])
        print(f"{part:16} {lines:7,} of {entry['lines']:,} lines")
        if lines > entry["lines"]:
            found.append(f"{part}: {lines} lines of {entry['lines']}: remove as many as you add")
    for commit in git("log", "--format=%H", "--", str(BUDGET)).split():
        earlier = tomllib.loads(git("show", f"{commit}:{BUDGET}"))
        for part, entry in earlier.items():
            now = budget.get(part, {"lines": float("inf")})
            if now["lines"] - now.get("raised", 0) > entry["lines"] - entry.get("raised", 0):
                found.append(f"{part}: {now['lines']}; it was {entry['lines']} in {commit[:8]}")
    return found


if __name__ == "__main__":
    if not git("ls-files"):
        print("budget: not a git checkout; not checked")
    elif found := faults():
        sys.exit("\n".join(f"{BUDGET}: {line}" for line in found))
