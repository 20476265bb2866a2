"""Results are bit-identical to Rust, for every camera, stream and lens."""

from pathlib import Path

import numpy as np
from golden import SIGMA_PX, golden

import calib


def same(found: object, expected: object) -> None:
    np.testing.assert_array_equal(np.asarray(found, dtype=float), expected, strict=True)


def test_every_point_is_bit_identical_to_the_core(folder: Path, site: calib.Site) -> None:
    points = 0
    for given in golden(folder):
        camera = site.camera(given.id, **given.stream)
        u, v, x, y, status, *others = given.columns
        noise, calibration = np.array(others[:4]), np.array(others[4:8])
        found = camera.to_floor(u, v, given.height)
        same(found[0], x)
        same(found[1], y)
        same(found[2], status)
        parts = camera.floor_covariance(u, v, SIGMA_PX, given.height)
        same(parts[0].reshape(-1, 4).T, noise)
        same(parts[1].reshape(-1, 4).T, calibration)
        back = camera.to_pixel(x, y, given.height)
        for column, expected in zip(back, others[8:11], strict=True):
            same(column, expected)
        same(camera.rays(u, v).T, np.array(others[11:14]))
        same(camera.undistort(u, v), np.array(others[14:16]))
        points += len(u)
    assert points == 100_000


def test_keywords_of_a_call_equal_keywords_of_the_camera(folder: Path, site: calib.Site) -> None:
    for given in golden(folder):
        u, v, x, y, *_ = given.columns
        found = site.camera(given.id).to_floor(u, v, given.height, **given.stream)
        same(found[0], x)
        same(found[1], y)


def test_a_single_point_equals_an_array_of_one(folder: Path, site: calib.Site) -> None:
    for given in golden(folder):
        camera = site.camera(given.id, **given.stream)
        u, v, x, y, status, *_ = given.columns
        for i in range(0, len(u), 97):
            a, b, became = camera.to_floor(float(u[i]), float(v[i]), given.height)
            same([a, b, became], [x[i], y[i], status[i]])
            assert isinstance(became, calib.Status) and became.text == calib._calib.STATUS_NAMES[became]
