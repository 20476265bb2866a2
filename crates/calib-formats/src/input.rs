//! Files of an import, with the options of the caller.

use std::ops::Deref;

use calib_core::WorldPoint;

use crate::file::{File, FormatError, Problem};
use crate::fisheye::Rotation;

/// Values that the caller states, because the imported files lack them or contain wrong ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// Width and height of the images, in pixels. They replace the size in the files.
    pub size: Option<[u32; 2]>,
    /// Length of the unit of the files, in metres; `None`: the usual unit of the format.
    pub unit_m: Option<f64>,
    /// Whether the world of the files is left-handed. Its y axis is mirrored.
    pub is_left_handed: bool,
}

/// Files of one import. There is at least one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Input<'a> {
    files: &'a [File],
    options: ImportOptions,
    /// Usual unit of the format, in metres. The reader of the format converts lengths from this unit to metres.
    usual_unit_m: f64,
}

impl<'a> Input<'a> {
    /// Combines files and options. `usual_unit_m` is the usual unit of the format, in metres. Without one the
    /// format has no poses, and options about poses fail.
    pub(crate) fn new(
        format: &str,
        usual_unit_m: Option<f64>,
        files: &'a [File],
        options: &ImportOptions,
    ) -> Result<Self, FormatError> {
        let changes_poses = options.unit_m.is_some() || options.is_left_handed;
        if changes_poses && usual_unit_m.is_none() {
            return Err(FormatError::new(format, Problem::NoPoses));
        }
        Ok(Self { files, options: *options, usual_unit_m: usual_unit_m.unwrap_or(1.0) })
    }

    /// Returns the stated size of the images.
    pub(crate) const fn size(&self) -> Option<[u32; 2]> {
        self.options.size
    }

    /// Returns the stated length of the unit, in metres.
    pub(crate) const fn unit_m(&self) -> Option<f64> {
        self.options.unit_m
    }

    /// Whether the caller states that the world is left-handed.
    pub(crate) const fn is_left_handed(&self) -> bool {
        self.options.is_left_handed
    }

    /// Corrects a pose `(R, t)` in metres for the stated unit, and for a left-handed world if it is stated.
    ///
    /// A left-handed world has the points `M X`, where M mirrors y. `R M X + t` is then behind the camera with
    /// correct pixels, so the camera has the pose `(-R M, -t)`. The determinant of `-R M` is 1.
    pub(crate) fn pose(&self, (rotation, t): (Rotation, [f64; 3])) -> (Rotation, [f64; 3]) {
        let scale = self.scale();
        if self.is_left_handed() {
            (rotation.map(|[x, y, z]| [-x, y, -z]), t.map(|t| -scale * t))
        } else {
            (rotation, t.map(|t| scale * t))
        }
    }

    /// Corrects a world point in metres for the stated unit, and for a left-handed world if it is stated.
    pub(crate) fn point(&self, WorldPoint { x, y, z }: WorldPoint) -> WorldPoint {
        let scale = self.scale();
        let side = if self.is_left_handed() { -scale } else { scale };
        WorldPoint::new(scale * x, side * y, scale * z)
    }

    /// Returns the ratio of the stated unit to the usual unit, by which lengths in metres are corrected; 1 if no unit
    /// is stated.
    fn scale(&self) -> f64 {
        self.unit_m().map_or(1.0, |unit| unit / self.usual_unit_m)
    }
}

impl Deref for Input<'_> {
    type Target = [File];

    fn deref(&self) -> &[File] {
        self.files
    }
}
