//! Colour classes of a site, and the share of each class in the pixels of its images.

use crate::registration::lab_image::LabImage;

/// Side of the bins in which colours are counted, in units of Lab.
const BIN: f32 = 4.0;
/// Number of bins along L, a and b. The bins of a and b are centred on grey.
const BINS: [usize; 3] = [12, 67, 67];
/// Smallest number of pixels of a bin that is used.
const MIN_BIN_COUNT: u32 = 21;
/// Largest number of classes.
const MAX_CLASSES: usize = 40;
/// Smallest distance between two initial class centres, in units of Lab.
const MIN_CENTRE_DISTANCE: f32 = 9.0;
/// Number of rounds of k-means.
const ROUNDS: usize = 10;
/// Standard deviation of the colours of one class, in units of Lab.
const CLASS_SIGMA: f32 = 5.0;

/// Centres of the colour classes, in Lab with reduced lightness.
#[derive(Clone, Debug)]
pub(crate) struct ColourClasses {
    centres: Vec<[f32; 3]>,
}

/// Mean colour of a bin, with its weight.
struct Bin {
    colour: [f32; 3],
    weight: f32,
}

impl ColourClasses {
    /// Computes the classes of all images of a site. A colour has the power 0.4 of its count as weight, so that the
    /// colours of floor and walls do not dominate. The initial centres are farthest points, refined by k-means.
    pub(crate) fn new<'a>(images: impl Iterator<Item = &'a LabImage>) -> Self {
        let bins = bins(images);
        let mut centres: Vec<[f32; 3]> = Vec::new();
        let mut squares = vec![f32::INFINITY; bins.len()];
        while centres.len() < MAX_CLASSES {
            let gain = |(bin, &square): (&Bin, &f32)| {
                let is_far = square > MIN_CENTRE_DISTANCE * MIN_CENTRE_DISTANCE;
                if is_far { bin.weight * square.min(1e6) } else { 0.0 }
            };
            let gains = bins.iter().zip(&squares).map(gain).enumerate();
            let Some((best, _)) = gains.filter(|(_, gain)| *gain > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
            else {
                break;
            };
            let centre = bins[best].colour;
            let near = bins.iter().map(|bin| square_distance(bin.colour, centre));
            squares.iter_mut().zip(near).for_each(|(square, near)| *square = square.min(near));
            centres.push(centre);
        }
        (0..ROUNDS).for_each(|_| refine(&mut centres, &bins));
        Self { centres }
    }

    /// Returns the number of classes.
    pub(crate) fn len(&self) -> usize {
        self.centres.len()
    }

    /// Computes the share of each class in each pixel: the posterior probability of the class under Gaussian
    /// noise of the colour. The shares of a hidden pixel are 0.
    pub(crate) fn shares(&self, image: &LabImage) -> ClassShares {
        /// Exponent below which a share is 0.
        const MIN_EXPONENT: f32 = -8.0;
        let count = self.len();
        let mut shares = vec![0.0; image.colours.len() * count];
        let mut squares = vec![0.0; count];
        let pixels = shares.chunks_exact_mut(count.max(1)).zip(&image.colours).zip(&image.is_visible);
        for ((shares, &colour), _) in pixels.filter(|(_, is_visible)| **is_visible) {
            for (square, &centre) in squares.iter_mut().zip(&self.centres) {
                *square = square_distance(colour, centre);
            }
            let least = squares.iter().copied().fold(f32::INFINITY, f32::min);
            let mut sum = 0.0;
            for (share, &square) in shares.iter_mut().zip(&squares) {
                let exponent = (least - square) / (2.0 * CLASS_SIGMA * CLASS_SIGMA);
                *share = if exponent > MIN_EXPONENT { exponent.exp() } else { 0.0 };
                sum += *share;
            }
            shares.iter_mut().for_each(|share| *share /= sum);
        }
        ClassShares { classes: count, size: image.size, shares }
    }
}

/// Counts the colours of the visible pixels in bins.
fn bins<'a>(images: impl Iterator<Item = &'a LabImage>) -> Vec<Bin> {
    let mut sums = vec![(0_u32, [0.0_f64; 3]); BINS.iter().product()];
    for colour in images.flat_map(LabImage::visible) {
        let index = |i: usize| {
            let centre = if i == 0 { 0.0 } else { (BINS[i] / 2) as f32 };
            ((colour[i] / BIN).round() + centre).clamp(0.0, (BINS[i] - 1) as f32) as usize
        };
        let (count, sum) = &mut sums[(index(0) * BINS[1] + index(1)) * BINS[2] + index(2)];
        *count += 1;
        (0..3).for_each(|i| sum[i] += f64::from(colour[i]));
    }
    let used = sums.into_iter().filter(|(count, _)| *count >= MIN_BIN_COUNT);
    let bin = |(count, sum): (u32, [f64; 3])| Bin {
        colour: sum.map(|sum| (sum / f64::from(count)) as f32),
        weight: (count as f32).powf(0.4),
    };
    used.map(bin).collect()
}

