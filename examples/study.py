"""Repeat an experiment of a publication: its figures beside the published ones, its claims tested.

`wheelchair study all` does it for all of them. With `quick` few runs are made, for a first look.
"""

import argparse

from agents.studies.runner import find_studies, run_studies

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("name", nargs="?", default="p1", help="a study of `wheelchair study --help`")
parser.add_argument("--out", default="runs/study", help="folder of the report")
given = parser.parse_args()

chapters = run_studies(find_studies(given.name), given.out, quick=True, progress=False)
for name, chapter in chapters.items():
    print(name, chapter["title"])
    for claim in chapter["claims"]:
        print(f"  {claim['verdict']:16} {claim['claim']}")
print(f"{given.out}/report.html")
