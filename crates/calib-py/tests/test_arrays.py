"""Arrays of any dtype, strides and shape: a result or an exception, and never a crash."""

import random
import threading
from typing import Any

import numpy as np
import pytest

import calib

U = np.linspace(0, 1900, 60)
V = np.linspace(300, 1050, 60)


def assert_same(found: Any, expected: Any) -> None:
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("kind", ["f2", "f4", "f8", ">f8", "<f4", "i2", "i4", "i8", "u2", "u4", "u8", ">i4", "g"])
def test_any_numeric_type_is_accepted(camera: calib.Camera, kind: str) -> None:
    u, v = U.round().astype(kind), V.round().astype(kind)
    assert_same(camera.to_floor(u, v), camera.to_floor(u.astype(float), v.astype(float)))


def test_strides_are_respected(camera: calib.Camera) -> None:
    both = np.stack([U, V, U + 1, V + 2], axis=1)
    expected = camera.to_floor(U, V)
    assert_same(camera.to_floor(both[:, 0], both[:, 1]), expected)
    assert_same(camera.to_floor(U[::-1], V[::-1]), [column[::-1] for column in expected])
    assert_same(camera.to_floor(np.asfortranarray(U.reshape(6, 10)), V.reshape(6, 10)), [c.reshape(6, 10) for c in expected])
    raw = np.zeros(60 * 8 + 1, dtype="u1")[1:].view("f8")
    raw[:] = U
    assert not raw.flags.aligned
    assert_same(camera.to_floor(raw, V), expected)


def test_shapes_are_broadcast(camera: calib.Camera) -> None:
    grid = camera.to_floor(U[None, :], V[:, None])
    assert [column.shape for column in grid] == [(60, 60)] * 3
    assert_same([column[7, 9] for column in grid], camera.to_floor(float(U[9]), float(V[7])))
    assert camera.floor_covariance(U[None, :], V[:, None])[0].shape == (60, 60, 2, 2)
    assert camera.to_floor([], [])[0].shape == (0,)
    assert camera.to_floor(np.zeros((0, 3)), np.zeros((0, 3)))[2].shape == (0, 3)
    assert camera.to_pixel(U, V).__len__() == 3 and camera.to_pixel(U, V, 1.7)[0].shape == (60,)


def test_unnecessary_copies_are_avoided(camera: calib.Camera) -> None:
    out = (np.empty(60), np.empty(60), np.empty(60, dtype="u1"))
    found = camera.to_floor(U, V, out=out)
    assert all(a is b for a, b in zip(found, out, strict=True))
    assert_same(out, camera.to_floor(U, V))
    for wrong in [out[:2], (out[0], out[1], out[0]), (np.empty(59), *out[1:]), (np.empty(120)[::2], *out[1:]), 7]:
        with pytest.raises(calib.CalibError, match="out"):
            camera.to_floor(U, V, out=wrong)  # type: ignore[arg-type]
    with pytest.raises(calib.CalibError, match="out"):
        camera.to_floor(out[0], V, out=out)
    found = camera.to_floor(U, V, status=False, out=out[:2])
    assert found[0] is out[0] and len(found) == 2
    np.testing.assert_allclose(found, camera.to_floor(U, V)[:2])
    fixed = np.empty(60)
    fixed.flags.writeable = False
    with pytest.raises(calib.CalibError, match="out"):
        camera.to_floor(U, V, out=(fixed, *out[1:]))


def test_masked_values_are_missing(camera: calib.Camera) -> None:
    masked = np.ma.masked_array(U, mask=U > 1000)
    x, _, status = camera.to_floor(masked, V)
    assert np.isnan(x[U > 1000]).all() and (status[U > 1000] == calib.Status.MISSING).all()
    assert np.isfinite(camera.to_floor(U, V)[0][0]) == np.isfinite(x[0])


@pytest.mark.parametrize(
    "wrong", ["text", ["a"], [None], object(), {}, [[1], [1, 2]], [1j], np.array(["2020-01-01"], "M8[D]"), b"x", [True]]
)
def test_non_numeric_values_are_rejected_by_name(camera: calib.Camera, wrong: object) -> None:
    with pytest.raises(calib.CalibError) as caught:
        camera.to_floor(wrong, V)  # type: ignore[call-overload]
    assert caught.value.field == "u"


