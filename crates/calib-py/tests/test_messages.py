"""Error messages of invalid calls: the argument or field, the value, and the expected value."""

import datetime
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import calib

VERTICAL = [[(641.5, 465.0), (594.5, 105.3)], [(1325.2, 484.9), (1368.5, 105.5)], [(1008.0, 352.3), (1008.4, 48.5)]]
TILES = [[(624.5, 759.5), (642.3, 421.9)], [(1325.8, 745.8), (1086.0, 411.5)], [(989.1, 808.5), (869.1, 438.3)]]
RIGHT_ANGLES = [[(837.1, 691.7), (1076.8, 582.4)], [(1140.2, 631.0), (916.2, 517.0)]]
LINES = [calib.vertical(VERTICAL), calib.parallel(TILES), calib.perpendicular(RIGHT_ANGLES)]
TABLE = pa.table({"u": [1000.0], "v": [900.0], "camera": ["camera-0"]})
NAIVE = datetime.datetime(2026, 5, 1, 8)

Call = Callable[[calib.Site, calib.Camera], object]


def raised(call: Callable[[], object]) -> calib.CalibError:
    with pytest.raises(calib.CalibError) as caught:
        call()
    return caught.value


def door(**options: object) -> dict[str, object]:
    return calib.camera_entry("door", (1920, 1080), LINES, **options)


@pytest.mark.parametrize(("call", "field", "words"), [
    (lambda s, c: c.boxes_to_floor(np.ones((3, 6)), form="xyxy"), "boxes", "(3, 6), expected (..., 4); for rows such as x1, y1, x2, y2, confidence, class pass boxes[..., :4]"),
    (lambda s, c: c.boxes_to_floor(np.ones((3, 3)), form="xyxy"), "boxes", "(3, 3), expected (..., 4)"),
    (lambda s, c: c.boxes_to_floor(None, form="xyxy"), "boxes", "found None, expected an array of numbers"),
    (lambda s, c: c.boxes_covariance(np.ones(6), form="xyxy"), "boxes", "(6,), expected (..., 4); for rows"),
    (lambda s, c: c.to_floor(None, [1.0]), "u", "found None"),
    (lambda s, c: c.to_floor([1.0, 2.0], [1.0, 2.0, 3.0]), "u, v", "(2,) and (3,)"),
    (lambda s, c: c.to_floor([1.0], [1.0], height="1.7 m"), "height", "found '1.7 m', expected one number"),
    (lambda s, c: c.floor_covariance([1.0, 2.0], [1.0, 2.0], sigma_px=[1.0, 2.0, 3.0]), "sigma_px", "found [1.0, 2.0, 3.0], expected one number"),
    (lambda s, c: c.floor_covariance([1.0, 2.0], [1.0, 2.0], sigma_px=np.ones(2)), "sigma_px", "an array of the shape (2,), expected one number"),
    (lambda s, c: c.boxes_covariance(np.ones((1, 4)), sigma_px=-1, form="xyxy"), "sigma_px", "0 or more"),
    (lambda s, c: s.camera("camera-0", at=NAIVE), "at", "2026-05-01 08:00:00 without a time zone"),
    (lambda s, c: s.camera("camera-0", at=5), "at", "found 5, expected text such as"),
    (lambda s, c: s.camera("camera-0", at="noon"), "at", "expected a time such as 2026-05-01T08:00:00Z"),
    (lambda s, c: s.project(TABLE, camera="camera-0", at=NAIVE), "at", "without a time zone"),
    (lambda s, c: s.project(TABLE, camera="camera-0", camera_column="camera"), "camera", "found camera and camera_column, expected one of them"),
    (lambda s, c: s.project(TABLE), "camera", "camera_column="),
    (lambda s, c: s.project(TABLE, camera="camera-0", height="x"), "height", "found 'x'"),
    (lambda s, c: s.camera("camera-0", fit="letterbx"), "fit", '"stretch" or "letterbox"'),
    (lambda s, c: s.camera("camera-0", stream_size=(1080, 1920)), "stream_size", "width and height seem to be swapped: 1920 x 1080 fits"),
    (lambda s, c: s.camera("camera-0", stream_size=(360, 640)), "stream_size", "width and height seem to be swapped: 640 x 360 fits"),
    (lambda s, c: c.undistorter(stream_size=(1280, 720))(np.zeros((1080, 1920, 3), "u1")), "image", "found an image of 1920 x 1080 pixels, this undistorter is for 1280 x 720 pixels"),
])
def test_an_invalid_argument_is_named_with_the_expected_value(site: calib.Site, call: Call, field: str, words: str) -> None:
    error = raised(lambda: call(site, site.camera("camera-0")))
    assert error.field == field and words in str(error), error


