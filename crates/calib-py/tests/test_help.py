"""Completeness of the docstrings: signatures, arguments, shapes and units of the whole public interface."""

import inspect
import re
from collections.abc import Iterator

import pytest

import calib

UNITS = re.compile(r"pixels?|metres?|degrees|radians|uint8|seconds|RFC 3339")
#: Members without a unit.
UNITLESS = {
    "Camera.id", "Camera.origin", "Camera.fit", "Camera.scale_known", "Camera.distortion", "Finding.camera", "Finding.code",
    "Finding.severity", "Finding.message", "Finding.advice", "Site.cameras", "Site.findings", "Site.calibrate", "Site.to_json",
    "Site.to_dict", "Status.text", "Site.open",
}
#: Keywords that the class documents once for all methods.
PIXEL_KEYWORDS = {"origin", "stream_size", "fit", "crop"}


def public_items() -> Iterator[tuple[str, object]]:
    """Returns every public class and function, and every public member of the classes."""
    for name in calib.__all__:
        item = getattr(calib, name)
        if name.startswith("_") or inspect.isclass(item) and issubclass(item, Exception):
            continue
        yield name, item
        if inspect.isclass(item):
            members = (member for member in vars(item) if not member.startswith("_"))
            yield from ((f"{name}.{member}", getattr(item, member)) for member in members if name != "Status" or member == "text")


PUBLIC_ITEMS = dict(public_items())


def test_all_public_items_are_found() -> None:
    assert {"Undistorter", "Undistorter.apply", "Camera.to_floor", "Camera.scale_known", "camera_entry", "upright"} <= PUBLIC_ITEMS.keys()
    assert UNITLESS <= PUBLIC_ITEMS.keys()


@pytest.mark.parametrize("name", PUBLIC_ITEMS)
def test_docstrings_contain_a_summary_and_units(name: str) -> None:
    text = inspect.getdoc(PUBLIC_ITEMS[name]) or ""
    assert text.split("\n")[0], f"help(calib.{name}) is empty"
    assert name in UNITLESS or inspect.isclass(PUBLIC_ITEMS[name]) or UNITS.search(text), f"help(calib.{name}) contains no unit"


@pytest.mark.parametrize("name", [name for name, item in PUBLIC_ITEMS.items() if callable(item) and name not in ("Finding", "Status", "Camera")])
def test_docstrings_describe_each_argument(name: str) -> None:
    item = PUBLIC_ITEMS[name]
    text = inspect.getdoc(item) or ""
    for argument in inspect.signature(item).parameters.values():  # type: ignore[arg-type]
        if argument.name != "self":
            assert re.search(rf"\b{argument.name}\b", text), f"help(calib.{name}) does not describe {argument.name}"


def test_camera_docstring_names_its_constructor_and_keywords() -> None:
    assert "Site.camera" in (calib.Camera.__doc__ or "")
    assert all(keyword in (calib.Camera.__doc__ or "") for keyword in PIXEL_KEYWORDS)


@pytest.mark.parametrize(("name", "shape"), [
    ("Camera.to_floor", "shape of u and v"), ("Camera.boxes_to_floor", "(..., 4)"), ("Camera.floor_covariance", "(..., 2, 2)"),
    ("Camera.boxes_covariance", "(..., 2, 2)"), ("Camera.floor_jacobian", "(..., 2, 15)"), ("Camera.rays", "(..., 3)"),
    ("Camera.camera_matrix", "(3, 3)"), ("Camera.projection_matrix", "(3, 4)"), ("Camera.floor_from_pixel", "(3, 3)"),
    ("Camera.covariance", "(15, 15)"), ("Camera.efov", "(n, 2)"), ("Undistorter.apply", "(height, width, 3)"),
    ("vertical", "(segments, points, 2)"), ("straight", "(points, 2)"),
])
def test_docstrings_contain_the_shape(name: str, shape: str) -> None:
    assert shape in (inspect.getdoc(PUBLIC_ITEMS[name]) or "")
