"""Adapters from detectors and trackers to metres on the floor, each with at most five lines.

`camera` is the result of `site.camera(id)`. The tests run each adapter with its package.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import calib


def of_supervision(camera: calib.Camera, detections: Any) -> Any:
    """Adds `floor_m` to the data of detections, and returns those inside the camera's effective field of view."""
    x, y, status = camera.boxes_to_floor(detections.xyxy, form="xyxy")
    detections.data["floor_m"] = np.stack([x, y], axis=1)
    return detections[status == calib.Status.OK]


def of_ultralytics(camera: calib.Camera, result: Any) -> npt.NDArray[np.float64]:
    """Returns the floor points (n, 2) of the boxes of a result. Ultralytics scales boxes back to the frame."""
    height, width = result.orig_shape
    x, y, _ = camera.boxes_to_floor(result.boxes.xyxy.cpu(), form="xyxy", stream_size=(width, height))
    return np.stack([x, y], axis=1)


def of_norfair(camera: calib.Camera, boxes: npt.ArrayLike) -> list[Any]:
    """Returns detections for a tracker that works in metres, from boxes (n, 4) given by their corners."""
    import norfair  # type: ignore[import-untyped]
    x, y, _ = camera.boxes_to_floor(boxes, form="xyxy")
    return [norfair.Detection(points=np.array([point])) for point in zip(x, y)]


def of_frigate(camera: calib.Camera, payload: str | bytes, detect: tuple[int, int]) -> tuple[float, float]:
    """Returns the floor point of an event's object, from its MQTT message and the camera's `detect: width, height`."""
    box = json.loads(payload)["after"]["box"]
    x, y, _ = camera.boxes_to_floor(box, form="xyxy", stream_size=detect)
    return float(x), float(y)


def of_opencv(camera: calib.Camera, capture: Any, foot: Callable[[Any], tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Yields the floor point of the pixel that `foot` finds in each frame of a `cv2.VideoCapture`."""
    size = (capture.get(3), capture.get(4))
    view = camera.with_stream(stream_size=size, origin="centre")
    while (read := capture.read())[0]:
        yield view.to_floor(*foot(read[1]))[:2]