@pytest.mark.parametrize("call", [
    lambda s: s.camera("camera-0", letterbox=True), lambda s: s.camera("camera-0").to_floor(1.0, 2.0, size=(640, 640)),
    lambda s: s.project(TABLE, camera="camera-0", column="boxes"),
])
def test_an_unknown_keyword_lists_the_valid_keywords(site: calib.Site, call: Callable[[calib.Site], object]) -> None:
    with pytest.raises(TypeError, match=r'fit \("stretch" or "letterbox"\)'):
        call(site)
    with pytest.raises(TypeError, match="camera_column, at, at_column"):
        site.project(TABLE, camera="camera-0", column="boxes")  # type: ignore[call-arg]


@pytest.mark.parametrize(("build", "field", "words"), [
    (lambda: door(height_m=3.88), "height_m", '{"value": 3.88, "sigma": 0.05}, or {"value": 3.88, "fixed": True}'),
    (lambda: door(lens={"focal_px": 1400}), "focal_px", '"value": 1400'),
    (lambda: door(heights_m={"value": 3.88, "fixed": True}), "heights_m", "did you mean height_m?"),
    (lambda: door(annotation=LINES), "annotation", "unexpected keyword"),
    (lambda: calib.camera_entry("door", 1920), "size_px", "found 1920, expected (width, height)"),  # type: ignore[arg-type]
    (lambda: calib.upright((1, 2), (3, 4), height=2.0), "height", "did you mean height_m?"),
    (lambda: calib.vertical(VERTICAL, sigma=1.0), "sigma", "did you mean sigma_px?"),
    (lambda: calib.straight(VERTICAL[0], colour="red"), "colour", "expected id, name, off"),
    (lambda: calib.site_document([door()], camera=[]), "camera", "unexpected keyword"),
    (lambda: calib.site_document(door()), "cameras", "put [ ] around it"),
])
def test_an_invalid_entry_is_rejected_on_creation(build: Callable[[], object], field: str, words: str) -> None:
    error = raised(build)
    assert error.field == field and words in str(error), error


def test_the_keywords_of_entries_are_the_fields_of_the_site_file() -> None:
    def fields(document: dict[str, object]) -> set[str]:
        return set(re.findall("`(\\w+)`", str(raised(lambda: calib.Site(document))).split("expected one of")[1]))

    from calib import entries

    of_site = {**calib.site_document([]), "none": 1}
    assert fields(of_site) == {*entries._SITE_KEYS, "format", "version", "cameras"}
    of_camera = calib.site_document([{"id": "a", "size_px": [9, 9], "none": 1}])
    assert fields(of_camera) == {*entries._CAMERA_KEYS, "id", "size_px", "annotations"}
    of_annotation = calib.site_document([calib.camera_entry("a", (9, 9), [{"kind": "vertical", "none": 1}])])
    assert fields(of_annotation) == {*entries._ANNOTATION_KEYS, "kind", "segments", "points", "foot", "head"}


def test_an_invalid_dict_is_reported_with_its_path_and_without_column() -> None:
    document = calib.site_document([door()])
    document["cameras"][0]["height_m"] = 3.88
    error = raised(lambda: calib.Site(document))
    assert error.field == "/cameras/0/height_m" and error.camera == "door"
    assert 'expected {"value": ..., "fixed": true}' in str(error) and "column" not in str(error)
    document["cameras"][0]["height_m"] = {"value": "tall", "fixed": True}
    assert raised(lambda: calib.Site(document)).field == "/cameras/0/height_m/value"
    assert "line 2 column" in str(raised(lambda: calib.Site('{\n "format": 7}')))


