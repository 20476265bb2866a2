"""Maps the same archive with `calib project` and with DuckDB and the SQL view, on one thread each.

    project_peer.py CALIB FOLDER ROWS

FOLDER contains site.json and floor.sql. Prints medians of the elapsed time and of the processor time, in seconds.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import time

import duckdb

calib, folder, rows = sys.argv[1], sys.argv[2], int(sys.argv[3])
RUNS = 5

base = duckdb.connect()
base.execute("SET threads = 1")
base.execute(
    f"""COPY (
      SELECT i AS id, 'camera ' || (i // 1000 % 3) AS camera_id,
        TIMESTAMP '2026-05-28 20:00:00' + to_milliseconds(i * 40) AS seen_at,
        CAST(round(1920 * random(), 1) AS FLOAT) AS u, CAST(round(1080 * random(), 1) AS FLOAT) AS v,
        CAST(random() AS FLOAT) AS score, ['person', 'cart', 'pallet'][1 + i % 3] AS kind
      FROM range({rows}) AS t(i)
    ) TO '{folder}/in.parquet' (FORMAT parquet, COMPRESSION zstd)"""
)
base.execute(f"CREATE VIEW detections AS FROM '{folder}/in.parquet'")
with open(os.path.join(folder, "floor.sql")) as text:
    base.execute(text.read())


def by_duckdb():
    base.execute(f"COPY (FROM calib_floor) TO '{folder}/duckdb.parquet' (FORMAT parquet, COMPRESSION zstd)")


def by_calib():
    command = [calib, "project", "site.json", "--to", "floor", "--camera-column", "camera_id"]
    subprocess.run([*command, "-i", "in.parquet", "-o", "calib.parquet", "--force"], cwd=folder, check=True)


def processor():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(work, clock):
    start = clock()
    work()
    return clock() - start


# The two alternate, so that other work on the machine slows both equally.
took = {"duckdb_s": [], "duckdb_cpu_s": [], "calib_s": [], "calib_cpu_s": []}
for run in range(RUNS + 1):
    own = time.process_time()
    duckdb_s = measure(by_duckdb, time.perf_counter)
    duckdb_cpu_s = time.process_time() - own
    before = processor()
    calib_s = measure(by_calib, time.perf_counter)
    calib_cpu_s = processor() - before
    if run > 0:
        for key, value in zip(took, [duckdb_s, duckdb_cpu_s, calib_s, calib_cpu_s]):
            took[key].append(value)
off = base.execute(
    f"""SELECT max(sqrt((a.x_m - b.x_m) ** 2 + (a.y_m - b.y_m) ** 2) / (1 + sqrt(a.x_m ** 2 + a.y_m ** 2))),
      count(*), count(a.x_m), count(b.x_m)
    FROM '{folder}/duckdb.parquet' AS a JOIN '{folder}/calib.parquet' AS b ON a.id = b.id"""
).fetchone()
if off[1] != rows or off[2] != off[3] or off[0] > 1e-9:
    sys.exit(f"calib and DuckDB disagree (largest error, rows, mapped rows of each): {off}")
print(json.dumps({key: statistics.median(values) for key, values in took.items()}))
