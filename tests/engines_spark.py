"""Runs calib beside Spark on a local cluster of two workers: the SQL view, and mapInArrow through the
program, one worker of which is killed once. Prints what it found as JSON.

    engines_spark.py CALIB EXAMPLES FOLDER

FOLDER holds site.json, floor.sql, detections.parquet and single.parquet (by `calib project`).
"""

import json
import os
import signal
import sys
import time

calib, examples, folder = sys.argv[1:]
sys.path.insert(0, examples)
os.environ["PYSPARK_PYTHON"] = sys.executable
os.environ["SPARK_LOCAL_IP"] = "127.0.0.1"

import duckdb  # noqa: E402
from pyspark.sql import SparkSession  # noqa: E402

import spark_project  # noqa: E402

spark = (
    SparkSession.builder.master("local-cluster[2,1,1024]")
    .config("spark.ui.enabled", "false")
    .config("spark.driver.host", "127.0.0.1")
    .config("spark.driver.memory", "2g")
    .config("spark.executor.memory", "1g")
    .config("spark.sql.shuffle.partitions", "4")
    .config("spark.sql.files.maxPartitionBytes", "8m")
    .config("spark.local.dir", folder)
    .config("spark.sql.warehouse.dir", os.path.join(folder, "warehouse"))
    .getOrCreate()
)
spark.sparkContext.setLogLevel("ERROR")
spark.sparkContext.addPyFile(os.path.join(examples, "spark_project.py"))


def executor():
    """The process of the executor: the worker's parent's parent."""
    with open(f"/proc/{os.getppid()}/stat") as stat:
        return int(stat.read().rsplit(")", 1)[1].split()[1])


def killed_once(mapped, marker):
    """As `mapped`; the first task to hand out a batch takes its executor with it."""

    def run(batches):
        for batch in mapped(batches):
            try:
                os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
                os.kill(executor(), signal.SIGKILL)
            except FileExistsError:
                pass
            yield batch

    return run


start = time.monotonic()
table = spark.read.parquet(os.path.join(folder, "detections.parquet"))
marker = os.path.join(folder, "killed")
mapped = killed_once(spark_project.project(os.path.join(folder, "site.json"), calib), marker)
out = os.path.join(folder, "spark.parquet")
table.mapInArrow(mapped, spark_project.floor_schema(table.schema)).write.parquet(out)
seconds = time.monotonic() - start

table.createOrReplaceTempView("detections")
with open(os.path.join(folder, "floor.sql")) as text:
    statements = "\n".join(line for line in text if not line.startswith("--"))
for statement in statements.split(";"):
    if statement.strip():
        spark.sql(statement)
spark.table("calib_floor").select("id", "x_m", "y_m").write.parquet(os.path.join(folder, "view.parquet"))
spark.stop()

base = duckdb.connect()
for name, files in {"single": "single.parquet", "found": "spark.parquet/*.parquet", "view": "view.parquet/*.parquet"}.items():
    base.execute(f"CREATE VIEW {name} AS FROM read_parquet('{folder}/{files}')")
different = """SELECT (SELECT count(*) FROM (FROM single EXCEPT ALL FROM found))
  + (SELECT count(*) FROM (FROM found EXCEPT ALL FROM single)), (SELECT count(*) FROM found)"""
different, rows = base.execute(different).fetchone()
# The other camera's lens is fitted in SQL.
view = """SELECT count(v.x_m), count(s.x_m),
    max(sqrt((s.x_m - v.x_m) ** 2 + (s.y_m - v.y_m) ** 2) / (1 + sqrt(s.x_m ** 2 + s.y_m ** 2)))
  FROM single AS s JOIN view AS v ON s.id = v.id WHERE s.camera_id <> 'a'"""
view_rows, view_expected, view_off = base.execute(view).fetchone()
print(
    json.dumps(
        {
            "rows": rows,
            "seconds": seconds,
            "killed": os.path.exists(marker),
            "different": different,
            "view_rows": view_rows,
            "view_expected": view_expected,
            "view_off": view_off,
        }
    )
)