@pytest.mark.parametrize(("name", "start", "what"), [
    ("tracks.csv", b"u,v\n1,2\n", "a table (CSV)"), ("still.png", b"\x89PNG\r\n\x1a\n", "a PNG image"), ("empty.json", b"", "empty"),
    ("tracks.parquet", b"PAR1\x15\x04", "a Parquet table"), ("still.jpg", b"\xff\xd8\xff\xe0", "a JPEG image"),
])
def test_another_file_type_opened_as_a_site_is_named(tmp_path: Path, name: str, start: bytes, what: str) -> None:
    (tmp_path / name).write_bytes(start)
    error = raised(lambda: calib.Site.open(tmp_path / name))
    assert f"{name} is {what}, expected a site file" in str(error) and error.field == "path"


def swapped(lines: list[list[tuple[float, float]]]) -> list[list[tuple[float, float]]]:
    return [[(v, u) for u, v in line] for line in lines]


@pytest.mark.parametrize("entry", [
    calib.camera_entry("door", (1080, 1920), LINES, height_m={"value": 2.9, "sigma": 0.02}),
    calib.camera_entry("door", (1920, 1080), [
        calib.vertical(swapped(VERTICAL)), calib.parallel(swapped(TILES)), calib.perpendicular(swapped(RIGHT_ANGLES)),
    ], height_m={"value": 2.9, "sigma": 0.02}),
])
def test_swapped_coordinates_are_reported(entry: dict[str, object]) -> None:
    findings = calib.Site(calib.site_document([entry])).calibrate().findings
    found = [finding for finding in findings if finding.message.startswith("Points outside the image")]
    assert len(found) == 1 and found[0].severity in ("warning", "error"), findings
    assert "5 of 16" in found[0].message and "With u and v swapped, all points would be inside" in found[0].message
    assert "swapped" in found[0].advice and "size_px" in found[0].advice
    assert not any("outside" in finding.message for finding in calib.Site(calib.site_document([door()])).calibrate().findings)


def test_an_undistorter_can_be_constructed_from_a_camera(site: calib.Site) -> None:
    camera = site.camera("camera-2", stream_size=(960, 540))
    image = np.random.default_rng(1).integers(0, 255, (540, 960, 3), dtype="u1")
    made = calib.Undistorter(camera, "all-valid")
    np.testing.assert_array_equal(made.apply(image), camera.undistorter("all-valid")(image))
    assert raised(lambda: calib.Undistorter(camera, "best")).field == "view"  # type: ignore[arg-type]


def test_the_covariance_of_a_box_equals_that_of_its_foot_point(camera: calib.Camera) -> None:
    boxes = np.array([[[900.0, 500.0, 1000.0, 800.0], [300.0, 400.0, 380.0, 950.0]]])
    feet = (boxes[..., 0] + boxes[..., 2]) / 2, boxes[..., 3]
    for options in [{}, {"sigma_px": 2.5, "height": 0.4, "stream_size": (960, 540)}]:
        found = camera.boxes_covariance(boxes, form="xyxy", **options)  # type: ignore[arg-type]
        for part, expected in zip(found, camera.floor_covariance(*feet, **options), strict=True):  # type: ignore[arg-type]
            assert part.shape == (1, 2, 2, 2)
            np.testing.assert_array_equal(part, expected)


def test_a_misfit_names_the_uprights_that_contradict_each_other() -> None:
    still = calib.Site(calib.site_document([calib.camera_entry("door", (1920, 1080), LINES[:2], height_m={"value": 2.9, "sigma": 0.02})]))
    camera = still.calibrate().camera("door")

    def person(x: float, y: float, height: float) -> dict[str, object]:
        foot, head = camera.to_pixel(x, y, 0.0)[:2], camera.to_pixel(x, y, height)[:2]
        return calib.upright(foot, head, 1.75, keep=True)

    def messages(*heights: float) -> list[str]:
        people = [person(x, y, height) for (x, y), height in zip([(-1, 4), (0, 5), (1, 4.5)], heights, strict=True)]
        site = calib.Site(calib.site_document([calib.camera_entry("door", (1920, 1080), [*LINES[:2], *people])]))
        return [found.message for found in site.calibrate().findings if found.code == "misfit"]

    assert messages(1.75, 1.75, 1.75) == []
    assert any(re.search(r"Uprights contradict each other: the camera height is .* m according to U2 .*, but .* m according to", said) for said in messages(1.75, 2.3, 1.75))
