//! The plan of a site: points of the floor as pixels of its picture, and back.

use calib_core::{FloorPoint, PlanScale};

use calib_site::{Plan, Site};

use crate::raw::{CalibResult, Fault, apart, bytes, give, guarded, handle, places, values};
use crate::site::CalibSite;

/// Writes the metres that a pixel of the plan is wide; `CALIB_RESULT_REFUSED` where the site has no plan.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile, and `*metres` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_plan_metres_per_px(
    site: *const CalibSite,
    metres: *mut f64,
) -> CalibResult {
    guarded(|| {
        // SAFETY: the caller says that it is a handle.
        let CalibSite(site) = unsafe { handle(site)? };
        let plan = site.plan.as_ref().ok_or(CalibResult::Refused)?;
        // SAFETY: the caller says that it can be written.
        unsafe { give(metres, plan.metres_per_px) }
    })
}

/// Points of the floor, in metres, to pixels of the plan from its upper left corner, y down.
///
/// All arrays have `count` values. Arrays that are written to overlap no other. `CALIB_RESULT_REFUSED` where the site has
/// no plan.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile; `count` values can be read of `x`, `y`, and written of `px`, `py`, and
/// nobody else writes to them meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_floor_to_plan(
    site: *const CalibSite,
    count: usize,
    x: *const f64,
    y: *const f64,
    px: *mut f64,
    py: *mut f64,
) -> CalibResult {
    guarded(|| {
        let map = |plan: &PlanScale, [x, y]: [f64; 2]| plan.plan_from_floor(FloorPoint { x, y }).into();
        // SAFETY: the caller says so.
        unsafe { each(site, count, [x, y], [px, py], map) }
    })
}

/// Pixels of the plan to points of the floor, in metres: the way back of `calib_site_floor_to_plan`.
///
/// # Safety
/// As for `calib_site_floor_to_plan`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn calib_site_plan_to_floor(
    site: *const CalibSite,
    count: usize,
    px: *const f64,
    py: *const f64,
    x: *mut f64,
    y: *mut f64,
) -> CalibResult {
    guarded(|| {
        let map = |plan: &PlanScale, pixel: [f64; 2]| plan.floor_from_plan(pixel.into()).into();
        // SAFETY: the caller says so.
        unsafe { each(site, count, [px, py], [x, y], map) }
    })
}

fn scale(site: &Site) -> Result<PlanScale, Fault> {
    Ok(site.plan.as_ref().map(Plan::scale).ok_or(CalibResult::Refused)?)
}

/// Maps pairs of numbers one by one.
///
/// # Safety
/// `site` is a handle that is not freed meanwhile; `count` values can be read of `from` and written of `to`.
unsafe fn each(
    site: *const CalibSite,
    count: usize,
    from: [*const f64; 2],
    to: [*mut f64; 2],
    map: impl Fn(&PlanScale, [f64; 2]) -> [f64; 2],
) -> Result<(), Fault> {
    apart(&to.map(|to| bytes(to, count)), &from.map(|from| bytes(from, count)))?;
    // SAFETY: the caller says that it is a handle.
    let CalibSite(site) = unsafe { handle(site)? };
    // SAFETY: the caller says that they can be read.
    let (a, b) = unsafe { (values(from[0], count)?, values(from[1], count)?) };
    // SAFETY: the caller says that they can be written, and they are apart.
    let (to_a, to_b) = unsafe { (places(to[0], count)?, places(to[1], count)?) };
    let plan = scale(site)?;
    for ((&a, &b), (to_a, to_b)) in a.iter().zip(b).zip(to_a.iter_mut().zip(to_b)) {
        [*to_a, *to_b] = map(&plan, [a, b]);
    }
    Ok(())
}
