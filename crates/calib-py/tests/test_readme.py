"""The examples of the README run unchanged."""

import re
import shutil
import textwrap
from pathlib import Path

import numpy as np
import pytest

import calib

README = (Path(__file__).parents[1] / "README.md").read_text()


def blocks() -> list[str]:
    return [textwrap.dedent(text) for text in re.findall(r"```python\n(.*?)```", README, re.DOTALL)]


def test_every_block_runs(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    polars = pytest.importorskip("polars")
    shutil.copy(folder / "demo/solved.json", tmp_path)
    monkeypatch.chdir(tmp_path)
    boxes = np.array([[600.0, 300, 660, 480], [100, 350, 180, 600]])
    frame = polars.DataFrame({"camera": ["shop-1"], "seen_at": ["2026-05-01T08:00:00Z"], "u": [900.0], "v": [800.0]})
    names = {"Path": Path, "boxes": boxes, "u": boxes[:, 2], "v": boxes[:, 3], "frame": frame, "polars": polars}
    for block in blocks():
        names["frame"] = np.zeros((720, 1280, 3), dtype="u1") if "straighten" in block else frame
        exec(block.replace('"door", stream_size', '"shop-1", stream_size'), names)
    assert names["mapped"].height == 1 and names["pixel"].shape == (2, 2, 2)
    assert names["straight"].shape == (720, 1280, 3)
    assert {finding.severity for finding in names["solved"].findings} <= {"note"}
    assert calib.Site.open("solved.json") == names["solved"] and "Traceback" not in capsys.readouterr().out


def test_every_adapter_calls_an_existing_method() -> None:
    calls = re.findall(r"camera\.(\w+)\(", README)
    assert len(calls) >= 7 and all(hasattr(calib.Camera, call) for call in calls)
