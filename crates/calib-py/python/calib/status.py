"""What became of a pixel or a point that was mapped."""

from enum import IntEnum


class Status(IntEnum):
    """What became of a pixel or a point that was mapped; arrays have these numbers as uint8.

    With a point (or a pixel):
        OK: mapped, inside the effective field of view or, of points of space, the image.
        OUTSIDE_EFOV: mapped, but outside the effective field of view.
        OUTSIDE_IMAGE: mapped, but outside the image: a pixel that no detector has seen.
    Without one, NaN:
        ABOVE_HORIZON: the pixel shows nothing of the plane.
        OUTSIDE_LENS: the lens shows nothing there.
        BEHIND_CAMERA: the point is not in front of the camera.
        MISSING: there was nothing to map: a coordinate is absent or not finite.
        NO_CALIBRATION: no calibration holds for it.
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
        """As it stands in tables: "above-horizon"."""
        return self.name.lower().replace("_", "-")
