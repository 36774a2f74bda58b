"""A learned policy as ONNX: exported, driven in simulation, and ready for a chair's computer.

On the chair, without torch: `wheelchair deploy --config my_chair.json --map home.yaml --start 0,0,0
--policy ppo_guided.onnx --goal 4,2`. `digest` in the policy's settings refuses another file.
"""

import argparse
from pathlib import Path

from agents.evaluation.evaluate import evaluate
from agents.learning.export import export_onnx
from agents.learning.weights import find_weights, load_weights
from wheelchair_gym.base.files import file_digest

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", default="runs/onnx", help="folder of the file and the results")
folder = Path(parser.parse_args().out)
folder.mkdir(parents=True, exist_ok=True)

file = folder / "ppo_guided.onnx"
export_onnx(load_weights(find_weights("ppo_guided")), file)
policy = {"name": str(file), "digest": file_digest(file), "label": "onnx"}
records = evaluate(
    [policy, "ppo_guided"], ["floor_plan"], [0, 1], folder=folder, env={"shield": True}
)
for record in records:
    print(f"{record['policy']:12} seed {record['seed']}: {record['outcome']}")
