"""Wrong words to any command are one line that names what is wrong, and code 2."""

from __future__ import annotations

import pytest

from tests.conftest import ROOT, refusal
from tests.hardware.realtime import EPISODE, X, Y
from wheelchair_gym.maps import write_map

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")

CONFIG = "--config configs/hardware.json"
DEPLOY = f"deploy {CONFIG} --map map.yaml --start {X},{Y},0 --goal {X},{Y}"
NOOK = "0.1,2"  # free, and nearer to a wall than any side of the chair
WORDS = [
    ("twin --port 99999", "expected at most 65535"),
    ("twin --scene nowhere", "nowhere"),
    ("twin --config nothing.json", "nothing.json"),
    (f"drive {CONFIG} --assist magic", "magic"),
    (f"drive {CONFIG} --chair ros2://somewhere:9090", "expected hardware"),
    (f"drive {CONFIG} --map map.yaml", "--start"),
    ("hardware check --config nothing.json", "nothing.json"),
    (f"hardware tune {CONFIG} --set kq=1", "expected one of kp"),
    (f"hardware tune {CONFIG} --set kp", "expected KEY=VALUE"),
    (f"hardware tune {CONFIG} --set kp=-1", "kp"),
    (f"hardware setup {CONFIG}", "drive"),
    (f"{DEPLOY} --goal 99,99", "--goal 99,99: outside the map"),
    (f"{DEPLOY} --goal {NOOK}", f"--goal {NOOK}: no heading is free"),
    (f"{DEPLOY} --start 0,0", "expected X,Y,YAW"),
    (f"{DEPLOY} --map nothing.yaml", "nothing.yaml"),
    (f"{DEPLOY} --initial-speed 0.5 --max-speed 0.3", "cannot rise"),
    (f"{DEPLOY} --chair ros://nobody:1 --dry-run", "expected hardware"),
    (f"{DEPLOY} --policy nobody", "nobody"),
    ("robot --pose slam", "ROS draws the map"),
    ("robot --map x.yaml --scene empty", "expected one of them"),
    ("robot --tls missing.pem --scene empty", "missing.pem: expected a PEM file"),
    ("robot --token-file missing --scene empty", "missing: cannot be read"),
    ("robot --host 300.1.1.1 --scene empty", "300.1.1.1:9090: cannot be served"),
    ("robot --rosbridge ros://127.0.0.1:1 --scene empty", "no rosbridge answers"),
    ("robot --rosbridge hardware --scene empty", "expected ros://HOST:PORT"),
    ("robot --rate 0", "expected 1 to 200"),
    ("robot --dds --scene empty --host 192.0.2.77", "192.0.2.77: expected an IPv4 address"),
    ("robot --dds --scene empty --host ::1", "::1: expected an IPv4 address"),
    ("robot --dds --scene empty --tls file", "--dds and --tls: expected one of them"),
    (
        "robot --dds --scene empty --rosbridge ros://127.0.0.1:1",
        "--dds and --rosbridge: expected one of them",
    ),
    ("export straight --onnx x.onnx", "a policy without a network; expected weights (.npz)"),
    ("export model.zip --onnx x.onnx", "a model of stable-baselines3; expected weights (.npz)"),
    ("export residual --onnx x.onnx", "assistant"),
    ("simulate --live -1", "--live"),
    ("simulate --live x", "--live"),
    ("tune a_star+window --vary follower.holdd=1:2", "holdd is not a setting"),
    ("tune a_star+window --vary seed=1:2 --vary seed=2:3", "given twice"),
    ("tune rrt_star --vary step=1:2", "expected a policy, such as rrt_star+window"),
    ("tune a_star+window --vary seed=1:2 --metric speed", "--metric speed is unknown"),
    ("tune nobody --vary seed=1:2", "'nobody' is unknown"),
    ("compare --assist slide", "--assist needs --driver"),
    ("compare --driver exprt", "did you mean expert?"),
    ("compare --driver expert --assist slid", "did you mean slide?"),
    ("compare --driver expert --policies straight", "expected one of them"),
    ("bench env --envs 0", "0: expected at least 1"),
    ("bench env --seconds 0", "--seconds is 0; expected more than 0"),
    ("bench env --assist slide", "--assist: expected --driver, too"),
    ("bench env --driver expert --assist slid", "did you mean slide?"),
    ("bench doors", "invalid choice: 'doors'"),
    ("simulate --policy none.npz", "none.npz: cannot be read"),
    ("simulate --images -1", "expected at least 0"),
    ("compare --images -1", "expected at least 0"),
    ("replay x.mcap --images -1", "expected at least 0"),
    ("map --log x --images -1", "expected at least 0"),
    ("study t1-9.9", "t1-3.1, "),
    ("study t2 --runs 1", "at least 2"),
    ("study t2 --out file/x", "cannot be written"),
    ("study t2 --runs many", "is not an integer"),
    ("study t2 --runs 5 --quick", "not allowed"),
    ("simulat", "did you mean simulate?"),
    ("plan --planer rrt", "did you mean --planner?"),
    ("simulate --pose mlc", "did you mean mcl?"),
    ("settings limitz", "did you mean limits?"),
    ("settings Limits", "did you mean limits?"),
    ("bench plannrs", "did you mean planners?"),
    ("bench planners --no-peers --only cluter", "did you mean clutter?"),
    ("compare --suite hom", "did you mean homes?"),
    ("compare --policies latice+window", "did you mean lattice+window?"),
    ("simulate --assist teleop", "--assist needs --driver"),
    ("simulate --policy mine/hugger.py:Gap", "write hugger:Gap, in the folder of hugger.py"),
    ("settings ppo", "'ppo'; training has those of `train ppo`"),
    ("settings bc", "'bc'; imitation has those of `train bc`"),
    ("simulate --config configs/ppo_goal.json", "a training run; expected"),
    ("map --scene floor_plan --out o --time 0", "--time"),
    ("map --scene floor_plan --out o --odometry-only", "--odometry-only"),
    ("map --scene nowhere --out o", "nowhere"),
    ("map --recording none.mcap --out o", "none.mcap"),
    ("map --scene floor_plan --policy manual --out o", "manual"),
]


@pytest.mark.parametrize(("words", "says"), WORDS)
def test_wrong_words_are_one_line_and_code_2(words, says, tmp_path, monkeypatch, capsys):
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (tmp_path / "file").touch()
    write_map(EPISODE.map, tmp_path / "map.yaml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    monkeypatch.setattr("wheelchair_gym.hardware.boards.parameters.PATIENCE", 0.05)
    line = refusal(words.split(), capsys)
    assert says in line
    assert len(line) < 500 or "did you mean" not in line
