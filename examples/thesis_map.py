"""A drawn map and a thesis's settings file become polygons, a plan, commands and a picture.

From the command line: `wheelchair plan --config settings.json --resolution 0.05 --start 1,1
--goal 11,7 --picture plan.png`.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from agents.studies.plan_pictures import PlanPictures
from agents.studies.thesis import controls_of, describe, problem_of
from planners import make_planner
from planners.rrt_star_woa.thesis import read_thesis
from wheelchair_gym.rendering import write_png

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="runs/thesis_map", help="folder of the results")
folder = Path(parser.parse_args().out)
folder.mkdir(parents=True, exist_ok=True)

image = Image.new("L", (240, 160), "white")  # 12 m x 8 m
pen = ImageDraw.Draw(image)
pen.rectangle((80, 60, 86, 160), fill="black")
pen.rectangle((150, 0, 156, 92), fill="black")
image.save(folder / "hall.png")
(folder / "settings.json").write_text(
    json.dumps(
        {
            "MapProcessor_Map_Name": "hall.png",
            "MapProcessor_Obstacles_Dilation": 9,  # pixels
            "MapProcessor_Epsilon": 0.5,
            "PathPlanner_Step_Size": 1.0,  # m
        }
    )
)

settings = read_thesis(folder / "settings.json")
drawn = problem_of(settings, resolution=0.05, start=[1.0, 1.0], goal=[11.0, 7.0])
planner = make_planner(settings.planner("rrt_star_woa_global"))
plan = planner.plan(drawn.problem, np.random.default_rng(0))
controls = controls_of(drawn, plan, seed=0)
text = f"{plan.length:.2f} m; {describe(controls)}"
write_png(folder / "plan.png", PlanPictures(drawn, planner, plan, 0, controls).draw(text))
print(text)
