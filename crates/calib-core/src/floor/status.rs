//! What became of a pixel or a point that was mapped.

/// What became of a pixel or a point that was mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Status {
    /// Mapped, inside the EFOV or the image.
    Ok,
    /// The pixel shows nothing of the plane: there is no point.
    AboveHorizon,
    /// Mapped, but outside the effective field of view.
    OutsideEfov,
    /// Mapped, but outside the image.
    OutsideImage,
    /// The lens shows nothing there: there is no point, or no pixel.
    OutsideLens,
    /// The point is not in front of the camera: there is no pixel.
    BehindCamera,
    /// There was nothing to map: a coordinate is absent or not finite.
    Missing,
    /// No calibration holds for it.
    NoCalibration,
    /// The pixel shows the wall of a pit, between its plane and the floor: there is no point.
    OnWall,
}

impl Status {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 9] = [
        Self::Ok,
        Self::AboveHorizon,
        Self::OutsideEfov,
        Self::OutsideImage,
        Self::OutsideLens,
        Self::BehindCamera,
        Self::Missing,
        Self::NoCalibration,
        Self::OnWall,
    ];

    /// The one of this number.
    #[must_use]
    pub fn of_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// As it stands in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::AboveHorizon => "above-horizon",
            Self::OutsideEfov => "outside-efov",
            Self::OutsideImage => "outside-image",
            Self::OutsideLens => "outside-lens",
            Self::BehindCamera => "behind-camera",
            Self::Missing => "missing",
            Self::NoCalibration => "no-calibration",
            Self::OnWall => "on-wall",
        }
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_places_in_the_list() {
        for (code, status) in (0..).zip(Status::ALL) {
            assert_eq!((status as u8, Status::of_code(code)), (code, Some(status)));
        }
        assert_eq!(Status::of_code(Status::ALL.len() as u8), None);
    }
}
