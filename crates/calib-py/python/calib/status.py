"""Status of a mapped pixel or point."""

from enum import IntEnum


class Status(IntEnum):
    """Status of a mapped pixel or point. Arrays contain these numbers as uint8.

    With a result:
        OK: mapped; inside the effective field of view (EFOV), or, for world points, inside the image.
        OUTSIDE_EFOV: mapped, but outside the effective field of view.
        OUTSIDE_IMAGE: mapped, but outside the image, where detectors have no pixels.
    Without a result (NaN):
        ABOVE_HORIZON: the pixel shows no point of the plane.
        OUTSIDE_LENS: the pixel is outside the range of the lens model.
        BEHIND_CAMERA: the point is not in front of the camera.
        MISSING: a coordinate is missing or not finite.
        NO_CALIBRATION: the camera has no calibration at this time.
        ON_WALL: the pixel shows the wall of a pit, between its plane and the floor.
    """

    OK = 0
    ABOVE_HORIZON = 1
    OUTSIDE_EFOV = 2
    OUTSIDE_IMAGE = 3
    OUTSIDE_LENS = 4
    BEHIND_CAMERA = 5
    MISSING = 6
    NO_CALIBRATION = 7
    ON_WALL = 8

    @property
    def text(self) -> str:
        """Text of the status in tables, such as "above-horizon"."""
        return self.name.lower().replace("_", "-")
