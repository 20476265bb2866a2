"""Entries of a site document, for those who draw in Python: `Site` checks them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

Entry = dict[str, Any]
Origin = Literal["corner", "centre"]


def _points(points: npt.ArrayLike, origin: Origin, what: str, dimensions: int) -> Any:
    """Pixels as lists, counted from the corner of the image."""
    array = np.asarray(points, dtype=float)
    if array.ndim != dimensions or array.shape[-1] != 2:
        expected = "(n, 2)" if dimensions == 2 else "(2,)" if dimensions == 1 else "(segments, points, 2)"
        raise ValueError(f"{what}: found the shape {array.shape}, expected {expected} pixels")
    if origin not in ("corner", "centre"):
        raise ValueError(f'origin: found {origin!r}, expected "corner" or "centre"')
    return (array + (0.5 if origin == "centre" else 0.0)).tolist()


def _segments(kind: str, segments: npt.ArrayLike | Sequence[npt.ArrayLike], origin: Origin, options: Entry) -> Entry:
    lines = [_points(line, origin, f"a segment of {kind}", 2) for line in np.asarray(segments, dtype=object)] \
        if _is_ragged(segments) else _points(np.asarray(segments, dtype=float), origin, f"segments of {kind}", 3)
    return {"kind": kind, "segments": lines, **options}


def _is_ragged(segments: Any) -> bool:
    lengths = {len(line) for line in segments}
    return len(lengths) > 1


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
    return {"kind": "straight", "points": _points(points, origin, "straight", 2), **options}


def upright(
    foot: npt.ArrayLike, head: npt.ArrayLike, height_m: float | None = None, *, origin: Origin = "corner", **options: Any
) -> Entry:
    """Something upright on the floor, by its foot and head (u, v); height_m in metres, or like="door"."""
    size = {} if height_m is None else {"height_m": {"value": height_m, "fixed": True}}
    ends = {"foot": _points(foot, origin, "foot", 1), "head": _points(head, origin, "head", 1)}
    return {"kind": "upright", **ends, **size, **options}


def camera_entry(id: str, size_px: tuple[int, int], annotations: Iterable[Entry] = (), **options: Any) -> Entry:
    """A camera with what is drawn on its still of (width, height) pixels.

    Options are those of the site file: lens, height_m, efov_px, placement, control_points and so on.
    """
    return {"id": id, "size_px": list(size_px), "annotations": list(annotations), **options}


def site_document(cameras: Iterable[Entry], **options: Any) -> Entry:
    """A document for `Site`. Options are those of the site file: name, plan, links, marks, distances and so on."""
    return {"format": "calib-site", "version": 1, "cameras": list(cameras), **options}
