"""Spark: tables mapped with `mapInArrow`, and the SQL view, in a local session."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import calib

pa = pytest.importorskip("pyarrow")
pyspark = pytest.importorskip("pyspark")
if shutil.which("java") is None:
    pytest.skip("Spark needs Java", allow_module_level=True)

# Spark warns that it does not support pandas 3 completely. These tests use Arrow only.
pytestmark = pytest.mark.filterwarnings("ignore::FutureWarning")

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import spark_project  # noqa: E402

COLUMNS = ["time_s", "camera", "u", "v"]


@pytest.fixture(scope="module")
def spark(tmp_path_factory: pytest.TempPathFactory) -> Iterator[object]:
    os.environ["PYSPARK_PYTHON"] = sys.executable
    os.environ["SPARK_LOCAL_IP"] = "127.0.0.1"
    scratch = tmp_path_factory.mktemp("spark")
    session = (
        pyspark.sql.SparkSession.builder.master("local[2]")
        .config("spark.ui.enabled", "false")
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.local.dir", str(scratch / "local"))
        .config("spark.sql.warehouse.dir", str(scratch / "warehouse"))
        .config("spark.sql.execution.arrow.maxRecordsPerBatch", "500")
        .getOrCreate()
    )
    session.sparkContext.setLogLevel("ERROR")
    yield session
    session.stop()


@pytest.fixture(scope="module")
def detections(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    csv, parquet = pytest.importorskip("pyarrow.csv"), pytest.importorskip("pyarrow.parquet")
    table = csv.read_csv(folder / "demo/detections.csv")
    table = table.append_column("row", pa.array(range(table.num_rows), pa.int64()))
    path = tmp_path_factory.mktemp("detections") / "detections.parquet"
    parquet.write_table(table, path)
    return path


def test_map_in_arrow_equals_one_process(spark: object, detections: Path, folder: Path) -> None:
    text = (folder / "demo/solved.json").read_text()
    table = spark.read.parquet(str(detections)).repartition(4)
    mapped = table.mapInArrow(
        spark_project.project(text, camera_column="camera"), spark_project.floor_schema(table.schema)
    ).toArrow().sort_by("row")
    parquet = pytest.importorskip("pyarrow.parquet")
    expected = pa.table(calib.Site(text).project(parquet.read_table(detections), camera_column="camera"))
    assert mapped.num_rows == expected.num_rows > 1000
    for column in ["x_m", "y_m", "status"]:
        assert mapped[column].to_pylist() == expected[column].to_pylist(), column


def test_the_sql_view_equals_the_projection(spark: object, detections: Path, folder: Path, tmp_path: Path) -> None:
    program = os.environ.get("CALIB")
    if program is None:
        pytest.skip("CALIB names no program: `cargo xtask py --test` does")
    site = folder / "demo/solved.json"
    view = tmp_path / "floor.sql"
    subprocess.run([program, "export", "sql", site, "-o", view, "--allow-lossy"], check=True, capture_output=True)
    spark.read.parquet(str(detections)).withColumnRenamed("camera", "camera_id").createOrReplaceTempView("detections")
    statements = "\n".join(line for line in view.read_text().splitlines() if not line.startswith("--"))
    for statement in filter(str.strip, statements.split(";")):
        spark.sql(statement)
    rows = {row["row"]: row for row in spark.table("calib_floor").toArrow().to_pylist()}
    parquet = pytest.importorskip("pyarrow.parquet")
    expected = pa.table(calib.Site(site.read_text()).project(parquet.read_table(detections), camera_column="camera"))
    both = [
        (rows[row["row"]], row)
        for row in expected.to_pylist()
        if row["status"] == "ok" and rows[row["row"]]["x_m"] is not None
    ]
    assert len(both) > 1000
    # The view fits lenses that SQL cannot express, and states the error within the field of view. Between the sample
    # points of the export, the error may be slightly larger.
    stated = [float(metres) for metres in re.findall(r"and ([\d.]+) m in the EFOV", view.read_text())]
    worst = max(max(abs(found["x_m"] - row["x_m"]), abs(found["y_m"] - row["y_m"])) for found, row in both)
    assert worst < 1.2 * max(stated, default=1e-9), (worst, stated)