def test_boxes_of_every_form_have_the_same_foot_point(camera: calib.Camera) -> None:
    x, y, w, h = U, V - 200, np.full(60, 40.0), np.full(60, 200.0)
    expected = camera.to_floor(x + 0.5 * w, y + h)
    assert_same(camera.boxes_to_floor(np.stack([x, y, w, h], axis=1), form="xywh"), expected)
    corners = np.stack([x, y, x + w, y + h], axis=1)
    for found, wanted in zip(camera.boxes_to_floor(corners, form="xyxy"), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9)
    width, height = camera.size
    fractions = np.stack([(x + 20) / width, (y + 100) / height, w / width, h / height], axis=1)
    for found, wanted in zip(camera.boxes_to_floor(fractions, form="yolo"), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9)
    assert camera.boxes_to_floor(np.zeros((0, 4)), form="xyxy")[0].shape == (0,)
    assert camera.boxes_to_floor([], form="xyxy")[0].shape == (0,)
    with pytest.raises(calib.CalibError, match=r"\(\.\.\., 4\)"):
        camera.boxes_to_floor(np.zeros((4, 5)), form="xyxy")
    with pytest.raises(calib.CalibError, match="xyxy"):
        camera.boxes_to_floor(corners, form="yxyx")  # type: ignore[arg-type]


def anything(rng: random.Random) -> Any:
    """Returns an array of a random type and shape, or another object."""
    kinds = ["f2", "f4", "f8", "i1", "u8", ">f8", "c8", "?", "S3", "U2", "M8[s]", "O", "V5", "g"]
    shape = tuple(rng.choice([0, 1, 2, 3, 7]) for _ in range(rng.randrange(4)))
    kind = rng.choice(kinds)
    array = np.zeros(shape, dtype=kind) if rng.random() < 0.5 else np.full(shape, 3, dtype="f8").astype(kind if kind not in ("M8[s]", "V5") else "f4")
    if rng.random() < 0.3 and array.ndim:
        array = array[..., ::-1]
    if rng.random() < 0.1:
        return rng.choice([None, "x", 3, 2.5, np.nan, [1, [2]], {}, (1, 2), np.float32(3), np.ma.masked, 10**400])
    return array


@pytest.mark.filterwarnings("ignore")
def test_no_input_crashes_the_interpreter(camera: calib.Camera) -> None:
    rng = random.Random(20)
    calls = [
        lambda a, b, c: camera.to_floor(a, b, out=c if rng.random() < 0.2 else None),
        lambda a, b, c: camera.to_pixel(a, b, c),
        lambda a, b, c: camera.boxes_to_floor(a, form=rng.choice(["xywh", "xyxy", "cxcywh", "yolo"])),
        lambda a, b, c: camera.floor_covariance(a, b, sigma_px=rng.choice([0.0, 1.0, 1e300])),
        lambda a, b, c: camera.floor_jacobian(a, b),
        lambda a, b, c: camera.rays(a, b, stream_size=rng.choice([None, (640, 360), (0, 0), (1e300, 2)])),
        lambda a, b, c: camera.undistort(a, b, crop=rng.choice([None, (0, 0, 10, 10), (np.nan,) * 4])),
        lambda a, b, c: camera.undistorter()(a),
        lambda a, b, c: camera.to_floor(a, b, height=rng.choice([0.0, 1e308, np.inf, camera.position[2]])),
    ]
    done = 0
    for _ in range(20_000):
        call = rng.choice(calls[:-2] + calls[-1:]) if rng.random() < 0.99 else calls[-2]
        try:
            call(anything(rng), anything(rng), anything(rng))
            done += 1
        except (ValueError, TypeError, OverflowError):
            pass
    assert done > 500


def test_threads_share_a_camera(camera: calib.Camera) -> None:
    u, v = np.tile(U, 2000), np.tile(V, 2000)
    expected = camera.to_floor(u, v)
    wrong: list[str] = []

    def work() -> None:
        for _ in range(5):
            found = camera.to_floor(u, v)
            if not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(found, expected, strict=True)):
                wrong.append("another result")

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
