"""Whole tables of Polars, pandas and PyArrow, mapped as `calib project` maps files."""

import importlib
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import calib

pa = pytest.importorskip("pyarrow")
ROWS = {"camera": ["camera-0", "camera-1", "roof", "camera-0"], "u": [900.0, 800.0, 1.0, None], "v": [700, 600, 2, 3]}


def test_a_table_is_mapped_row_by_row(site: calib.Site) -> None:
    with pytest.warns(UserWarning, match="roof"):
        table = pa.table(site.project(pa.table({**ROWS, "note": list("abcd")}), camera_column="camera", sigma_px=2.0))
    assert table["status"].to_pylist()[2:] == ["no-calibration", "missing"]
    assert table["note"].to_pylist() == list("abcd") and table["x_m"].null_count == 2
    for row, name in enumerate(ROWS["camera"][:2]):
        camera = site.camera(name)
        u, v = ROWS["u"][row], float(ROWS["v"][row])
        assert (table["x_m"][row].as_py(), table["y_m"][row].as_py()) == camera.to_floor(u, v)[:2]
        pixel, calibration = camera.floor_covariance(u, v, 2.0)
        assert table["sigma_x_m"][row].as_py() == pytest.approx(np.sqrt(pixel[0, 0]))
        assert table["calibration_sigma_y_m"][row].as_py() == pytest.approx(np.sqrt(calibration[1, 1]))
    assert b"calib.site_sha256" in table.schema.metadata


def test_a_table_equals_the_output_of_the_command_line(folder: Path, tmp_path: Path) -> None:
    program = os.environ.get("CALIB")
    if program is None:
        pytest.skip("CALIB names no program: `cargo xtask py --test` does")
    csv = importlib.import_module("pyarrow.csv")
    parquet = importlib.import_module("pyarrow.parquet")
    demo = folder / "demo"
    table = csv.read_csv(demo / "detections.csv")
    parquet.write_table(table, tmp_path / "in.parquet")
    files = ["-i", tmp_path / "in.parquet", "-o", tmp_path / "out.parquet"]
    columns = ["--camera-column", "camera", "--sigma-px", "2", "--to", "floor"]
    subprocess.run([program, "project", demo / "solved.json", *files, *columns], check=True, capture_output=True)
    written = parquet.read_table(tmp_path / "out.parquet")
    found = pa.table(calib.Site.open(demo / "solved.json").project(table, camera_column="camera", sigma_px=2.0))
    assert found.column_names == written.column_names and found.num_rows == table.num_rows > 1000
    assert [str(kind) for kind in found.schema.types] == [str(kind) for kind in written.schema.types]
    assert found.equals(written)
    assert found.schema.metadata[b"calib.site_sha256"] == written.schema.metadata[b"calib.site_sha256"]


def test_polars_and_pandas_frames(site: calib.Site) -> None:
    columns = {"x": [100.0, 300.0], "y": [200, 300], "w": [40, 50], "h": [300, 400]}
    options = {"camera": "camera-0", "stream_size": (960, 540), "origin": "centre"}
    boxes = np.array(list(columns.values()), dtype=float).T
    expected = site.camera("camera-0", stream_size=(960, 540), origin="centre").boxes_to_floor(boxes, form="xywh")[0]
    expected = np.where(np.isnan(expected), None, expected).tolist()
    pl = pytest.importorskip("polars")
    found = pl.DataFrame(site.project(pl.DataFrame(columns), **options))
    assert found["x_m"].to_list() == expected and found.columns[:4] == list("xywh")
    pd = pytest.importorskip("pandas")
    frame = pa.table(site.project(pd.DataFrame(columns), **options)).to_pandas()
    assert [None if np.isnan(x) else x for x in frame["x_m"]] == expected
    assert pl.DataFrame(site.project(pl.DataFrame(columns).head(0), **options)).height == 0


def test_an_invalid_table_is_reported_with_python_keywords(site: calib.Site) -> None:
    table = pa.table({"u": ["a"], "v": ["1"], "t": [1]})
    with pytest.raises(calib.CalibError, match='bad_rows="status"'):
        site.project(table, camera="camera-0")
    with pytest.warns(UserWarning, match="1 cell is"):
        assert pa.table(site.project(table, camera="camera-0", bad_rows="status"))["status"].to_pylist() == ["missing"]
    with pytest.raises(calib.CalibError, match="at_unit"):
        site.project(pa.table({"u": [1.0], "v": [1.0], "t": [1]}), camera="camera-0", at_column="t")
    with pytest.raises(calib.CalibError, match="640 x 360"):
        site.project(table, camera="camera-0", stream_size=(640, 640))
    with pytest.raises(calib.CalibError, match="camera_column"):
        site.project(table)
    with pytest.raises(calib.CalibError, match="roof"):
        site.project(table, camera="roof")
    with pytest.raises(calib.CalibError, match="__arrow_c_stream__"):
        site.project({"u": [1.0]}, camera="camera-0")  # type: ignore[arg-type]
    with pytest.raises(calib.CalibError, match="u,v"):
        site.project(pa.table({"a": [1]}), camera="camera-0")
    with pytest.raises(calib.CalibError, match="to"):
        site.project(table, camera="camera-0", to="sky")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="cameras"):
        site.project(table, cameras="camera-0")  # type: ignore[call-arg]
