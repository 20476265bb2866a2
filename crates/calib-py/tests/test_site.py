"""Sites, cameras and calibration."""

import copy
import json
import pickle
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest

import calib

LINES = [
    calib.vertical([[(641.5, 465.0), (594.5, 105.3)], [(1325.2, 484.9), (1368.5, 105.5)], [(1008.0, 352.3), (1008.4, 48.5)]]),
    calib.parallel(
        np.array([[[624.5, 759.5], [642.3, 421.9]], [[1325.8, 745.8], [1086.0, 411.5]], [[989.1, 808.5], [869.1, 438.3]]]),
        id="tiles",
    ),
    calib.perpendicular([[(837.1, 691.7), (1076.8, 582.4)], [(1140.2, 631.0), (916.2, 517.0)]]),
]


def test_a_site_created_in_python_is_calibrated() -> None:
    door = calib.camera_entry("door", (1920, 1080), LINES, placement={"move_m": [4.0, -2.0], "turn_deg": 33.0})
    site = calib.Site(calib.site_document([door], name="Shop"))
    assert site.cameras == []
    with pytest.raises(calib.CalibError, match="calibrate|solve") as caught:
        site.camera("door")
    assert caught.value.camera == "door"
    solved = site.calibrate()
    assert solved.cameras == ["door"] and solved != site
    camera = solved.camera("door")
    assert camera.position[:2] == pytest.approx((4.0, -2.0)) and 20 < camera.pitch_deg < 40
    assert camera.covariance.shape == (15, 15) and camera.efov.shape[1] == 2
    assert all(isinstance(found, calib.Finding) and found.advice for found in solved.findings)
    x, y, status = camera.to_floor(960.0, 800.0)
    u, v, _ = camera.to_pixel(x, y)
    assert (u, v) == pytest.approx((960, 800)) and status.name == "OK"
    shifted = calib.vertical([[(641.0, 464.5), (594.0, 104.8)]], origin="centre")["segments"]
    np.testing.assert_allclose(shifted, [[(641.5, 465.0), (594.5, 105.3)]])


def test_coverage_and_measurements_agree_with_the_camera() -> None:
    door = calib.camera_entry("door", (1920, 1080), LINES, placement={"move_m": [4.0, -2.0]}, height_m={"value": 3.0, "sigma": 0.02})
    site = calib.Site(calib.site_document([door])).calibrate()
    camera = site.camera("door")
    coverage = site.coverage(step=0.5)
    shape = (len(coverage["y"]), len(coverage["x"]))
    assert all(coverage[key].shape == shape for key in ("px_per_m", "best", "seen_by"))
    seen = coverage["seen_by"] > 0
    assert seen.any() and (coverage["px_per_m"][seen] > 0).all() and (coverage["best"][~seen] == -1).all()
    rows, columns = np.nonzero(seen)
    u, v, _ = camera.to_pixel(coverage["x"][columns], coverage["y"][rows], np.zeros(len(rows)))
    assert ((u >= 0) & (u <= 1920) & (v >= 0) & (v <= 1080)).all()
    x, y, _ = camera.to_floor([800.0, 1100.0], [800.0, 800.0])
    length, sigma = site.measure([("door", 800.0, 800.0), ("door", 1100.0, 800.0)])
    assert length == pytest.approx(np.hypot(x[1] - x[0], y[1] - y[0])) and sigma is not None and 0 < sigma < 0.1 * length
    times = ["2026-05-01T08:00:00Z", "2026-05-01T08:00:02Z"]
    speed, _ = site.measure([("door", 800.0, 800.0), ("door", 1100.0, 800.0)], "speed", times=times)
    assert speed == pytest.approx(length / 2)
    with pytest.raises(calib.CalibError, match="horizon|field of view"):
        site.measure([("door", 800.0, 800.0), ("door", 1100.0, 1.0)])
    with pytest.raises(calib.CalibError, match="expected one of"):
        site.coverage(level="read")  # type: ignore[arg-type]
    assert coverage["hand_overs"] == []
    gate = calib.camera_entry("gate", (1920, 1080), LINES, placement={"move_m": [4.5, -2.0]}, height_m={"value": 3.0, "sigma": 0.02})
    pair = calib.Site(calib.site_document([door, gate], level_px_per_m={"identify": 200.0})).calibrate()
    (zone,) = pair.coverage(step=0.5)["hand_overs"]
    assert zone["cameras"] == ["door", "gate"] and zone["area"] > 1.0
    assert zone["disagreement"] is None and "placed by hand" in zone["unknown"]


