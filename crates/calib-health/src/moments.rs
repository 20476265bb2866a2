//! Moments at which several cameras saw people: a sample of every window of time, the same for all cameras.
//!
//! A hash of the moment selects the sample (bottom-k sampling, Cohen and Kaplan 2007). The `k` smallest
//! hashes of a window do not depend on the order of the rows or cameras. They are also the same after two
//! windows are merged.

use std::collections::BTreeMap;

use calib_core::camera::Pixel;

/// Length of a moment, in nanoseconds; people hardly move within it.
const MOMENT_NS: i64 = 250_000_000;
/// Largest number of moments stored for a window.
const MAX_MOMENTS: usize = 40;
/// Largest number of feet stored for a moment.
const MAX_FEET: usize = 128;

/// Foot of a person in the image of one camera at one moment.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Foot {
    /// Index of the camera.
    pub(crate) camera: usize,
    /// Time, in nanoseconds since 1970.
    pub(crate) at: i64,
    /// Position of the foot in the image.
    pub(crate) pixel: Pixel,
    /// Standard deviation of `pixel`, in pixels.
    pub(crate) sigma: f64,
}

/// Sampled moments of a window of time.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Moments {
    /// Feet by hash of the moment.
    kept: BTreeMap<u64, Vec<Foot>>,
}

/// Returns the hash of the moment that contains the time `at`, in nanoseconds since 1970 (splitmix64, Steele,
/// Lea and Flood 2014).
pub(crate) const fn hash(at: i64) -> u64 {
    let mut z = (at.div_euclid(MOMENT_NS) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Moments {
    /// Whether the sample would keep a moment with this hash.
    pub(crate) fn keeps(&self, hash: u64) -> bool {
        self.kept.len() < MAX_MOMENTS || self.kept.last_key_value().is_some_and(|(last, _)| hash <= *last)
    }

    /// Adds the foot point of a detected person to the sampled moment with this hash. Only the first frame of each
    /// camera in a moment counts.
    pub(crate) fn add(&mut self, hash: u64, foot: Foot) {
        let seen = self.kept.entry(hash).or_default();
        let is_first_frame = seen.iter().all(|other| other.camera != foot.camera || other.at == foot.at);
        if is_first_frame && seen.len() < MAX_FEET {
            seen.push(foot);
        }
        self.trim();
    }

    /// Merges the moments of another window.
    pub(crate) fn merge(&mut self, other: Self) {
        for (hash, feet) in other.kept {
            self.kept.entry(hash).or_default().extend(feet);
        }
        self.trim();
    }

    /// Drops the moments with the largest hashes beyond [`MAX_MOMENTS`].
    fn trim(&mut self) {
        while self.kept.len() > MAX_MOMENTS {
            self.kept.pop_last();
        }
    }

    /// Iterates over the feet of every moment.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Vec<Foot>> {
        self.kept.values()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments_in_order(order: impl Iterator<Item = i64>) -> Moments {
        let mut moments = Moments::default();
        for second in order {
            let at = second * 1_000_000_000;
            if moments.keeps(hash(at)) {
                let pixel = Pixel::new(1.0, 2.0);
                moments.add(hash(at), Foot { camera: (second % 2) as usize, at, pixel, sigma: 1.0 });
            }
        }
        moments
    }

    #[test]
    fn sample_does_not_depend_on_order_or_merging() {
        let forward = moments_in_order(0..1000);
        assert_eq!(forward.kept.len(), MAX_MOMENTS);
        assert_eq!(forward, moments_in_order((0..1000).rev()));
        let mut joined = moments_in_order(300..1000);
        joined.merge(moments_in_order(0..300));
        assert_eq!(forward, joined);
    }
}
