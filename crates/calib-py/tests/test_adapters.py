"""The adapters work with the packages that they are for, in at most five lines."""

import ast
import importlib
import importlib.util
import json
import os
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import calib

BOXES = np.array([[900.0, 400.0, 960.0, 700.0], [300.0, 500.0, 380.0, 900.0]], dtype="f4")
EXAMPLE = Path(__file__).parents[1] / "examples/adapters.py"


def loaded() -> ModuleType:
    spec = importlib.util.spec_from_file_location("adapters", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


ADAPTERS = loaded()


@pytest.fixture()
def expected(camera: calib.Camera) -> np.ndarray:
    x, y, _ = camera.to_floor(0.5 * (BOXES[:, 0] + BOXES[:, 2]).astype(float), BOXES[:, 3])
    return np.stack([x, y], axis=1)


def test_every_adapter_has_five_lines_at_most() -> None:
    functions = [node for node in ast.parse(EXAMPLE.read_text()).body if isinstance(node, ast.FunctionDef)]
    assert len(functions) == 5
    for function in functions:
        body = function.body[1:]  # without the docstring
        assert (body[-1].end_lineno or 0) - body[0].lineno < 5, function.name


def test_supervision(camera: calib.Camera, expected: np.ndarray) -> None:
    sv = pytest.importorskip("supervision")
    detections = sv.Detections(xyxy=BOXES, class_id=np.array([0, 0]))
    found = ADAPTERS.of_supervision(camera, detections)
    kept = camera.boxes_to_floor(BOXES, form="xyxy")[2] == calib.Status.OK
    np.testing.assert_allclose(found.data["floor_m"], expected[kept], rtol=1e-9)
    assert camera.boxes_to_floor(sv.Detections.empty().xyxy, form="xyxy")[0].shape == (0,)


def test_ultralytics(camera: calib.Camera, expected: np.ndarray) -> None:
    if "CALIB_ULTRALYTICS" not in os.environ:
        pytest.skip("Ultralytics has an environment of its own: `cargo xtask py --ultralytics`")
    results = importlib.import_module("ultralytics.engine.results")
    frame = np.zeros((1080, 1920, 3), dtype="u1")
    with_scores = np.concatenate([BOXES, [[0.9, 0], [0.8, 0]]], axis=1)
    # A tensor, as the network returns it.
    boxes = importlib.import_module("torch").tensor(with_scores)
    result = results.Results(frame, path="", names={0: "person"}, boxes=boxes)
    np.testing.assert_allclose(ADAPTERS.of_ultralytics(camera, result), expected, rtol=1e-9)


def test_norfair(camera: calib.Camera, expected: np.ndarray) -> None:
    norfair = pytest.importorskip("norfair")
    tracker = norfair.Tracker(distance_function="mean_euclidean", distance_threshold=1.0, initialization_delay=0)
    tracks = tracker.update(detections=ADAPTERS.of_norfair(camera, BOXES))  # in metres, like the threshold
    found = {tuple(np.round(track.estimate[0], 6)) for track in tracks}
    assert found and found <= {tuple(np.round(point, 6)) for point in expected}


def test_frigate(camera: calib.Camera, expected: np.ndarray) -> None:
    box = [int(value * 1280 / 1920) for value in BOXES[0]]
    payload = json.dumps({"type": "update", "after": {"id": "1", "camera": "door", "box": box, "label": "person"}})
    found = ADAPTERS.of_frigate(camera, payload, (1280, 720))
    assert np.hypot(*found - expected[0]) < 0.05 * np.hypot(*expected[0] - camera.position[:2])


def test_opencvs_capture_loop(site: calib.Site, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    camera = site.camera("camera-0")
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 5, (960, 540))
    for i in range(3):
        frame = np.zeros((540, 960, 3), dtype="u1")
        cv2.circle(frame, (400 + 50 * i, 400), 12, (255, 255, 255), -1)
        writer.write(frame)
    writer.release()

    def middle(frame: np.ndarray) -> tuple[float, float]:
        moments = cv2.moments(cv2.inRange(frame, (128, 128, 128), (255, 255, 255)))
        return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]

    feet = list(ADAPTERS.of_opencv(camera, cv2.VideoCapture(str(tmp_path / "v.avi")), middle))
    assert len(feet) == 3
    for i, foot in enumerate(feet):
        u, v, _ = camera.to_pixel(*foot, stream_size=(960, 540), origin="centre")
        assert (u, v) == pytest.approx((400 + 50 * i, 400), abs=0.5)


def test_boxes_of_a_letterboxed_network(camera: calib.Camera, expected: np.ndarray) -> None:
    in_network = BOXES * (640 / 1920) + np.array([0, 140, 0, 140], dtype="f4")
    x, y, _ = camera.boxes_to_floor(in_network, form="xyxy", stream_size=(640, 640), fit="letterbox")
    np.testing.assert_allclose(np.stack([x, y], axis=1), expected, rtol=1e-3)
