//! The logarithm of brightness: what light, exposure and gamma do to it is a factor and a sum.

use image::RgbImage;

/// Added to a brightness of 0 to 255: the noise of a dark place is no contrast.
const DARK: f32 = 12.0;

/// An image of one number a pixel.
#[derive(Clone, Debug)]
pub(crate) struct Luma {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl Luma {
    pub(crate) fn new(image: &RgbImage) -> Self {
        let (width, height) = image.dimensions();
        let log = |pixel: &image::Rgb<u8>| {
            let [r, g, b] = pixel.0.map(f32::from);
            (0.299 * r + 0.587 * g + 0.114 * b + DARK).ln()
        };
        Self { width: width as usize, height: height as usize, values: image.pixels().map(log).collect() }
    }

    /// Smoothed by a Gaussian of this standard deviation in pixels.
    pub(crate) fn smoothed(&self, sigma: f64) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let weights: Vec<f32> =
            (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32).collect();
        let sum: f32 = weights.iter().sum();
        let weights: Vec<f32> = weights.iter().map(|weight| weight / sum).collect();
        self.filtered(&weights, reach, 1).filtered(&weights, reach, self.width)
    }

    /// One pass along rows (`stride` 1) or columns (`stride` the width); the border is repeated.
    fn filtered(&self, weights: &[f32], reach: isize, stride: usize) -> Self {
        let (width, height) = (self.width, self.height);
        let mut values = vec![0.0; self.values.len()];
        let length = if stride == 1 { width } else { height } as isize;
        for y in 0..height {
            for x in 0..width {
                let (index, here) = (y * width + x, if stride == 1 { x } else { y } as isize);
                let start = index as isize - here * stride as isize;
                let value = |(k, weight): (usize, &f32)| {
                    let at = (here + k as isize - reach).clamp(0, length - 1);
                    weight * self.values[(start + at * stride as isize) as usize]
                };
                values[index] = weights.iter().enumerate().map(value).sum();
            }
        }
        Self { values, ..*self }
    }

    /// With every pixel as large as so many of this one's.
    pub(crate) fn reduced(&self, factor: f64) -> Self {
        let smooth = if factor > 1.0 { self.smoothed(0.45 * factor) } else { self.clone() };
        let [width, height] = [self.width, self.height].map(|side| ((side as f64 / factor) as usize).max(1));
        let value = |i: usize| {
            let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            smooth.nearest(u * factor, v * factor)
        };
        Self { width, height, values: (0..width * height).map(value).collect() }
    }

    /// Linear between pixels, the border repeated.
    fn nearest(&self, u: f64, v: f64) -> f32 {
        let within = |at: f64, side: usize| (at - 0.5).clamp(0.0, side as f64 - 1.0);
        let (x, y) = (within(u, self.width), within(v, self.height));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (s, t) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        (1.0 - t) * ((1.0 - s) * at(x0, y0) + s * at(x1, y0)) + t * ((1.0 - s) * at(x0, y1) + s * at(x1, y1))
    }

    /// Between pixels by cubic convolution (Keys 1981); `None` at the border and beyond.
    pub(crate) fn at(&self, u: f64, v: f64) -> Option<f64> {
        let (x, y) = (u - 0.5, v - 0.5);
        let inside = x >= 1.0 && y >= 1.0 && x < self.width as f64 - 2.0 && y < self.height as f64 - 2.0;
        if !inside {
            return None;
        }
        let (x0, y0) = (x as usize, y as usize);
        let (across, down) = (cubic(x - x0 as f64), cubic(y - y0 as f64));
        let row = |j: usize| {
            let start = (y0 + j - 1) * self.width + x0 - 1;
            let four = &self.values[start..start + 4];
            four.iter().zip(across).map(|(value, weight)| f64::from(*value) * weight).sum::<f64>()
        };
        Some((0..4).map(|j| down[j] * row(j)).sum())
    }
}

/// Weights of the four pixels about a place that is so far behind the second.
pub(crate) fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}
