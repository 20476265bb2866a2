"""Benchmark of OpenCV for the tasks of `floor_mapping` and `undistortion`, on one thread. Prints a JSON object.

The keys are those of the two benchmarks: processor time in nanoseconds per point, or in milliseconds per image of
1920 x 1080 pixels.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable

import cv2
import numpy as np

COUNT = 1_000_000
LENS = np.array([-0.2, 0.05, 0.001, -0.001, 0.01])


def median(work: Callable[[], object], runs: int = 9) -> float:
    """Return the median processor time in seconds, after one run to warm up."""
    work()
    took = []
    for _ in range(runs):
        start = time.process_time()
        work()
        took.append(time.process_time() - start)
    return float(np.median(took))


def points() -> dict[str, float]:
    random = np.random.default_rng(0)
    matrix = np.array([[1200, 0, 960], [0, 1200, 540], [0, 0, 1.0]])
    pixels = np.stack([random.uniform(0, 1920, COUNT), random.uniform(0, 1080, COUNT)], axis=1)[:, None, :]
    space = np.stack([random.uniform(-3, 3, COUNT), random.uniform(-2, 2, COUNT), random.uniform(4, 12, COUNT)], axis=1)
    homography = np.array([[0.8, 0.1, -300], [0.05, -0.6, 500], [0.0002, 0.002, 0.1]])
    turn, shift, none = np.array([0.1, 0.2, 0.0]), np.array([0.0, 0.0, 0.5]), np.zeros(5)

    def of(work: Callable[[], object]) -> float:
        return 1e9 / COUNT * median(work)

    return {
        "pixel_to_floor_ns": of(lambda: cv2.perspectiveTransform(pixels, homography)),
        "distorted_pixel_to_floor_ns": of(lambda: cv2.undistortPoints(pixels, matrix, LENS)),
        "world_to_pixel_ns": of(lambda: cv2.projectPoints(space, turn, shift, matrix, none)),
        "distorted_world_to_pixel_ns": of(lambda: cv2.projectPoints(space, turn, shift, matrix, LENS)),
    }


def images() -> dict[str, float]:
    image = np.random.default_rng(1).integers(0, 255, (1080, 1920, 3), dtype=np.uint8)
    matrix = np.array([[1344, 0, 960], [0, 1344, 540], [0, 0, 1.0]])
    kept = cv2.initUndistortRectifyMap(matrix, LENS, None, matrix, (1920, 1080), cv2.CV_16SC2)
    return {
        "undistort_1080p_ms": 1e3 * median(lambda: cv2.undistort(image, matrix, LENS), 15),
        "undistort_1080p_cached_ms": 1e3 * median(lambda: cv2.remap(image, *kept, cv2.INTER_LINEAR), 15),
    }


if __name__ == "__main__":
    cv2.setNumThreads(1)
    print(json.dumps(points() | images()))
