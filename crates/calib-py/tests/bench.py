"""Benchmark against OpenCV on one thread: `python bench.py` prints JSON.

Keys end in _ns (time per point) or _us (time per call). `cargo xtask bench python` computes ratios of them and of the
core's times from `cargo bench -p calib-core --bench floor_mapping`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable

import cv2
import numpy as np

import calib

COUNT = 1_000_000
DISTORTION = {"model": "brown-conrady", "k1": -0.2, "k2": 0.05, "p1": 0.001, "p2": -0.001, "k3": 0.01}


def camera(**lens: object) -> calib.Camera:
    solution = {
        "method": "given", "stage": "placed", "position_m": [0, 0, 3], "yaw_deg": 0, "pitch_deg": 34.4, "roll_deg": 1.7,
        "focal_px": 1200, "principal_point_px": [960, 540], **lens,
    }
    entry = calib.camera_entry("door", (1920, 1080), solution=solution)
    return calib.Site(calib.site_document([entry])).camera("door")


def median(work: Callable[[], object], runs: int = 15) -> float:
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def main() -> None:
    cv2.setNumThreads(1)
    random = np.random.default_rng(0)
    u, v = random.uniform(0, 1920, COUNT), random.uniform(0, 1080, COUNT)
    pairs = np.stack([u, v], axis=1)[:, None, :]
    out = (np.empty(COUNT), np.empty(COUNT), np.empty(COUNT, dtype="u1"))
    plain, distorted = camera(), camera(distortion=DISTORTION)
    matrix = np.array([[1200, 0, 960], [0, 1200, 540], [0, 0, 1.0]])
    lens = np.array([DISTORTION[k] for k in ["k1", "k2", "p1", "p2", "k3"]])
    homography = plain.floor_from_pixel
    ns = 1e9 / COUNT
    to_floor = ns * median(lambda: plain.to_floor(u, v, status=False, out=out[:2]))
    with_status = ns * median(lambda: plain.to_floor(u, v, out=out))
    distorted_to_floor = ns * median(lambda: distorted.to_floor(u, v, status=False, out=out[:2]))
    new_arrays = ns * median(lambda: plain.to_floor(u, v))
    undistort = ns * median(lambda: distorted.undistort(u, v))
    cv_floor = ns * median(lambda: cv2.perspectiveTransform(pairs, homography))
    cv_undistort = ns * median(lambda: cv2.undistortPoints(pairs, matrix, lens, P=matrix))
    a, b = float(u[0]), float(v[0])
    calls = 20_000

    def single(camera: calib.Camera) -> float:
        def work() -> None:
            for _ in range(calls):
                camera.to_floor(a, b)

        return 1e6 / calls * median(work, 7)

    print(json.dumps({
        "python_to_floor_ns": to_floor,
        "python_to_floor_with_status_ns": with_status,
        "python_to_floor_new_arrays_ns": new_arrays,
        "python_distorted_to_floor_ns": distorted_to_floor,
        "python_undistort_ns": undistort,
        "perspective_transform_ns": cv_floor,
        "undistort_points_ns": cv_undistort,
        "python_single_us": single(plain),
        "python_single_distorted_us": single(distorted),
    }))


if __name__ == "__main__":
    main()
