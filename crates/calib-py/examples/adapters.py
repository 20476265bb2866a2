"""From what detectors and trackers hand over to metres on the floor: five lines each at most.

`camera` is what `site.camera(id)` gives. The tests run every one with what its own package makes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import calib


def of_supervision(camera: calib.Camera, detections: Any) -> Any:
    """Detections with `floor_m` in their data: those that stand in the camera's effective field of view."""
    x, y, status = camera.boxes_to_floor(detections.xyxy, form="xyxy")
    detections.data["floor_m"] = np.stack([x, y], axis=1)
    return detections[status == calib.Status.OK]


def of_ultralytics(camera: calib.Camera, result: Any) -> npt.NDArray[np.float64]:
    """Floor points (n, 2) of the boxes of a result, which are of the frame again, whatever the network saw."""
    height, width = result.orig_shape
    x, y, _ = camera.boxes_to_floor(result.boxes.xyxy.cpu(), form="xyxy", stream_size=(width, height))
    return np.stack([x, y], axis=1)


def of_norfair(camera: calib.Camera, boxes: npt.ArrayLike) -> list[Any]:
    """Detections for a tracker whose distances are metres, of boxes (n, 4) by their corners."""
    import norfair  # type: ignore[import-untyped]
    x, y, _ = camera.boxes_to_floor(boxes, form="xyxy")
    return [norfair.Detection(points=np.array([point])) for point in zip(x, y)]


def of_frigate(camera: calib.Camera, payload: str | bytes, detect: tuple[int, int]) -> tuple[float, float]:
    """Where the object of an event stands, by its MQTT message and the camera's `detect: width, height`."""
    box = json.loads(payload)["after"]["box"]
    x, y, _ = camera.boxes_to_floor(box, form="xyxy", stream_size=detect)
    return float(x), float(y)


def of_opencv(camera: calib.Camera, capture: Any, foot: Callable[[Any], tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Where what `foot` finds in every frame of a `cv2.VideoCapture` stands; OpenCV's pixels count from a centre."""
    size = (capture.get(3), capture.get(4))
    here = camera.with_stream(stream_size=size, origin="centre")
    while (read := capture.read())[0]:
        yield here.to_floor(*foot(read[1]))[:2]
