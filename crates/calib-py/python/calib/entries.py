"""Entries of a site document, for those who draw in Python: `Site` checks them."""

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

#: What holds pixels of an entry.
_PIXELS = ("segments", "points", "foot", "head", "px", "efov_px")


#: What may be said of a camera, and of what is drawn, beside the arguments of the functions here.
_OF_CAMERA = (
    "name", "image", "lens", "height_m", "sigma_px", "scene", "efov_px", "efov_plane", "placement", "control_points",
    "valid_from", "valid_to", "solution", "error",
)
_OF_ANNOTATION = (
    "id", "name", "off", "keep", "at_right_angles_to", "length_m", "height_m", "plane", "like", "sigma_px", "angle_sigma_deg",
    "length_sigma_rel", "exact",
)
_OF_SITE = ("name", "plan", "links", "marks", "distances", "georeference", "scene", "planes", "solution")
#: Options that are values with their certainty, and a sigma as an example.
_KNOWN = {"height_m": 0.05, "focal_px": 15.0, "roll_deg": 0.5, "pitch_deg": 0.5}


def _refused(field: str, what: str) -> CalibError:
    error = CalibError(f"{field}: {what}")
    error.field = field
    return error


def _check(options: Entry, names: tuple[str, ...]) -> None:
    """Refuses keywords that the site file has no field for, with the one that was meant."""
    for name in options:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            meant = f"did you mean {near[0]}?" if near else f"expected {', '.join(names)}"
            raise _refused(name, f"unexpected keyword; {meant}")


def _known(entry: Entry) -> None:
    """Refuses plain numbers where the site file has a value with its certainty."""
    for name, value in entry.items():
        if name in _KNOWN and isinstance(value, (int, float)):
            like = f'{{"value": {value}, "sigma": {_KNOWN[name]}}}'
            raise _refused(name, f'found {value}, expected how sure it is, too: {like}, or {{"value": {value}, "fixed": True}}')


def _points(points: Any, origin: Origin, what: str, dimensions: int) -> Any:
    """Pixels as lists, counted from the corner of the image."""
    try:
        array = np.asarray(points, dtype=float)
    except (TypeError, ValueError) as why:
        raise _refused(what, f"expected numbers: {why}") from None
    if array.ndim != dimensions or array.shape[-1] != 2:
        expected = "(n, 2)" if dimensions == 2 else "(2,)"
        raise _refused(what, f"found the shape {array.shape}, expected {expected}: u, v in pixels")
    if origin not in ("corner", "centre"):
        raise _refused("origin", f'found {origin!r}, expected "corner" or "centre"')
    return (array + (0.5 if origin == "centre" else 0.0)).tolist()


def _segments(kind: str, segments: Any, origin: Origin, options: Entry) -> Entry:
    _check(options, _OF_ANNOTATION)
    try:
        lines = list(segments)
    except TypeError:
        raise _refused("segments", f"found {segments!r}, expected a list of lines of two points or more") from None
    return {"kind": kind, "segments": [_points(line, origin, f"segments[{i}]", 2) for i, line in enumerate(lines)], **options}


