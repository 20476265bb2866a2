//! Moments at which several cameras saw people: a sample of every window of time, the same for all cameras.
//!
//! A hash of the moment selects the sample (bottom-k sampling, Cohen and Kaplan 2007). The `k` smallest
//! hashes of a window do not depend on the order of the rows or cameras. They are also the same after two
//! windows are merged.

use std::collections::BTreeMap;

use calib_core::camera::Pixel;

/// Length of a moment, in nanoseconds; people hardly move within it.
const MOMENT_NS: i64 = 250_000_000;
/// Largest number of moments kept per window.
const MAX_MOMENTS: usize = 40;
/// Largest number of feet kept per moment.
const MAX_FEET: usize = 128;

/// Foot of a person at one moment.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Foot {
    pub(crate) camera: usize,
    pub(crate) at: i64,
    pub(crate) pixel: Pixel,
    /// Standard deviation of the pixel, in pixels.
    pub(crate) sigma: f64,
}

/// Sampled moments of a window.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Moments {
    /// Feet by hash of the moment.
    kept: BTreeMap<u64, Vec<Foot>>,
}

/// Returns the hash of a moment (splitmix64, Steele, Lea and Flood 2014).
pub(crate) const fn hash(at: i64) -> u64 {
    let mut z = (at.div_euclid(MOMENT_NS) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Moments {
    /// Whether a moment with this hash would be kept.
    pub(crate) fn keeps(&self, hash: u64) -> bool {
        self.kept.len() < MAX_MOMENTS || self.kept.last_key_value().is_some_and(|(last, _)| hash <= *last)
    }

    /// Adds a foot. Only the first frame of every camera in the moment counts.
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

    fn trim(&mut self) {
        while self.kept.len() > MAX_MOMENTS {
            self.kept.pop_last();
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Vec<Foot>> {
        self.kept.values()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(order: impl Iterator<Item = i64>) -> Moments {
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
        let forward = of(0..1000);
        assert_eq!(forward.kept.len(), MAX_MOMENTS);
        assert_eq!(forward, of((0..1000).rev()));
        let mut joined = of(300..1000);
        joined.merge(of(0..300));
        assert_eq!(forward, joined);
    }
}
