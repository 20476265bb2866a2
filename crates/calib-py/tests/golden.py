"""Golden points: results of the core that every language must reproduce bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

COLUMNS = 21
SIGMA_PX = 1.5


@dataclass(frozen=True)
class Golden:
    """Camera id, keywords of its stream, height of the plane, and the columns of points."""

    id: str
    stream: dict[str, Any]
    height: float
    columns: npt.NDArray[np.float64]


def golden(folder: Path) -> Iterator[Golden]:
    lines = (folder / "cameras.txt").read_text().splitlines()
    tables = np.fromfile(folder / "points.f64", dtype="<f8").reshape(len(lines), COLUMNS, -1)
    for line, columns in zip(lines, tables, strict=True):
        name, origin, fit, width, height, *crop, plane = line.split()
        stream: dict[str, Any] = {"origin": ["corner", "centre"][int(origin)]}
        if int(fit):
            stream["fit"] = ["stretch", "letterbox"][int(fit) - 1]
        if int(width):
            stream["stream_size"] = (int(width), int(height))
        if float(crop[2]):
            stream["crop"] = tuple(map(float, crop))
        yield Golden(name, stream, float(plane), columns)
