"""The tracker in Python assigns the same identities as the tracker in Rust."""

import csv
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as table:
        return list(csv.DictReader(table))


def test_identities_equal_those_of_the_rust_tracker(folder: Path, tmp_path: Path) -> None:
    demo = folder / "demo"
    main = runpy.run_path(str(EXAMPLES / "fuse_tracks.py"))["main"]
    main(str(demo / "solved.json"), str(demo / "detections.csv"), str(tmp_path / "tracks.csv"))
    found, expected = rows(tmp_path / "tracks.csv"), rows(demo / "tracks.csv")
    assert len(found) == len(expected) > 500
    for a, b in zip(found, expected, strict=True):
        assert (float(a["at_s"]), a["track"], a["seen_by"]) == (float(b["at_s"]), b["track"], b["seen_by"])
        for column in ["x_m", "y_m", "sigma_x_m", "sigma_y_m"]:
            assert float(a[column]) == pytest.approx(float(b[column]), abs=2e-4)


def test_the_tracker_is_short() -> None:
    code = (EXAMPLES / "fuse_tracks.py").read_text().split('"""', 2)[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= 80
