//! Values that are worked on together, so that the compiler can use vector instructions.

use crate::camera::LANES;

/// As many values as are worked on together.
pub(super) type Lanes<const N: usize = LANES> = [f64; N];

/// As many values as there are, and a filling.
#[inline(always)]
pub(super) fn lanes<const N: usize>(values: &[f64], filling: f64) -> [f64; N] {
    let filled = || std::array::from_fn(|i| values.get(i).copied().unwrap_or(filling));
    values.first_chunk().copied().unwrap_or_else(filled)
}

#[inline(always)]
pub(super) fn store<T: Copy, const N: usize>(values: &[T; N], to: &mut [T]) {
    match to.first_chunk_mut() {
        Some(all) => *all = *values,
        None => to.copy_from_slice(&values[..to.len()]),
    }
}

/// As many values as a block has: those given, or a copy of them that is filled up.
#[inline(always)]
pub(super) fn block<'a, const N: usize>(values: &'a [f64], spare: &'a mut [f64; N]) -> &'a [f64; N] {
    if let Some(all) = values.first_chunk() {
        return all;
    }
    spare[..values.len()].copy_from_slice(values);
    spare
}
