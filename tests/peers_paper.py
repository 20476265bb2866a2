"""Minimises the paper's criterion in SciPy for scenes on stdin (JSON). Prints the focal lengths as JSON."""
import json
import sys

import numpy as np

sys.path.insert(0, sys.argv[1])
import paper  # noqa: E402
from core import Ann  # noqa: E402

focals = []
for scene in json.load(sys.stdin):
    centre = np.array([960, 540] * 2)
    segments = lambda groups: [np.asarray(g, float).reshape(-1, 4) - centre for g in groups]
    annotation = Ann(np.concatenate(segments(scene["vertical"])), segments(scene["parallel"]),
                     segments(scene["perpendicular"]), segments(scene["equal_length"]), 1920, 1080)
    focals.append(paper.solve(annotation)["focal"])
json.dump(focals, sys.stdout)
