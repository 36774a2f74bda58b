"""Wrong words to any command are one line that names what is wrong, and code 2."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tests.conftest import ROOT, refusal
from tests.hardware.realtime import EPISODE, X, Y
from wheelchair_gym.maps import write_map

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")

CONFIG = "--config configs/hardware.json"
DEPLOY = f"deploy {CONFIG} --map map.yaml --start {X},{Y},0 --goal {X},{Y}"
NOOK = "0.1,2"  # free, and nearer to a wall than any side of the chair
ROWS = yaml.safe_load(Path(__file__).with_name("wrong_words.yaml").read_text())["words"]
WORDS = [[text.format(CONFIG=CONFIG, DEPLOY=DEPLOY, NOOK=NOOK) for text in row] for row in ROWS]


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
