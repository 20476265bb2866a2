//! Moments at which people were seen by several cameras: a few of every window of time, the same few for all cameras.
//!
//! Which are kept is decided by a hash of the moment (bottom-k sampling, Cohen and Kaplan 2007): the `k` smallest of a
//! window are the same whatever the order of the rows, whichever cameras come first, and of two windows that become one.

use std::collections::BTreeMap;

use calib_core::camera::Pixel;

/// Nanoseconds of a moment: people stay where they are, nearly.
const LENGTH: i64 = 250_000_000;
/// Moments that are kept of a window.
const KEPT: usize = 40;
/// Most people of a moment.
const MOST: usize = 128;

/// One foot at one moment.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Foot {
    pub(crate) camera: usize,
    pub(crate) at: i64,
    pub(crate) pixel: Pixel,
    /// Standard deviation of the pixel.
    pub(crate) sigma: f64,
}

/// The moments of a window.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Moments {
    /// By the hash.
    kept: BTreeMap<u64, Vec<Foot>>,
}

/// The hash of a moment (splitmix64, Steele, Lea and Flood 2014).
pub(crate) const fn hash(at: i64) -> u64 {
    let mut z = (at.div_euclid(LENGTH) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Moments {
    /// Whether a moment of this hash would be kept.
    pub(crate) fn keeps(&self, hash: u64) -> bool {
        self.kept.len() < KEPT || self.kept.last_key_value().is_some_and(|(last, _)| hash <= *last)
    }

    /// Takes a foot; of every camera those of its first frame in the moment.
    pub(crate) fn see(&mut self, hash: u64, foot: Foot) {
        let seen = self.kept.entry(hash).or_default();
        let is_first_frame = seen.iter().all(|other| other.camera != foot.camera || other.at == foot.at);
        if is_first_frame && seen.len() < MOST {
            seen.push(foot);
        }
        self.trim();
    }

    /// Two windows become one.
    pub(crate) fn join(&mut self, other: Self) {
        for (hash, feet) in other.kept {
            self.kept.entry(hash).or_default().extend(feet);
        }
        self.trim();
    }

    fn trim(&mut self) {
        while self.kept.len() > KEPT {
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
                moments.see(hash(at), Foot { camera: (second % 2) as usize, at, pixel, sigma: 1.0 });
            }
        }
        moments
    }

    #[test]
    fn the_same_moments_are_kept_in_any_order_and_in_any_pieces() {
        let forward = of(0..1000);
        assert_eq!(forward.kept.len(), KEPT);
        assert_eq!(forward, of((0..1000).rev()));
        let mut joined = of(300..1000);
        joined.join(of(0..300));
        assert_eq!(forward, joined);
    }
}
