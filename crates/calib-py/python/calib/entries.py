"""Functions that create the entries of a site document. `Site` checks them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from calib._calib import CalibError, to_still

Entry = dict[str, Any]
Origin = Literal["corner", "centre"]
Fit = Literal["stretch", "letterbox"]

#: Keys with pixel coordinates.
_PIXELS = ("segments", "points", "foot", "head", "px", "efov_px")


#: Keys of the site file that are allowed as options, besides the arguments of the functions.
_CAMERA_KEYS = (
    "name", "image", "lens", "height_m", "sigma_px", "scene", "efov_px", "efov_plane", "placement", "control_points",
    "valid_from", "valid_to", "solution", "error",
)
_ANNOTATION_KEYS = (
    "id", "name", "off", "keep", "at_right_angles_to", "length_m", "height_m", "plane", "like", "sigma_px", "angle_sigma_deg",
    "length_sigma_rel", "exact",
)
_SITE_KEYS = (
    "name", "units", "plan", "links", "marks", "distances", "georeference", "crs", "scene", "planes", "walls", "areas", "level_px_per_m", "measurements", "ground_points", "solution",
)
#: Options with a standard deviation, and an example of one.
_UNCERTAIN = {"height_m": 0.05, "focal_px": 15.0, "roll_deg": 0.5, "pitch_deg": 0.5}


def _error(field: str, what: str) -> CalibError:
    error = CalibError(f"{field}: {what}")
    error.field = field
    return error


def _check(options: Entry, names: tuple[str, ...]) -> None:
    """Rejects keywords that are not fields of the site file, and suggests a similar one."""
    for name in options:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            meant = f"did you mean {near[0]}?" if near else f"expected {', '.join(names)}"
            raise _error(name, f"unexpected keyword; {meant}")


def _check_uncertain(entry: Entry) -> None:
    """Rejects plain numbers for values that need a standard deviation."""
    for name, value in entry.items():
        if name in _UNCERTAIN and isinstance(value, (int, float)):
            like = f'{{"value": {value}, "sigma": {_UNCERTAIN[name]}}}'
            raise _error(name, f'found {value} without a standard deviation, expected {like}, or {{"value": {value}, "fixed": True}}')


def _points(points: Any, origin: Origin, what: str, dimensions: int) -> Any:
    """Returns pixels as lists, counted from the corner of the image."""
    try:
        array = np.asarray(points, dtype=float)
    except (TypeError, ValueError) as why:
        raise _error(what, f"expected numbers: {why}") from None
    if array.ndim != dimensions or array.shape[-1] != 2:
        expected = "(n, 2)" if dimensions == 2 else "(2,)"
        raise _error(what, f"found the shape {array.shape}, expected {expected}: u, v in pixels")
    if origin not in ("corner", "centre"):
        raise _error("origin", f'found {origin!r}, expected "corner" or "centre"')
    return (array + (0.5 if origin == "centre" else 0.0)).tolist()


def _segments(kind: str, segments: Any, origin: Origin, options: Entry) -> Entry:
    _check(options, _ANNOTATION_KEYS)
    try:
        lines = list(segments)
    except TypeError:
        raise _error("segments", f"found {segments!r}, expected a list of lines of two points or more") from None
    return {"kind": kind, "segments": [_points(line, origin, f"segments[{i}]", 2) for i, line in enumerate(lines)], **options}


def vertical(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Annotates vertical lines, such as door frames and corners of walls. They determine pitch and roll.

    Args:
        segments: shape (segments, points, 2): lines of two or more points (u, v), in pixels.
        origin: "corner", or "centre" if pixels count from the centre of the first pixel, as in OpenCV.
        options: further fields of the site file: id, name, off, keep, sigma_px, exact and so on.
    """
    return _segments("vertical", segments, origin, options)


