//! Images of a stream without the bend of their lens.

use std::fmt;

use crate::camera::Pixel;
use crate::floor::camera_view::CameraView;
use crate::floor::remap::{Crop, Remap, Undistortion};

/// The undistortion of the images of a stream, prepared for many of them, with the pinhole that would make the same.
#[derive(Clone, Debug)]
pub struct StraightView {
    /// What makes the new image of a raw one.
    pub remap: Remap,
    /// Width and height of both, in pixels.
    pub size: [usize; 2],
    /// Focal of the new image, in pixels.
    pub focal: f64,
    /// Principal point of the new image, from its corner.
    pub principal_point: Pixel,
}

/// Why images of a stream cannot be undistorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoStraightView {
    /// The stream is stretched.
    Stretched,
    /// The crop is after the sides of the image, and no flat image holds one of them.
    Round,
    /// Its images are too small, or too large.
    Size,
}

impl fmt::Display for NoStraightView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stretched => {
                "a stretched stream has no one focal: undistort images in the proportion of the still"
            }
            Self::Round => {
                "no flat image holds all that this lens shows: expected the crop \"same-focal\", or a window"
            }
            Self::Size => "expected images of 2 x 2 to 1.4 gigapixels",
        })
    }
}

impl std::error::Error for NoStraightView {}

impl CameraView {
    /// Prepares the undistortion of the images of the stream.
    ///
    /// # Errors
    /// Where the stream is stretched, where no flat image holds what the crop asks for, and for images of fewer than 2 x 2 pixels, or of 1.4 gigapixels and more.
    pub fn straight_view(&self, crop: Crop) -> Result<StraightView, NoStraightView> {
        let (lens, size) = self.lens_in_stream().ok_or(NoStraightView::Stretched)?;
        let size @ [width, height] = size.map(|side| side as usize);
        let made = |crop| Undistortion::new(&lens, width, height, crop);
        let why = || made(Crop::SameFocal).map_or(NoStraightView::Size, |_| NoStraightView::Round);
        let made = made(crop).ok_or_else(why)?;
        let focal = made.focal(self.camera().focal / self.camera().lens.focal * lens.focal);
        Ok(StraightView { remap: made.remap(), size, focal, principal_point: made.principal_point() })
    }
}
