"""Calibrated cameras: pixels of detectors to metres on the floor, with their uncertainty, and the calibration itself.

    import calib

    site = calib.Site.open("solved.json")
    camera = site.camera("door", stream_size=(1280, 720))
    x, y, status = camera.boxes_to_floor(boxes, form="xyxy")   # metres; NaN where there is no floor
    pixel, calibration = camera.floor_covariance(u, v, sigma_px=2.0)

Axes, units and pixels are those of the site file: metres with z up and the floor at z = 0; pixels from the corner of the
image, x right and y down, unless origin="centre" is said. See `Site`, `Camera` and `Status`; `vertical`, `parallel` and
so on draw what a site is calibrated from.
"""

from calib._calib import CalibError, Camera, Finding, Site, Undistorter, __version__
from calib.entries import (
    camera_entry,
    equal_length,
    known_length,
    parallel,
    perpendicular,
    site_document,
    straight,
    upright,
    vertical,
)
from calib.status import Status

__all__ = [
    "CalibError",
    "Camera",
    "Finding",
    "Site",
    "Status",
    "Undistorter",
    "__version__",
    "camera_entry",
    "equal_length",
    "known_length",
    "parallel",
    "perpendicular",
    "site_document",
    "straight",
    "upright",
    "vertical",
]
