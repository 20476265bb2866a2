"""Compares the SQL view in DuckDB with the rows mapped by calib. Prints the differences per camera.

    engines_duckdb.py FOLDER

FOLDER holds floor.sql, detections.parquet and single.parquet (by `calib project`).
"""

import json
import os
import sys

import duckdb

folder = sys.argv[1]
base = duckdb.connect()
base.execute(f"CREATE VIEW detections AS FROM '{folder}/detections.parquet'")
base.execute(f"CREATE VIEW single AS FROM '{folder}/single.parquet'")
with open(os.path.join(folder, "floor.sql")) as text:
    base.execute(text.read())
rows = base.execute(
    """
    SELECT s.camera_id, count(*), count(f.x_m),
      count(*) FILTER ((s.x_m IS NULL) <> (f.x_m IS NULL) AND s.status <> 'outside-image'),
      max(sqrt((s.x_m - f.x_m) ** 2 + (s.y_m - f.y_m) ** 2) / (1 + sqrt(s.x_m ** 2 + s.y_m ** 2))),
      max(sqrt((s.x_m - f.x_m) ** 2 + (s.y_m - f.y_m) ** 2)) FILTER (s.status = 'ok')
    FROM single AS s JOIN calib_floor AS f ON s.id = f.id GROUP BY s.camera_id ORDER BY s.camera_id
    """
).fetchall()
has_map = base.execute("SELECT count(*) FROM duckdb_views() WHERE view_name = 'calib_map'").fetchone()[0]
mapped = has_map and base.execute(
    """
    SELECT s.camera_id, max(111e3 * sqrt((s.lat_deg - f.lat_deg) ** 2 + (0.67 * (s.lon_deg - f.lon_deg)) ** 2))
    FROM single AS s JOIN calib_map AS f ON s.id = f.id WHERE sqrt(s.x_m ** 2 + s.y_m ** 2) < 3000 GROUP BY s.camera_id
    """
).fetchall()
names = ["camera", "rows", "mapped", "one_sided", "relative", "in_efov_m"]
found = {row[0]: dict(zip(names, row)) for row in rows}
for camera, metres in mapped or []:
    found[camera]["on_map_m"] = metres
print(json.dumps(found))
