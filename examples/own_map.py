"""A floor plan of your own, drawn as in a paint program, and three policies that drive in it.

Dark pixels are walls. From the command line: `wheelchair compare --map plan.png --resolution 0.05
--start 1.5,1.5 --goal 10,6 --policies lattice+window,ppo_guided,straight`.
"""

import argparse
from pathlib import Path

from PIL import Image, ImageDraw

from agents.evaluation.evaluate import evaluate

SCALE = 0.05  # m: edge of a pixel

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="runs/own_map", help="folder of the results")
folder = Path(parser.parse_args().out)

image = Image.new("L", (240, 160), "white")  # 12 m x 8 m
draw = ImageDraw.Draw(image)
draw.rectangle((110, 0, 115, 60), fill="black")  # a wall with a gap of 1.9 m
draw.rectangle((110, 99, 115, 160), fill="black")
draw.ellipse((160, 60, 180, 80), fill="black")  # a round table
folder.mkdir(parents=True, exist_ok=True)
image.save(folder / "plan.png")

scene = {
    "name": "map_file",
    "path": str(folder / "plan.png"),
    "resolution": SCALE,
    "start": [1.5, 1.5, 0.0],
    "goal": [10.0, 6.0, 0.0],
    "label": "plan",
}
records = evaluate(
    ["lattice+window", "ppo_guided", "straight"], [scene], [0], folder=folder, env={"shield": True}
)
for record in records:
    print(f"{record['policy']:16} {record['outcome']} after {record['time']:.1f} s")
