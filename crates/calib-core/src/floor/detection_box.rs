//! Boxes of detectors, and their foot points.

use std::ops::Range;

use crate::floor::stream::{PixelOrigin, named};

/// Meaning of the four numbers of a detection box.
///
/// The numbers are pixels of the stream, except for [`Self::Fractions`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BoxForm {
    /// Upper left corner, width and height.
    CornerSize,
    /// Upper left and lower right corner.
    Corners,
    /// Centre, width and height.
    CentreSize,
    /// Centre, width and height as fractions of the width and height of the stream, from 0 to 1.
    Fractions,
}

named! { BoxForm { CornerSize = "xywh", Corners = "xyxy", CentreSize = "cxcywh", Fractions = "yolo" } }

impl BoxForm {
    /// Returns the middle of the lower edge, which is the foot point of the object, in the units of the box.
    /// Returns NaN if the width or height is negative or NaN.
    #[inline]
    #[must_use]
    pub fn foot(self, [a, b, c, d]: [f64; 4]) -> [f64; 2] {
        let ([width, height], foot) = match self {
            Self::CornerSize => ([c, d], [a + 0.5 * c, b + d]),
            Self::Corners => ([c - a, d - b], [0.5 * (a + c), d]),
            Self::CentreSize | Self::Fractions => ([c, d], [a, b + 0.5 * d]),
        };
        if width >= 0.0 && height >= 0.0 { foot } else { [f64::NAN; 2] }
    }

    /// Returns x and y of the upper left corner, the width and the height of a box, in the units of the box.
    #[must_use]
    pub fn corner_and_size(self, [a, b, c, d]: [f64; 4]) -> [f64; 4] {
        match self {
            Self::CornerSize => [a, b, c, d],
            Self::Corners => [a, b, c - a, d - b],
            Self::CentreSize | Self::Fractions => [a - 0.5 * c, b - 0.5 * d, c, d],
        }
    }

    /// Calls `each` with the foot points (u, v) of boxes, in pixels of a stream of this `size` and `origin`, in
    /// chunks that fit into the fastest cache. The range contains the indices of the boxes of a chunk.
    pub(crate) fn each_foot(
        self,
        boxes: &[[f64; 4]],
        (size, origin): ([f64; 2], PixelOrigin),
        mut each: impl FnMut(Range<usize>, [&[f64]; 2]),
    ) {
        /// Number of boxes in a chunk.
        const CHUNK: usize = 512;
        let mut feet = [[0.0; CHUNK]; 2];
        // Fractions count from the corner of the image.
        let (scale, offset) = match self {
            Self::Fractions => (size, origin.offset()),
            Self::CornerSize | Self::Corners | Self::CentreSize => ([1.0; 2], 0.0),
        };
        for first in (0..boxes.len()).step_by(CHUNK) {
            let range = first..boxes.len().min(first + CHUNK);
            for (i, &one) in boxes[range.clone()].iter().enumerate() {
                let [u, v] = self.foot(one);
                [feet[0][i], feet[1][i]] = [u * scale[0] - offset, v * scale[1] - offset];
            }
            let feet = [&feet[0][..range.len()], &feet[1][..range.len()]];
            each(range, feet);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foot_is_the_same_in_every_box_form() {
        let feet = [
            BoxForm::CornerSize.foot([100.0, 200.0, 40.0, 120.0]),
            BoxForm::Corners.foot([100.0, 200.0, 140.0, 320.0]),
            BoxForm::CentreSize.foot([120.0, 260.0, 40.0, 120.0]),
        ];
        assert_eq!(feet, [[120.0, 320.0]; 3]);
        assert_eq!(BoxForm::Fractions.foot([0.25, 0.5, 0.125, 0.25]), [0.25, 0.625]);
    }

    #[test]
    fn corner_and_size_are_the_same_in_every_box_form() {
        let boxes = [
            BoxForm::CornerSize.corner_and_size([100.0, 200.0, 40.0, 120.0]),
            BoxForm::Corners.corner_and_size([100.0, 200.0, 140.0, 320.0]),
            BoxForm::CentreSize.corner_and_size([120.0, 260.0, 40.0, 120.0]),
        ];
        assert_eq!(boxes, [[100.0, 200.0, 40.0, 120.0]; 3]);
    }

    #[test]
    fn invalid_box_has_no_foot() {
        let is_nowhere = |[u, v]: [f64; 2]| u.is_nan() && v.is_nan();
        assert!(is_nowhere(BoxForm::Corners.foot([140.0, 320.0, 100.0, 200.0])));
        assert!(is_nowhere(BoxForm::CornerSize.foot([100.0, 200.0, -1.0, 120.0])));
        assert!(is_nowhere(BoxForm::CentreSize.foot([100.0, 200.0, 10.0, f64::NAN])));
    }
}