def test_a_camera_that_cannot_be_solved_has_a_reason() -> None:
    entry = calib.camera_entry("door", (1920, 1080), [calib.straight([(10, 20), (300, 24), (600, 21)])])
    solved = calib.Site(calib.site_document([entry])).calibrate()
    assert {found.camera for found in solved.findings} == {"door"}
    assert solved.findings[-1].severity == "error"
    with pytest.raises(calib.CalibError, match="only the lens is calibrated"):
        solved.camera("door")


def test_errors_name_the_camera_and_the_value(folder: Path, site: calib.Site, tmp_path: Path) -> None:
    document = site.to_dict()
    document["cameras"][0]["size_px"] = [0, 10]
    with pytest.raises(calib.CalibError, match="/cameras/0/size_px") as caught:
        calib.Site(document)
    assert caught.value.field == "/cameras/0/size_px/0" or "size_px" in str(caught.value.field)
    with pytest.raises(calib.CalibError, match="camera-3"):
        site.camera("roof")
    with pytest.raises(FileNotFoundError):
        calib.Site.open(tmp_path / "none.json")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(calib.CalibError, match="bad.json"):
        calib.Site.open(tmp_path / "bad.json")
    for wrong in [None, 3, {"a": object()}, "{", [], {1, 2}]:
        with pytest.raises(calib.CalibError):
            calib.Site(wrong)  # type: ignore[arg-type]


def test_a_stream_of_a_wrong_size_is_rejected_with_the_expected_size(site: calib.Site) -> None:
    camera = site.camera("camera-0")
    with pytest.raises(calib.CalibError, match="640 x 360") as caught:
        camera.to_floor(1.0, 2.0, stream_size=(640, 640))
    assert (caught.value.camera, caught.value.field) == ("camera-0", "stream_size")
    for wrong in [{"origin": "center"}, {"fit": "crop"}, {"stream_size": (0, 1)}, {"crop": (0, 0, 9999, 1)}, {"stream_size": (1.5, 2)}]:
        with pytest.raises(calib.CalibError):
            camera.with_stream(**wrong)
    with pytest.raises(TypeError, match="streamsize"):
        camera.to_floor(1.0, 2.0, streamsize=(1, 2))  # type: ignore[call-overload]
    stream = camera.with_stream(stream_size=(640, 640), fit="letterbox", origin="centre")
    assert (stream.stream_size, stream.fit, stream.origin, stream.crop) == ((640, 640), "letterbox", "centre", None)
    assert stream.to_floor(319.5, 419.5) == camera.to_floor(960.0, 840.0)
    assert stream != camera and "camera-0" in repr(stream)


def test_a_period_is_chosen_by_a_time(site: calib.Site) -> None:
    document = site.to_dict()
    before, after = copy.deepcopy(document["cameras"][0]), copy.deepcopy(document["cameras"][0])
    before["valid_to"] = after["valid_from"] = "2026-06-01T00:00:00Z"
    after["solution"]["position_m"][0] += 1.0
    moved = calib.Site({**document, "cameras": [before, after]})
    with pytest.raises(calib.CalibError, match="several periods"):
        moved.camera("camera-0")
    early, late = moved.camera("camera-0", "2026-05-01T00:00:00Z"), moved.camera("camera-0", datetime(2026, 7, 1, tzinfo=timezone.utc))
    assert late.position[0] == early.position[0] + 1.0 and moved.cameras == ["camera-0"]
    with pytest.raises(calib.CalibError, match="time"):
        moved.camera("camera-0", "noon")


