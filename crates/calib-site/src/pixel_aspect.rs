//! Pixel aspect of a camera in the site file, and the image sizes of recorders whose pixels are not square.
//!
//! The pixel aspect is the width of a pixel over its height, which is the ratio `fy / fx` of the focal
//! lengths. An image of w x h pixels that is shown with the ratio `D` of width to height has the pixel aspect
//! `D h / w`.

/// Image sizes of recorders whose pixels are usually not square, with the ratio of width to height with which
/// the image is shown.
const CODED_SIZES: [([u32; 2], f64); 12] = [
    ([960, 1080], WIDE_SCREEN),
    ([1280, 1440], WIDE_SCREEN),
    ([960, 576], OLD_SCREEN),
    ([960, 480], OLD_SCREEN),
    ([720, 576], OLD_SCREEN),
    ([720, 480], OLD_SCREEN),
    ([704, 576], OLD_SCREEN),
    ([704, 480], OLD_SCREEN),
    ([704, 288], OLD_SCREEN),
    ([704, 240], OLD_SCREEN),
    ([352, 288], OLD_SCREEN),
    ([352, 240], OLD_SCREEN),
];

/// Ratio of width to height of a 16:9 image.
const WIDE_SCREEN: f64 = 16.0 / 9.0;
/// Ratio of width to height of a 4:3 image.
const OLD_SCREEN: f64 = 4.0 / 3.0;

/// Returns the usual pixel aspect of images of this size, if recorders code images of this size with pixels
/// that are not square.
#[must_use]
pub fn usual_pixel_aspect(size: [u32; 2]) -> Option<f64> {
    let (_, shown) = CODED_SIZES.iter().find(|(coded, _)| *coded == size)?;
    Some(shown * f64::from(size[1]) / f64::from(size[0]))
}

/// Pixel aspect of square pixels: the default in files.
pub(crate) const fn square() -> f64 {
    1.0
}

/// Whether pixels of this aspect are square.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
pub(crate) const fn is_square(aspect: &f64) -> bool {
    *aspect == 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coded_sizes_have_the_aspects_of_their_standards() {
        let of = |size| usual_pixel_aspect(size).unwrap();
        assert!((of([960, 1080]) - 2.0).abs() < 1e-12);
        assert!((of([704, 576]) - 12.0 / 11.0).abs() < 1e-12 && (of([352, 288]) - 12.0 / 11.0).abs() < 1e-12);
        assert!((of([704, 240]) - 5.0 / 11.0).abs() < 1e-12 && (of([720, 480]) - 8.0 / 9.0).abs() < 1e-12);
        assert_eq!([[1920, 1080], [640, 480], [768, 576]].map(usual_pixel_aspect), [None; 3]);
    }
}
