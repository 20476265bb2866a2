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

from pyspark.sql import SparkSession  # noqa: E402
from pyspark.sql import functions as f  # noqa: E402

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

single = spark.read.parquet(os.path.join(folder, "single.parquet"))
found = spark.read.parquet(out)
different = single.exceptAll(found).count() + found.exceptAll(single).count()

table.createOrReplaceTempView("detections")
with open(os.path.join(folder, "floor.sql")) as text:
    statements = "\n".join(line for line in text if not line.startswith("--"))
for statement in statements.split(";"):
    if statement.strip():
        spark.sql(statement)
view = spark.table("calib_floor").select("id", f.col("x_m").alias("vx"), f.col("y_m").alias("vy"))
off = f.hypot(f.col("x_m") - f.col("vx"), f.col("y_m") - f.col("vy"))
# The other camera's lens is fitted in SQL.
compared = single.where("camera_id <> 'a' and x_m is not null").join(view, "id")
rows = compared.select(f.count("vx"), f.count(f.lit(1)), f.max(off / (1 + f.hypot("x_m", "y_m")))).first()

print(
    json.dumps(
        {
            "rows": found.count(),
            "seconds": seconds,
            "killed": os.path.exists(marker),
            "different": different,
            "view_rows": rows[0],
            "view_expected": rows[1],
            "view_off": rows[2],
        }
    )
)
spark.stop()