def vertical(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Lines that are vertical in space, such as door frames and corners of walls: they tell pitch and roll.

    Args:
        segments: shape (segments, points, 2): lines of two points (u, v) or more, in pixels.
        origin: "corner", or "centre" where pixels count from the centre of the first one, as OpenCV's do.
        options: of the site file: id, name, off, keep, sigma_px, exact and so on.
    """
    return _segments("vertical", segments, origin, options)


def parallel(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Lines of the floor, or level ones above it, of one direction, such as kerbs and rows of tiles.

    Args:
        segments: shape (segments, points, 2): lines of two points (u, v) or more, in pixels.
        origin: "corner" or "centre": where pixels count from.
        options: as for `vertical`; at_right_angles_to="id" ties the direction to that of another annotation.
    """
    return _segments("parallel", segments, origin, options)


def perpendicular(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Lines of the floor: every one but the first is at right angles to the first.

    Args:
        segments: shape (segments, points, 2): lines of two points (u, v) or more, in pixels.
        origin: "corner" or "centre": where pixels count from.
        options: as for `vertical`.
    """
    return _segments("perpendicular", segments, origin, options)


def equal_length(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Segments of the floor of one length, which need not be known.

    Args:
        segments: shape (segments, points, 2), in pixels; a length counts from the first point to the last.
        origin: "corner" or "centre": where pixels count from.
        options: as for `vertical`.
    """
    return _segments("equal_length", segments, origin, options)


def known_length(segments: Any, length_m: float, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Segments of the floor of a known length: they tell the scale.

    Args:
        segments: shape (segments, points, 2), in pixels; a length counts from the first point to the last.
        length_m: of every one, in metres.
        origin: "corner" or "centre": where pixels count from.
        options: as for `vertical`.
    """
    return _segments("known_length", segments, origin, {"length_m": length_m, **options})


def straight(points: npt.ArrayLike, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Points along an edge that is straight in space: they tell the lens.

    Args:
        points: shape (points, 2): three or more (u, v), in pixels.
        origin: "corner" or "centre": where pixels count from.
        options: as for `vertical`.
    """
    _check(options, _OF_ANNOTATION)
    return {"kind": "straight", "points": _points(points, origin, "points", 2), **options}


def upright(
    foot: npt.ArrayLike, head: npt.ArrayLike, height_m: Any = None, *, origin: Origin = "corner", **options: Any
) -> Entry:
    """Something upright on the floor, such as a door or a person: its height tells the scale.

    Args:
        foot, head: (u, v), in pixels.
        height_m: in metres, held; or {"value": 1.75, "sigma": 0.07}.
        origin: "corner" or "centre": where pixels count from.
        options: as for `vertical`; like="door" or "person" in place of a height takes what is usual.
    """
    _check(options, _OF_ANNOTATION)
    size = {} if height_m is None else {"height_m": height_m if isinstance(height_m, dict) else {"value": height_m, "fixed": True}}
    ends = {"foot": _points(foot, origin, "foot", 1), "head": _points(head, origin, "head", 1)}
    return {"kind": "upright", **ends, **size, **options}


def camera_entry(
    id: str, size_px: Sequence[int], annotations: Iterable[Entry] = (), *,
    stream_size: Sequence[int] | None = None, fit: Fit | None = None, crop: Sequence[float] | None = None, **options: Any,
) -> Entry:
    """A camera with what is drawn on its still.

    Args:
        id: by which others refer to it.
        size_px: (width, height) of the still, in pixels.
        annotations: what `vertical`, `parallel` and so on make; pixels are of the still, as those of efov_px and
            control_points are,
        stream_size, fit, crop: unless these say, as `Camera` does, that they were read off a stream of another size.
        options: of the site file: height_m={"value": 2.9, "sigma": 0.02} (metres), lens={"focal_px": {"value": 1400,
            "sigma": 30}}, efov_px (shape (n, 2), pixels), placement={"move_m": (x, y), "turn_deg": 30},
            control_points=[{"px": (u, v), "world_m": (x, y, z)}], valid_from (RFC 3339) and so on.
    """
    _check(options, _OF_CAMERA)
    _known(options)
    _known(options["lens"] if isinstance(options.get("lens"), dict) else {})
    if not hasattr(size_px, "__len__"):
        raise _refused("size_px", f"found {size_px!r}, expected (width, height)")
    if len(size_px) != 2:
        raise _refused("size_px", f"found {tuple(size_px)}, expected (width, height); an image of NumPy has the shape (height, width, ...)")
    if isinstance(annotations, dict):
        raise _refused("annotations", "found one, expected a list of them: put [ ] around it")
    entry: Entry = {"id": id, "size_px": list(size_px), "annotations": list(annotations), **options}
    stream = {"stream_size": stream_size, "fit": fit, "crop": crop}
    if all(value is None for value in stream.values()):
        return entry
    width, height = size_px

    def in_still(value: Any, name: str) -> Any:
        if name == "segments":
            return [in_still(line, "points") for line in value]
        pixels = np.asarray(value, dtype=float)
        return np.stack(to_still(pixels[..., 0], pixels[..., 1], (width, height), **stream), axis=-1).tolist()  # type: ignore[arg-type]

    def of_still(part: Entry) -> Entry:
        return {name: in_still(value, name) if name in _PIXELS else value for name, value in part.items()}

    for name in {"annotations", "control_points"} & entry.keys():
        entry[name] = [of_still(part) for part in entry[name]]
    return of_still(entry)


def site_document(cameras: Iterable[Entry], **options: Any) -> Entry:
    """A document for `Site`.

    Args:
        cameras: what `camera_entry` makes.
        options: of the site file: name, plan={"image": "plan.png", "metres_per_px": 0.02, "origin_px": (x, y)}, links, marks,
            distances and so on; metres, degrees and pixels, as the names of their fields say.
    """
    if isinstance(cameras, dict):
        raise _refused("cameras", "found one, expected a list of them: put [ ] around it")
    _check(options, _OF_SITE)
    return {"format": "calib-site", "version": 1, "cameras": list(cameras), **options}
