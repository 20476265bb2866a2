"""Maps a table of detections to the floor with Spark, inside the Python process of each task.

    spark-submit spark_project.py SITE DETECTIONS FLOOR

SITE is a calibrated site file, DETECTIONS a Parquet folder with the columns camera, u and v (or boxes x, y, w, h), and
FLOOR the Parquet folder to write. The wheel `calib` must be installed on every worker.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
from pyspark.sql import SparkSession
from pyspark.sql.types import DoubleType, StringType, StructType

import calib


def floor_schema(schema: StructType) -> StructType:
    """Returns the schema of a mapped table."""
    mapped = StructType(schema.fields[:])
    return mapped.add("x_m", DoubleType()).add("y_m", DoubleType()).add("status", StringType())


def project(site_json: str, **options: Any) -> Callable[[Iterator[pa.RecordBatch]], Iterator[pa.RecordBatch]]:
    """Returns the function for `DataFrame.mapInArrow`; `options` are those of `calib.Site.project`."""

    def map_batches(batches: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        site = calib.Site(site_json)
        for batch in batches:
            mapped = site.project(pa.Table.from_batches([batch]), **options)
            yield from pa.table(mapped).replace_schema_metadata(None).to_batches()

    return map_batches


def main(site: str, detections: str, floor: str) -> None:
    spark = SparkSession.builder.appName("calib").getOrCreate()
    table = spark.read.parquet(detections)
    mapped = table.mapInArrow(project(Path(site).read_text(), camera_column="camera"), floor_schema(table.schema))
    mapped.write.parquet(floor)


if __name__ == "__main__":
    main(*sys.argv[1:])
