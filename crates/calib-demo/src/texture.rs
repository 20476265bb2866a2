//! Patterns without pictures: hashes, noise, and joints that fade with distance instead of flickering.

use crate::vector::Vec3;

/// A number from 0 to 1 that depends on an integer and looks like chance.
#[inline]
pub(crate) fn chance(seed: u32) -> f32 {
    (mix(seed) >> 8) as f32 / 16_777_216.0
}

/// Stirs the bits of an integer (the finaliser of `MurmurHash3`).
#[inline]
pub(crate) const fn mix(seed: u32) -> u32 {
    let mut h = seed;
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// One integer of the three of a cell.
#[inline]
pub(crate) const fn cell(x: i32, y: i32, z: i32) -> u32 {
    (x as u32).wrapping_mul(0x9e37_79b1) ^ mix((y as u32).wrapping_mul(0x85eb_ca77) ^ mix(z as u32))
}

/// Smooth noise from 0 to 1 whose hills are one unit apart.
pub(crate) fn noise(p: Vec3) -> f32 {
    let base = p.map(f32::floor);
    let f = (p - base).map(|t| t * t * (3.0 - 2.0 * t));
    let (x, y, z) = (base.x as i32, base.y as i32, base.z as i32);
    let at = |dx, dy, dz| chance(cell(x + dx, y + dy, z + dz));
    let mixed = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let row = |dy, dz| mixed(at(0, dy, dz), at(1, dy, dz), f.x);
    mixed(mixed(row(0, 0), row(1, 0), f.y), mixed(row(0, 1), row(1, 1), f.y), f.z)
}

/// Noise of several sizes, from -1 to 1: the coarsest of `scale` metres, down to what a pixel still shows.
pub(crate) fn clouds(p: Vec3, scale: f32, footprint: f32) -> f32 {
    const OCTAVES: usize = 3;
    let (mut size, mut weight, mut sum) = (scale, 0.5, 0.0);
    for _ in 0..OCTAVES {
        if size < 2.0 * footprint {
            break;
        }
        sum += weight * (2.0 * noise(p * size.recip()) - 1.0);
        size *= 0.43;
        weight *= 0.6;
    }
    sum
}

/// Share of a stretch of `footprint` metres about `x` that joints of `width` at every `pitch` cover.
pub(crate) fn joint(x: f32, pitch: f32, width: f32, footprint: f32) -> f32 {
    let covered = |x: f32| {
        let shifted = x + 0.5 * width;
        let count = (shifted / pitch).floor();
        width * count + (shifted - count * pitch).min(width)
    };
    let footprint = footprint.max(1e-4);
    ((covered(x + 0.5 * footprint) - covered(x - 0.5 * footprint)) / footprint).clamp(0.0, 1.0)
}

/// 0 below `low`, 1 above `high`, smooth between.
pub(crate) fn step(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_cover_the_same_share_however_wide_the_pixel() {
        for footprint in [0.001, 0.05, 0.3, 1.1] {
            let mean = (0..6000).map(|i| joint(i as f32 * 1e-3, 0.6, 0.012, footprint)).sum::<f32>() / 6000.0;
            assert!((mean - 0.02).abs() < 1e-3, "{mean} at {footprint}");
        }
        assert!(joint(1.2, 0.6, 0.012, 0.001) > 0.999);
        assert_eq!(joint(1.5, 0.6, 0.012, 0.001), 0.0);
    }
}