def parallel(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Annotates parallel lines on the floor, or level lines above it, such as kerbs and rows of tiles.

    Args:
        segments: shape (segments, points, 2): lines of two or more points (u, v), in pixels.
        origin: pixel origin, "corner" or "centre".
        options: as for `vertical`; at_right_angles_to="id" states a right angle to the direction of another annotation.
    """
    return _segments("parallel", segments, origin, options)


def perpendicular(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Annotates perpendicular lines on the floor: each line is at right angles to the first one.

    Args:
        segments: shape (segments, points, 2): lines of two or more points (u, v), in pixels.
        origin: pixel origin, "corner" or "centre".
        options: as for `vertical`.
    """
    return _segments("perpendicular", segments, origin, options)


def equal_length(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Annotates segments on the floor with the same unknown length.

    Args:
        segments: shape (segments, points, 2), in pixels; the length is measured from the first to the last point.
        origin: pixel origin, "corner" or "centre".
        options: as for `vertical`.
    """
    return _segments("equal_length", segments, origin, options)


def known_length(segments: Any, length_m: float, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Annotates segments on the floor with a known length. They determine the scale.

    Args:
        segments: shape (segments, points, 2), in pixels; the length is measured from the first to the last point.
        length_m: length of each segment, in metres.
        origin: pixel origin, "corner" or "centre".
        options: as for `vertical`.
    """
    return _segments("known_length", segments, origin, {"length_m": length_m, **options})


def straight(points: npt.ArrayLike, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Annotates points along a straight edge. They determine the distortion of the lens.

    Args:
        points: shape (points, 2): three or more (u, v), in pixels.
        origin: pixel origin, "corner" or "centre".
        options: as for `vertical`.
    """
    _check(options, _ANNOTATION_KEYS)
    return {"kind": "straight", "points": _points(points, origin, "points", 2), **options}


def upright(
    foot: npt.ArrayLike, head: npt.ArrayLike, height_m: Any = None, *, origin: Origin = "corner", **options: Any
) -> Entry:
    """Annotates an upright object on the floor, such as a door or a person. Its height determines the scale.

    Args:
        foot, head: (u, v), in pixels.
        height_m: exact height in metres, or {"value": 1.75, "sigma": 0.07}.
        origin: pixel origin, "corner" or "centre".
        options: as for `vertical`; like="door" or like="person" uses the usual height.
    """
    _check(options, _ANNOTATION_KEYS)
    size = {} if height_m is None else {"height_m": height_m if isinstance(height_m, dict) else {"value": height_m, "fixed": True}}
    ends = {"foot": _points(foot, origin, "foot", 1), "head": _points(head, origin, "head", 1)}
    return {"kind": "upright", **ends, **size, **options}


def camera_entry(
    id: str, size_px: Sequence[int], annotations: Iterable[Entry] = (), *,
    stream_size: Sequence[int] | None = None, fit: Fit | None = None, crop: Sequence[float] | None = None, **options: Any,
) -> Entry:
    """Creates a camera with its annotations.

    Args:
        id: unique name of the camera.
        size_px: (width, height) of the camera's image, in pixels.
        annotations: annotations from `vertical`, `parallel` and so on. Their pixels, and those of efov_px and
            control_points, refer to the camera's image by default.
        stream_size, fit, crop: kind of all pixels if they were measured on a stream of another size, see `Camera`.
        options: further fields of the site file: height_m={"value": 2.9, "sigma": 0.02} (metres), lens={"focal_px":
            {"value": 1400, "sigma": 30}}, efov_px (shape (n, 2), pixels), placement={"move_m": (x, y), "turn_deg": 30},
            control_points=[{"px": (u, v), "world_m": (x, y, z)}], valid_from (RFC 3339) and so on.
    """
    _check(options, _CAMERA_KEYS)
    _check_uncertain(options)
    _check_uncertain(options["lens"] if isinstance(options.get("lens"), dict) else {})
    if not hasattr(size_px, "__len__"):
        raise _error("size_px", f"found {size_px!r}, expected (width, height)")
    if len(size_px) != 2:
        raise _error("size_px", f"found {tuple(size_px)}, expected (width, height); the shape of a NumPy image is (height, width, ...)")
    if isinstance(annotations, dict):
        raise _error("annotations", "found a single entry, expected a list; put [ ] around it")
    entry: Entry = {"id": id, "size_px": list(size_px), "annotations": list(annotations), **options}
    stream = {"stream_size": stream_size, "fit": fit, "crop": crop}
    if all(value is None for value in stream.values()):
        return entry
    width, height = size_px

    def in_image(value: Any, name: str) -> Any:
        if name == "segments":
            return [in_image(line, "points") for line in value]
        pixels = np.asarray(value, dtype=float)
        return np.stack(to_still(pixels[..., 0], pixels[..., 1], (width, height), **stream), axis=-1).tolist()  # type: ignore[arg-type]

    def entry_in_image(part: Entry) -> Entry:
        return {name: in_image(value, name) if name in _PIXELS else value for name, value in part.items()}

    for name in {"annotations", "control_points"} & entry.keys():
        entry[name] = [entry_in_image(part) for part in entry[name]]
    return entry_in_image(entry)


def site_document(cameras: Iterable[Entry], **options: Any) -> Entry:
    """Creates a document for `Site`.

    Args:
        cameras: cameras from `camera_entry`.
        options: further fields of the site file: name, plan={"image": "plan.png", "metres_per_px": 0.02,
            "origin_px": (x, y)}, links, marks, distances and so on. Units are metres, degrees and pixels, as in the
            names of the fields.
    """
    if isinstance(cameras, dict):
        raise _error("cameras", "found a single entry, expected a list; put [ ] around it")
    _check(options, _SITE_KEYS)
    return {"format": "calib-site", "version": 1, "cameras": list(cameras), **options}
