"""Calibrated cameras: map detector pixels to metres on the floor, with uncertainty, and calibrate.

    import calib

    site = calib.Site.open("solved.json")
    camera = site.camera("door", stream_size=(1280, 720))
    x, y, status = camera.boxes_to_floor(boxes, form="xyxy")   # metres; NaN without a floor point
    pixel, calibration = camera.floor_covariance(u, v, sigma_px=2.0)

Axes and units are the same as in the site file: metres, with z up and the floor at z = 0. Pixels count from the corner of
the image, x right and y down, unless origin="centre" is passed. See `Site`, `Camera` and `Status`. `vertical`, `parallel`
and so on create annotations for a calibration.
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
