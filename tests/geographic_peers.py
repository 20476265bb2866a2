"""Grid coordinates by PROJ: east and north for each code, latitude and longitude."""

import json
import sys

from pyproj import Transformer

cases = json.loads(sys.argv[1])
grids = {code: Transformer.from_crs("EPSG:4326", code, always_xy=True) for code in {case[0] for case in cases}}
print(json.dumps([grids[code].transform(longitude, latitude) for code, latitude, longitude in cases]))
