//! Median of several images of an unchanged camera: objects that move disappear.

use image::RgbImage;

/// Share of the images, 0 to 1. A pixel is busy if moving objects cover it in at least this share.
const BUSY: f64 = 1.0 / 3.0;

/// Image of a scene without the objects that move.
#[derive(Clone, Debug)]
pub struct EmptyScene {
    /// Median of every colour of every pixel.
    pub image: RgbImage,
    /// Whether a moving object covered each pixel in at least one image, row by row.
    pub changed: Vec<bool>,
    /// Share of the pixels, 0 to 1, that moving objects covered in at least one image.
    pub changed_share: f64,
    /// Share of the pixels, 0 to 1, that moving objects covered in at least a third of the images. The median may show
    /// parts of the objects there.
    pub busy_share: f64,
}

impl EmptyScene {
    /// Value of `busy_share` above which the operator is warned about objects that hardly moved.
    pub const MAX_BUSY_SHARE: f64 = 0.01;

    /// Computes the median of images of one size. Without images, the result has no pixels.
    ///
    /// # Panics
    /// If the sizes of the images differ.
    #[must_use]
    pub fn new(images: &[RgbImage]) -> Self {
        let sizes: Vec<_> = images.iter().map(RgbImage::dimensions).collect();
        assert!(sizes.windows(2).all(|pair| pair[0] == pair[1]), "images of one size");
        let image = median(images);
        let counts = covered_counts(images, &image);
        let share = |least: f64| {
            let covered = counts.iter().filter(|count| f64::from(**count) >= least).count();
            covered as f64 / counts.len().max(1) as f64
        };
        let [changed_share, busy_share] = [share(1.0), share((BUSY * images.len() as f64).max(1.0))];
        Self { image, changed: counts.iter().map(|count| *count > 0).collect(), changed_share, busy_share }
    }
}

/// Returns the median of images of one size, for every colour of every pixel.
fn median(images: &[RgbImage]) -> RgbImage {
    let Some(first) = images.first() else { return RgbImage::new(0, 0) };
    let mut values = vec![0; images.len()];
    let mut result = first.clone();
    for (index, value) in result.iter_mut().enumerate() {
        values.iter_mut().zip(images).for_each(|(one, image)| *one = image.as_raw()[index]);
        let (_, middle, _) = values.select_nth_unstable(images.len() / 2);
        *value = *middle;
    }
    result
}

/// Returns the number of images in which each pixel differs from the median.
fn covered_counts(images: &[RgbImage], median: &RgbImage) -> Vec<u32> {
    /// Smallest difference of a colour that is not noise, 0 to 255.
    const MIN_DIFFERENCE: u8 = 30;
    let mut counts = vec![0; median.as_raw().len() / 3];
    for image in images {
        let pixels = image.as_raw().chunks_exact(3).zip(median.as_raw().chunks_exact(3));
        for (count, (own, usual)) in counts.iter_mut().zip(pixels) {
            let differs = own.iter().zip(usual).any(|(a, b)| a.abs_diff(*b) >= MIN_DIFFERENCE);
            *count += u32::from(differs);
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn objects_that_move_disappear() {
        let frame = |at: u32| {
            RgbImage::from_fn(40, 20, |x, y| match x.abs_diff(at) {
                0..3 => Rgb([250, 10, 10]),
                _ => Rgb([(3 * x + y) as u8, 90, 60]),
            })
        };
        let frames: Vec<RgbImage> = (0..9).map(|i| frame(4 * i)).collect();
        let EmptyScene { image, changed, changed_share, busy_share } = EmptyScene::new(&frames);
        assert!(image.enumerate_pixels().all(|(x, y, pixel)| pixel.0 == [(3 * x + y) as u8, 90, 60]));
        assert!(changed_share > 0.8 && busy_share < 0.01, "{changed_share} {busy_share}");
        let column = |x: usize| (0..20).all(|y| changed[40 * y + x]);
        assert!(column(4) && !column(39));
    }

    #[test]
    fn without_images_there_are_no_pixels() {
        assert_eq!(EmptyScene::new(&[]).image.dimensions(), (0, 0));
    }
}
