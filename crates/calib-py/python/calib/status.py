"""What became of a pixel or a point that was mapped."""

from enum import IntEnum


class Status(IntEnum):
    """What became of a pixel or a point that was mapped; arrays have these numbers as uint8."""

    OK = 0
    """Mapped, inside the EFOV or the image."""
    ABOVE_HORIZON = 1
    """The pixel shows nothing of the plane: there is no point."""
    OUTSIDE_EFOV = 2
    """Mapped, but outside the effective field of view."""
    OUTSIDE_IMAGE = 3
    """Mapped, but outside the image."""
    OUTSIDE_LENS = 4
    """The lens shows nothing there: there is no point, or no pixel."""
    BEHIND_CAMERA = 5
    """The point is not in front of the camera: there is no pixel."""
    MISSING = 6
    """There was nothing to map: a coordinate is absent or not finite."""
    NO_CALIBRATION = 7
    """No calibration holds for it."""
    ON_WALL = 8
    """The pixel shows the wall of a pit, between its plane and the floor: there is no point."""

    @property
    def text(self) -> str:
        """As it stands in tables: "above-horizon"."""
        return self.name.lower().replace("_", "-")