/// Moves each centre to the weighted mean of its nearest bins: one round of k-means.
fn refine(centres: &mut [[f32; 3]], bins: &[Bin]) {
    let mut sums = vec![(0.0_f32, [0.0_f32; 3]); centres.len()];
    for bin in bins {
        let squares = centres.iter().map(|&centre| square_distance(bin.colour, centre)).enumerate();
        let Some((nearest, _)) = squares.min_by(|a, b| a.1.total_cmp(&b.1)) else { return };
        let (weight, sum) = &mut sums[nearest];
        *weight += bin.weight;
        (0..3).for_each(|i| sum[i] += bin.weight * bin.colour[i]);
    }
    for (centre, (weight, sum)) in centres.iter_mut().zip(sums) {
        if weight > 0.0 {
            *centre = sum.map(|sum| sum / weight);
        }
    }
}

fn square_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)
}

/// Share of each colour class in each pixel, 0 to 1. The sum over the classes is 1 in visible pixels.
#[derive(Clone, Debug)]
pub(crate) struct ClassShares {
    /// Number of classes.
    pub(crate) classes: usize,
    /// Width and height, in pixels.
    pub(crate) size: [usize; 2],
    /// Shares, pixel by pixel, row by row.
    shares: Vec<f32>,
}

impl ClassShares {
    /// Returns the shares of one pixel.
    pub(crate) fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let start = (y * self.size[0] + x) * self.classes;
        &self.shares[start..start + self.classes]
    }

    /// Returns the means of blocks of `step` by `step` pixels. Incomplete blocks at the border are omitted.
    pub(crate) fn block_means(&self, step: usize) -> Self {
        let size = self.size.map(|side| side / step);
        let mut shares = vec![0.0; size[0] * size[1] * self.classes];
        let factor = 1.0 / (step * step) as f32;
        for (index, mean) in shares.chunks_exact_mut(self.classes.max(1)).enumerate() {
            let [x, y] = [index % size[0], index / size[0]].map(|i| i * step);
            for (dx, dy) in (0..step).flat_map(|dy| (0..step).map(move |dx| (dx, dy))) {
                let pixel = self.pixel(x + dx, y + dy);
                mean.iter_mut().zip(pixel).for_each(|(mean, share)| *mean += factor * share);
            }
        }
        Self { classes: self.classes, size, shares }
    }

    /// Returns the shares after a Gaussian blur with standard deviation `sigma`, in pixels. Hidden pixels and
    /// pixels outside the image count as zero.
    pub(crate) fn blurred(&self, sigma: f32) -> Self {
        let radius = (3.0 * sigma).ceil() as isize;
        let raw = |i: isize| (-0.5 * (i as f32 / sigma).powi(2)).exp();
        let sum: f32 = (-radius..=radius).map(raw).sum();
        let kernel: Vec<(isize, f32)> = (-radius..=radius).map(|i| (i, raw(i) / sum)).collect();
        let [w, h] = self.size;
        let row = w * self.classes;
        let mut across = vec![0.0; self.shares.len()];
        let lines = across.chunks_exact_mut(row.max(1)).zip(self.shares.chunks_exact(row.max(1)));
        lines.for_each(|(into, from)| add_shifted(into, from, &kernel, self.classes));
        let mut shares = vec![0.0; self.shares.len()];
        for y in 0..h {
            let into = &mut shares[y * row..(y + 1) * row];
            for &(shift, weight) in &kernel {
                let Some(source) = y.checked_add_signed(shift).filter(|source| *source < h) else { continue };
                let from = &across[source * row..(source + 1) * row];
                into.iter_mut().zip(from).for_each(|(into, from)| *into += weight * from);
            }
        }
        Self { classes: self.classes, size: self.size, shares }
    }
}

/// Adds the pixels of a row to another row, shifted and weighted by the kernel of a blur.
fn add_shifted(into: &mut [f32], from: &[f32], kernel: &[(isize, f32)], classes: usize) {
    for &(shift, weight) in kernel {
        let offset = (shift.unsigned_abs() * classes).min(from.len());
        let length = from.len() - offset;
        let (into, from) = if shift < 0 {
            (&mut into[offset..], &from[..length])
        } else {
            (&mut into[..length], &from[offset..])
        };
        into.iter_mut().zip(from).for_each(|(into, from)| *into += weight * from);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stripes() -> LabImage {
        let colours = [[10.0, 40.0, 0.0], [30.0, -40.0, 20.0], [20.0, 0.0, 0.0]];
        let at = |i: usize| colours[(i % 60) / 20];
        LabImage {
            size: [60, 30],
            colours: (0..1800).map(at).collect(),
            is_visible: (0..1800).map(|i| i != 7).collect(),
            scale: 1.0,
        }
    }

    #[test]
    fn distinct_colours_are_distinct_classes() {
        let image = stripes();
        let classes = ColourClasses::new([&image].into_iter());
        assert_eq!(classes.len(), 3);
        let shares = classes.shares(&image);
        let class = |x: usize| shares.pixel(x, 3).iter().position(|share| *share > 0.99);
        assert!(class(5).is_some() && class(5) != class(25) && class(25) != class(45));
        assert_eq!(shares.pixel(7, 0), [0.0; 3], "the hidden pixel");
    }

    #[test]
    fn blur_and_means_preserve_the_sum_inside_the_image() {
        let image = stripes();
        let shares = ColourClasses::new([&image].into_iter()).shares(&image);
        let blurred = shares.blurred(1.0);
        let sum: f32 = blurred.pixel(30, 15).iter().sum();
        assert!((sum - 1.0).abs() < 1e-5, "{sum}");
        let means = shares.block_means(20);
        assert_eq!(means.size, [3, 1]);
        assert!((means.pixel(1, 0).iter().sum::<f32>() - 1.0).abs() < 1e-4);
    }
}
