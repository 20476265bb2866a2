//! Loops over many points, compiled for every width of vector instructions; the widest that the processor has is
//! taken. Whichever it is, the bits of a result are the same: nothing is fused, and nothing summed in another order.

use pulp::Arch;

/// The widest instructions that are taken: `v3` (AVX2) where the library was built with `CALIB_SIMD=v3`, so that a
/// machine that has more can be measured as one that has not.
#[cfg(target_arch = "x86_64")]
const WIDEST: Option<&str> = option_env!("CALIB_SIMD");

/// Runs a loop, which has to be inlined here, with the widest vector instructions there are.
#[inline(always)]
pub(crate) fn dispatch<R>(run: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if WIDEST == Some("v3")
        && let Some(v3) = pulp::x86::V3::try_new()
    {
        return v3.vectorize(run);
    }
    Arch::new().dispatch(run)
}