def test_all_objects_can_be_pickled(site: calib.Site) -> None:
    again = pickle.loads(pickle.dumps(site))
    assert again == site and json.loads(site.to_json()) == site.to_dict()
    for index in range(20):
        camera = site.camera(f"camera-{index}", stream_size=(960, 540), origin="centre")
        copied = pickle.loads(pickle.dumps(camera))
        assert copied == camera and copied.to_floor(480.0, 500.0)[2] == camera.to_floor(480.0, 500.0)[2]
        assert np.array_equal(copied.covariance, camera.covariance)
        np.testing.assert_array_equal(copied.to_floor([480.0], [500.0])[0], camera.to_floor([480.0], [500.0])[0])


    undistorter = site.camera("camera-2", stream_size=(960, 540)).undistorter("all-valid")
    image = np.random.default_rng(1).integers(0, 255, (540, 960), dtype="u1")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(undistorter))(image), undistorter(image))
    weak = calib.Site(calib.site_document([calib.camera_entry("a", (1920, 1080), LINES[:1])])).calibrate()
    assert weak.findings and set(pickle.loads(pickle.dumps(weak.findings))) == set(weak.findings)


def test_the_matrices_of_a_stream_match_its_pixels(site: calib.Site) -> None:
    for keywords in [{}, {"stream_size": (960, 540), "origin": "centre"}, {"stream_size": (640, 640), "fit": "letterbox"}]:
        camera = site.camera("camera-2", **keywords)
        x, y = camera.to_floor(500.0, 480.0)[:2]
        shown = camera.projection_matrix @ [x, y, 0.0, 1.0]
        straight = camera.undistort([500.0], [480.0])
        np.testing.assert_allclose(shown[:2] / shown[2], np.ravel(straight), atol=1e-6)
        floor = camera.floor_from_pixel @ [straight[0][0], straight[1][0], 1.0]
        np.testing.assert_allclose(floor[:2] / floor[2], [x, y], rtol=1e-6)
        u, v = camera.principal_point_px
        assert np.array_equal(camera.camera_matrix, [[camera.focal_px, 0, u], [0, camera.focal_px, v], [0, 0, 1]])
    assert site.camera("camera-2").undistorter(stream_size=(960, 540)).size == (960, 540)
    with pytest.raises(calib.CalibError, match="stretched"):
        site.camera("camera-2", stream_size=(640, 640), fit="stretch").camera_matrix


def test_a_failed_allocation_raises_an_exception(folder: Path) -> None:
    script = """
import resource, sys
import numpy as np
import calib
camera = calib.Site.open(sys.argv[1]).camera("camera-2")
u = np.full(10_000_000, 960.0)
used = 1024 * int(next(line for line in open("/proc/self/status") if line.startswith("VmSize")).split()[1])
resource.setrlimit(resource.RLIMIT_AS, (used + (100 << 20),) * 2)
for call in [camera.to_floor, camera.floor_covariance, camera.floor_jacobian, camera.rays, camera.undistort]:
    try:
        call(u, u)
    except MemoryError:
        continue
    sys.exit(f"{call}: no MemoryError")
"""
    if not sys.platform.startswith("linux"):
        pytest.skip("limits of memory are tried on Linux")
    subprocess.run([sys.executable, "-c", script, str(folder / "site.json")], check=True)


def test_calls_on_arrays_release_the_gil(site: calib.Site) -> None:
    camera = site.camera("camera-2")
    boxes = np.tile([[900.0, 400.0, 960.0, 700.0]], (2_000_000, 1))
    ticks, done = [], threading.Event()

    def tick() -> None:
        while not done.wait(0.001):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.perf_counter()
    camera.boxes_to_floor(boxes, form="xyxy")
    end = time.perf_counter()
    done.set()
    thread.join()
    assert sum(begin < at < end for at in ticks) >= 3, f"{len(ticks)} ticks in {end - begin} s"


def test_an_image_is_undistorted(site: calib.Site) -> None:
    camera = site.camera("camera-2")
    straight = camera.undistorter("all-valid")
    image = np.random.default_rng(0).integers(0, 255, (1080, 1920, 3), dtype="u1")
    out = np.zeros_like(image)
    assert straight(image, out) is out and np.array_equal(out, straight(image[::1]))
    assert np.array_equal(straight(np.asfortranarray(image)), out) and (out.sum(axis=2) > 0).mean() > 0.99
    assert straight.size == (1920, 1080) and straight.focal > camera.undistorter("all-pixels").focal
    assert np.array_equal(straight(image[..., 1]), out[..., 1])
    clear = np.concatenate([image, np.full((1080, 1920, 1), 255, dtype="u1")], axis=2)
    assert np.array_equal(straight(clear)[..., :3], out)
    for wrong in [image[:540], image[..., :2], image.astype("f4"), "image"]:
        with pytest.raises(calib.CalibError, match="1080, 1920, 3 or 4"):
            straight(wrong)  # type: ignore[arg-type]


