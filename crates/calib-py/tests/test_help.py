"""What `help()` says of everything there is: how it is called, what each argument is, in which shapes and units."""

import inspect
import re
from collections.abc import Iterator

import pytest

import calib

UNITS = re.compile(r"pixels?|metres?|degrees|radians|uint8|seconds|RFC 3339")
#: What is told by words alone.
PLAIN = {
    "Camera.id", "Camera.origin", "Camera.fit", "Camera.scale_known", "Camera.distortion", "Finding.camera", "Finding.code",
    "Finding.severity", "Finding.message", "Finding.advice", "Site.cameras", "Site.findings", "Site.calibrate", "Site.to_json",
    "Site.to_dict", "Status.text", "Site.open",
}
#: Keywords that the class says once for all of its calls.
OF_PIXELS = {"origin", "stream_size", "fit", "crop"}


def everything() -> Iterator[tuple[str, object]]:
    """Every public class and function, and every public member of the classes."""
    for name in calib.__all__:
        thing = getattr(calib, name)
        if name.startswith("_") or inspect.isclass(thing) and issubclass(thing, Exception):
            continue
        yield name, thing
        if inspect.isclass(thing):
            members = (member for member in vars(thing) if not member.startswith("_"))
            yield from ((f"{name}.{member}", getattr(thing, member)) for member in members if name != "Status" or member == "text")


EVERYTHING = dict(everything())


def test_everything_is_walked() -> None:
    assert {"Undistorter", "Undistorter.apply", "Camera.to_floor", "Camera.scale_known", "camera_entry", "upright"} <= EVERYTHING.keys()
    assert PLAIN <= EVERYTHING.keys()


@pytest.mark.parametrize("name", EVERYTHING)
def test_help_says_what_it_is_in_units(name: str) -> None:
    text = inspect.getdoc(EVERYTHING[name]) or ""
    assert text.split("\n")[0], f"help(calib.{name}) says nothing"
    assert name in PLAIN or inspect.isclass(EVERYTHING[name]) or UNITS.search(text), f"help(calib.{name}) says no unit"


@pytest.mark.parametrize("name", [name for name, thing in EVERYTHING.items() if callable(thing) and name not in ("Finding", "Status", "Camera")])
def test_help_says_how_it_is_called_and_what_each_argument_is(name: str) -> None:
    thing = EVERYTHING[name]
    text = inspect.getdoc(thing) or ""
    for argument in inspect.signature(thing).parameters.values():  # type: ignore[arg-type]
        if argument.name != "self":
            assert re.search(rf"\b{argument.name}\b", text), f"help(calib.{name}) does not say what {argument.name} is"


def test_classes_that_calls_make_say_by_which() -> None:
    assert "Site.camera" in (calib.Camera.__doc__ or "")
    assert all(keyword in (calib.Camera.__doc__ or "") for keyword in OF_PIXELS)


@pytest.mark.parametrize(("name", "shape"), [
    ("Camera.to_floor", "shape of u and v"), ("Camera.boxes_to_floor", "(..., 4)"), ("Camera.floor_covariance", "(..., 2, 2)"),
    ("Camera.boxes_covariance", "(..., 2, 2)"), ("Camera.floor_jacobian", "(..., 2, 14)"), ("Camera.rays", "(..., 3)"),
    ("Camera.camera_matrix", "(3, 3)"), ("Camera.projection_matrix", "(3, 4)"), ("Camera.floor_from_pixel", "(3, 3)"),
    ("Camera.covariance", "(14, 14)"), ("Camera.efov", "(n, 2)"), ("Undistorter.apply", "(height, width, 3)"),
    ("vertical", "(segments, points, 2)"), ("straight", "(points, 2)"),
])
def test_help_says_the_shape(name: str, shape: str) -> None:
    assert shape in (inspect.getdoc(EVERYTHING[name]) or "")
