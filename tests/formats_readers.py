"""Reads exports with the libraries of their target programs, and prints the results as JSON.

    formats_readers.py FOLDER POINTS

FOLDER has a folder for every format; POINTS is a JSON list of world points. The binary COLMAP model is written
to the folder `binary`.
"""

import json
import pathlib
import sys

import pycolmap
import yaml

folder = pathlib.Path(sys.argv[1])
points = json.loads(sys.argv[2])
model = pycolmap.Reconstruction(str(folder / "colmap"))
(image,) = model.images.values()
(folder / "binary").mkdir()
model.write_binary(str(folder / "binary"))


def read(path):
    with open(folder / path) as text:
        return yaml.safe_load(text)


print(
    json.dumps(
        {
            "colmap": [list(map(float, image.project_point(point))) for point in points],
            "ros": read("ros/yard.yaml"),
            "nvidia": read("nvidia/camInfo/yard.yml"),
            "frigate": read("frigate/zones.yml"),
        }
    )
)