def test_plan_and_floor_convert_both_ways(folder: Path) -> None:
    shop = calib.Site.open(folder / "demo" / "solved.json")
    x, y = np.array([[1.0, 4.0], [7.5, -2.0]]), np.array([[2.0, 3.0], [0.0, 1.0]])
    px, py = shop.floor_to_plan(x, y)
    assert px.shape == (2, 2) and px[0, 1] > px[0, 0] and py[0, 1] < py[0, 0]
    np.testing.assert_allclose(shop.plan_to_floor(px, py), (x, y), atol=1e-9)
    metres_per_px = shop.plan_metres_per_px
    assert metres_per_px is not None and metres_per_px == shop.to_dict()["plan"]["metres_per_px"]
    assert np.hypot(px[0, 1] - px[0, 0], py[0, 1] - py[0, 0]) * metres_per_px == pytest.approx(np.hypot(3, 1))
    assert calib.Site(calib.site_document([])).plan_metres_per_px is None


def test_floor_and_geographic_coordinates_convert_both_ways(folder: Path) -> None:
    shop = calib.Site.open(folder / "demo" / "solved.json")
    with pytest.raises(ValueError, match="georeference"):
        shop.floor_to_geographic(0.0, 0.0)
    document = {**shop.to_dict(), "georeference": {"lat_deg": 48.0, "lon_deg": 11.0, "x_axis_azimuth_deg": 90.0}}
    placed = calib.Site(document)
    lat, lon = placed.floor_to_geographic(np.array([0.0, 100.0]), np.array([0.0, 0.0]))
    # 100 m to the east at 48 degrees of latitude.
    assert lat[0] == pytest.approx(48.0) and lon[1] - lon[0] == pytest.approx(0.00134003, abs=1e-7)
    np.testing.assert_allclose(placed.geographic_to_floor(lat, lon), ([0.0, 100.0], [0.0, 0.0]), atol=1e-3)


def test_images_of_a_stream_are_undistorted_directly(site: calib.Site) -> None:
    camera = site.camera("camera-2", stream_size=(960, 540))
    straight = camera.undistorter("all-valid")
    whole = site.camera("camera-2").undistorter("all-valid")
    assert straight.size == (960, 540) and abs(straight.focal / whole.focal - 0.5) < 1e-3
    assert camera.camera_matrix[0, 0] == camera.focal_px and camera.distortion is not None
    with pytest.raises(calib.CalibError, match="stretched"):
        camera.with_stream(stream_size=(640, 640), fit="stretch").undistorter()


