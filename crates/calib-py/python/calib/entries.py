"""Entries of a site document, for those who draw in Python: `Site` checks them."""

from __future__ import annotations

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


def _refused(field: str, what: str) -> CalibError:
    error = CalibError(f"{field}: {what}")
    error.field = field
    return error


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
    try:
        lines = list(segments)
    except TypeError:
        raise _refused("segments", f"found {segments!r}, expected a list of lines of two points or more") from None
    return {"kind": kind, "segments": [_points(line, origin, f"segments[{i}]", 2) for i, line in enumerate(lines)], **options}


def vertical(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Lines that are vertical in space: segments of two points (u, v) or more, shape (segments, points, 2).

    Options are those of the site file: id, name, sigma_px, off, keep and so on.
    """
    return _segments("vertical", segments, origin, options)


def parallel(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Lines of the floor, or level ones, of one direction; at_right_angles_to="id" ties two directions."""
    return _segments("parallel", segments, origin, options)


def perpendicular(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Lines of the floor: every one but the first is at right angles to the first."""
    return _segments("perpendicular", segments, origin, options)


def equal_length(segments: Any, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Segments of the floor of one length."""
    return _segments("equal_length", segments, origin, options)


def known_length(segments: Any, length_m: float, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Segments of the floor of this length, in metres."""
    return _segments("known_length", segments, origin, {"length_m": length_m, **options})


def straight(points: npt.ArrayLike, *, origin: Origin = "corner", **options: Any) -> Entry:
    """Points along an edge that is straight in space, three or more, shape (points, 2): they tell the lens."""
    return {"kind": "straight", "points": _points(points, origin, "points", 2), **options}


def upright(
    foot: npt.ArrayLike, head: npt.ArrayLike, height_m: float | None = None, *, origin: Origin = "corner", **options: Any
) -> Entry:
    """Something upright on the floor, by its foot and head (u, v); height_m in metres, or like="door"."""
    size = {} if height_m is None else {"height_m": {"value": height_m, "fixed": True}}
    ends = {"foot": _points(foot, origin, "foot", 1), "head": _points(head, origin, "head", 1)}
    return {"kind": "upright", **ends, **size, **options}


def camera_entry(
    id: str, size_px: Sequence[int], annotations: Iterable[Entry] = (), *,
    stream_size: Sequence[int] | None = None, fit: Fit | None = None, crop: Sequence[float] | None = None, **options: Any,
) -> Entry:
    """A camera with what is drawn on its still of (width, height) pixels.

    Options are those of the site file: lens, height_m, efov_px, placement, control_points and so on. Pixels of
    annotations, efov_px and control_points are of the still, unless stream_size, fit and crop say, as `Camera` does,
    that they were read off a stream of another size.
    """
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
    """A document for `Site`. Options are those of the site file: name, plan, links, marks, distances and so on."""
    return {"format": "calib-site", "version": 1, "cameras": list(cameras), **options}
