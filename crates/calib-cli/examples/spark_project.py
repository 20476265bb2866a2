"""Maps an archive of detections to the floor with Spark, every task through a `calib project` of its own.

    spark-submit spark_project.py SITE DETECTIONS FLOOR

SITE is a calibrated site file that every worker can read, DETECTIONS a table (a Parquet folder) with the
columns camera_id, u and v (or boxes x, y, w, h), FLOOR the Parquet folder to write. `calib` must be on the
workers' path. A task that fails or whose worker dies is run again by Spark, and gives the same rows: the
program keeps nothing between runs.
"""

import subprocess
import sys
import threading

import pyarrow as pa
from pyspark.sql import SparkSession
from pyspark.sql.types import DoubleType, StringType, StructType


def floor_schema(schema):
    """The schema of a table of detections once it is mapped."""
    schema = StructType(schema.fields[:])
    return schema.add("x_m", DoubleType()).add("y_m", DoubleType()).add("status", StringType())


def project(site, calib="calib", arguments=("--camera-column", "camera_id")):
    """What DataFrame.mapInArrow wants: batches of detections to batches with x_m, y_m and status."""

    def feed(first, batches, process, failed):
        try:
            with process.stdin as pipe, pa.ipc.new_stream(pipe, first.schema) as stream:
                stream.write_batch(first)
                for batch in batches:
                    stream.write_batch(batch)
        except Exception as error:  # Raised again by the thread that reads.
            failed.append(error)
            process.kill()

    def mapped(batches):
        first = next(batches, None)
        if first is None:
            return
        command = [calib, "project", site, "--to", "floor", "--format", "arrow", *arguments]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        failed = []
        feeder = threading.Thread(target=feed, args=(first, batches, process, failed), daemon=True)
        feeder.start()
        try:
            with process.stdout as pipe, pa.ipc.open_stream(pipe) as stream:
                yield from stream
            feeder.join()
            if process.wait() != 0:
                raise RuntimeError(f"calib ended with code {process.returncode}; its message is in the log")
        except pa.ArrowInvalid as error:
            process.wait()
            raise (failed or [RuntimeError(f"calib ended with code {process.returncode}: {error}")])[0]
        finally:
            process.kill()
            process.wait()

    return mapped


def main(site, detections, floor):
    spark = SparkSession.builder.appName("calib project").getOrCreate()
    table = spark.read.parquet(detections)
    table.mapInArrow(project(site), floor_schema(table.schema)).write.parquet(floor)


if __name__ == "__main__":
    main(*sys.argv[1:])