def test_an_invalid_call_is_reported_with_found_and_expected_value(site: calib.Site, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere.json") as missing:
        calib.Site.open(tmp_path / "nowhere.json")
    assert missing.value.filename == tmp_path / "nowhere.json" and missing.value.errno == 2
    for path in ["solved.json", tmp_path / "solved.json"]:
        with pytest.raises(calib.CalibError, match="Site.open"):
            calib.Site(path)  # type: ignore[arg-type]
    assert site.camera("camera-2", stream_size=[960, 540]).stream_size == (960, 540)  # type: ignore[arg-type]
    with pytest.raises(calib.CalibError, match="width, height"):
        site.camera("camera-2", stream_size=960)  # type: ignore[arg-type]
    straight = site.camera("camera-2").undistorter()
    with pytest.raises(calib.CalibError, match="was the image file read"):
        straight(None)  # type: ignore[arg-type]
    with pytest.raises(calib.CalibError, match="float32"):
        straight(np.zeros((1080, 1920, 3), dtype="f4"))  # type: ignore[arg-type]


def test_annotations_of_a_stream_are_converted_to_the_image() -> None:
    def entry(scale: float, bar: float, **stream: object) -> dict[str, object]:
        at = lambda *pixels: [(scale * u, scale * v + bar) for u, v in pixels]
        return calib.camera_entry("door", (1920, 1080), [
            calib.vertical([at((641.5, 465.0), (594.5, 105.3)), at((1325.2, 484.9), (1340, 300), (1368.5, 105.5))]),
            calib.straight(at((10, 20), (300, 24), (600, 21))),
            calib.upright(*at((500, 800), (500, 600)), 1.8),
        ], efov_px=at((0, 1080), (1920, 1080), (1000, 500)), control_points=[{"px": at((7, 9))[0], "world_m": [1, 2, 0]}], **stream)

    def numbers(value: object) -> list[float]:
        if isinstance(value, dict):
            value = list(value.values())
        if isinstance(value, (list, tuple)):
            return [number for one in value for number in numbers(one)]
        return [float(value)] if isinstance(value, (int, float)) else []

    still = entry(1.0, 0.0)
    letterboxed = entry(1 / 3, 140.0, stream_size=(640, 640), fit="letterbox")
    assert numbers(letterboxed) == pytest.approx(numbers(still)) and letterboxed.keys() == still.keys()
    assert numbers(entry(0.5, 0.0, stream_size=(960, 540))) == pytest.approx(numbers(still))
    with pytest.raises(calib.CalibError, match="letterbox") as caught:
        entry(0.5, 0.0, stream_size=(640, 640))
    assert caught.value.field == "stream_size"


@pytest.mark.parametrize(("build", "field"), [
    (lambda: calib.vertical(7), "segments"),
    (lambda: calib.vertical([[(1, 2)], [(3, 4, 5)]]), r"segments\[1\]"),
    (lambda: calib.parallel([["a", "b"]]), r"segments\[0\]"),
    (lambda: calib.straight([(1, 2)], origin="center"), "origin"),  # type: ignore[arg-type]
    (lambda: calib.upright((1, 2), [(1, 2)]), "head"),
    (lambda: calib.camera_entry("door", (1080, 1920, 3)), "size_px"),
    (lambda: calib.camera_entry("door", (1920, 1080), calib.straight([(1, 2), (3, 4)])), "annotations"),
])
def test_an_invalid_annotation_is_rejected_by_field(build: Callable[[], object], field: str) -> None:
    with pytest.raises(calib.CalibError, match=f"^{field}: ") as caught:
        build()
    assert re.fullmatch(field, caught.value.field or "")


def test_a_camera_without_a_scale_has_a_finding() -> None:
    line = calib.vertical([[(641.5, 465.0), (594.5, 105.3)], [(1325.2, 484.9), (1368.5, 105.5)]])
    tiles = calib.parallel([[(624.5, 759.5), (642.3, 421.9)], [(1325.8, 745.8), (1086.0, 411.5)]], id="tiles")

    def codes(**options: object) -> list[str]:
        entry = calib.camera_entry("door", (1920, 1080), [line, tiles], **options)
        return [finding.code for finding in calib.Site(calib.site_document([entry])).calibrate().findings]

    assert "scale-assumed" in codes()
    assert "scale-assumed" in codes(placement={"move_m": [1, 2], "turn_deg": 10})
    assert "scale-assumed" not in codes(placement={"move_m": [1, 2], "turn_deg": 10, "scale": 1.0})
    assert "scale-assumed" not in codes(height_m={"value": 2.9, "sigma": 0.02})


def test_the_covariance_is_unknown_without_a_scale() -> None:
    def camera(**options: object) -> calib.Camera:
        return calib.Site(calib.site_document([calib.camera_entry("door", (1920, 1080), LINES, **options)])).calibrate().camera("door")

    box = np.array([[900.0, 500.0, 1000.0, 800.0]])
    known, assumed = camera(height_m={"value": 3.0, "sigma": 0.05}), camera()
    assert known.scale_known and not assumed.scale_known
    assert not assumed.with_stream(stream_size=(640, 360)).scale_known
    for parts in [assumed.floor_covariance(950.0, 800.0), assumed.boxes_covariance(box, form="xyxy")]:
        assert np.isfinite(parts[0]).all() and np.isnan(parts[1]).all()
    assert np.isfinite(known.floor_covariance(950.0, 800.0)[1]).all()
    assert np.isinf(assumed.covariance[2, 2]) and np.isfinite(np.delete(np.delete(assumed.covariance, 2, 0), 2, 1)).all()
    again = pickle.loads(pickle.dumps(assumed))
    assert again == assumed and not again.scale_known
    assert pickle.loads(pickle.dumps(known)).scale_known
