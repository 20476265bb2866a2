//! Procedural patterns: hashes, noise, and joints that fade with distance instead of flickering.

use crate::vector::Vec3;

/// Returns a pseudo-random number from 0 to 1 for an integer.
#[inline]
pub(crate) fn chance(seed: u32) -> f32 {
    (mix(seed) >> 8) as f32 / 16_777_216.0
}

/// Mixes the bits of an integer (the finaliser of `MurmurHash3`).
#[inline]
pub(crate) const fn mix(seed: u32) -> u32 {
    let mut h = seed;
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// Hashes the three integers of a cell to one.
#[inline]
pub(crate) const fn cell(x: i32, y: i32, z: i32) -> u32 {
    (x as u32).wrapping_mul(0x9e37_79b1) ^ mix((y as u32).wrapping_mul(0x85eb_ca77) ^ mix(z as u32))
}

/// Computes smooth noise from 0 to 1 at a point, with a wavelength of about one unit of its coordinates.
pub(crate) fn noise(p: Vec3) -> f32 {
    let base = p.map(f32::floor);
    let f = (p - base).map(|t| t * t * (3.0 - 2.0 * t));
    let (x, y, z) = (base.x as i32, base.y as i32, base.z as i32);
    let at = |dx, dy, dz| chance(cell(x + dx, y + dy, z + dz));
    let mixed = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let row = |dy, dz| mixed(at(0, dy, dz), at(1, dy, dz), f.x);
    mixed(mixed(row(0, 0), row(1, 0), f.y), mixed(row(0, 1), row(1, 1), f.y), f.z)
}

/// Computes noise of several scales at a point, from -1 to 1. The coarsest wavelength is `scale` metres.
/// Details that are smaller than `footprint`, the extent of a pixel in metres, are omitted.
pub(crate) fn clouds(p: Vec3, scale: f32, footprint: f32) -> f32 {
    /// Number of scales.
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

/// Returns the fraction of a segment that joints cover. The segment is `footprint` metres long with its
/// centre at `x`. Joints are `width` metres wide, with their centres at the multiples of `pitch`, in metres.
pub(crate) fn joint(x: f32, pitch: f32, width: f32, footprint: f32) -> f32 {
    let covered = |x: f32| {
        let shifted = x + 0.5 * width;
        let count = (shifted / pitch).floor();
        width * count + (shifted - count * pitch).min(width)
    };
    let footprint = footprint.max(1e-4);
    ((covered(x + 0.5 * footprint) - covered(x - 0.5 * footprint)) / footprint).clamp(0.0, 1.0)
}

/// Returns 0 below `low`, 1 above `high`, and a smooth transition between.
pub(crate) fn step(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joint_coverage_is_independent_of_pixel_width() {
        for footprint in [0.001, 0.05, 0.3, 1.1] {
            let mean = (0..6000).map(|i| joint(i as f32 * 1e-3, 0.6, 0.012, footprint)).sum::<f32>() / 6000.0;
            assert!((mean - 0.02).abs() < 1e-3, "{mean} at {footprint}");
        }
        assert!(joint(1.2, 0.6, 0.012, 0.001) > 0.999);
        assert_eq!(joint(1.5, 0.6, 0.012, 0.001), 0.0);
    }
}
