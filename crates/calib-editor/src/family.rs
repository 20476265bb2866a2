//! Alternatives to the solution of a camera that fit its annotations equally well: a second solution, or a
//! one-parameter family of solutions.

use calib_core::{Camera, Code};

use calib_core::single::{Known, MIN_CHI2_DIFFERENCE};

use calib_site::{LensCache, Site, SiteCamera, Solution};

/// Camera that was fitted with a prescribed horizontal field of view.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Prescribed horizontal field of view, in degrees.
    pub view: f64,
    /// Solution with this field of view.
    pub solution: Solution,
    /// Pose and lens of the solution.
    pub pose: Camera,
}

/// Alternative solutions of a camera that fit its annotations equally well.
#[derive(Clone, Debug)]
pub struct Family {
    /// Camera from which the alternatives were computed.
    camera: SiteCamera,
    /// Range of horizontal fields of view for which a solution fits, in degrees. `None` if there are exactly
    /// two solutions.
    pub range: Option<[f64; 2]>,
    /// Pose and lens of the solutions at the ends of `range`.
    pub ends: Option<[Camera; 2]>,
    /// Two alternatives that the app shows for comparison.
    pub shown: [Fit; 2],
}

/// Horizontal fields of view that are tried, in multiples of `HFOV_STEP_DEG`.
const HFOV_STEPS: std::ops::RangeInclusive<i32> = 2..=15;
/// Step of the horizontal fields of view that are tried, in degrees.
const HFOV_STEP_DEG: f64 = 8.0;

/// Returns the horizontal field of view of a camera with this focal length, in degrees. The focal length is
/// in pixels.
#[must_use]
pub fn hfov_deg(camera: &SiteCamera, focal: f64) -> f64 {
    2.0 * (0.5 * camera.size()[0] / focal).atan().to_degrees()
}

/// Returns the focal length in pixels for a horizontal field of view in degrees.
fn focal_px(camera: &SiteCamera, view: f64) -> f64 {
    0.5 * camera.size()[0] / (0.5 * view.to_radians()).tan()
}

/// Fits a camera with a prescribed horizontal field of view in degrees. `None` if the fit fails.
#[must_use]
pub(crate) fn fit(site: &Site, index: usize, view: f64, lenses: &LensCache) -> Option<Fit> {
    let family = site.lens_families().into_iter().find(|family| family.contains(&index))?;
    let cameras = family.iter().filter_map(|&index| site.cameras.get(index)).cloned().collect();
    let mut alone = Site { cameras, plan: site.plan.clone(), ..Site::new() };
    let own = family.iter().position(|&camera| camera == index)?;
    let camera = alone.cameras.get_mut(own)?;
    let focal = focal_px(camera, view);
    camera.lens.get_or_insert_default().focal_px = Some(Known::fixed(focal));
    let everyone: Vec<usize> = (0..family.len()).collect();
    let (report, _) = alone.calibrate_family(&everyone, lenses);
    let solution = report.cameras.into_iter().nth(own)?.1.ok()?;
    let pose = solution.camera()?;
    Some(Fit { view, solution, pose })
}

impl Family {
    /// Returns the alternatives to the solution of a camera, if any.
    #[must_use]
    pub fn find(site: &Site, index: usize, solution: &Solution, lenses: &LensCache) -> Option<Self> {
        let camera = site.cameras.get(index)?;
        // Fisheye lenses have no alternatives here: their focal length alone does not determine the field of
        // view, and their horizon is a closed curve.
        if solution.lens().distortion.is_wide() {
            return None;
        }
        let own = hfov_deg(camera, solution.focal_px);
        let shown = |a: f64, b: f64| Some([fit(site, index, a, lenses)?, fit(site, index, b, lenses)?]);
        let is_open = solution.has_warning(Code::FocalUnobservable);
        if !is_open {
            let shown = shown(own, solution.alternatives.first()?.hfov_deg)?;
            return Some(Self { camera: camera.clone(), range: None, ends: None, shown });
        }
        let tried: Vec<Fit> =
            HFOV_STEPS.filter_map(|i| fit(site, index, HFOV_STEP_DEG * f64::from(i), lenses)).collect();
        let chi2 = |fit: &Fit| fit.solution.chi2.unwrap_or(f64::INFINITY);
        let best = tried.iter().map(chi2).fold(f64::INFINITY, f64::min);
        let mut fits = tried.iter().filter(|fit| chi2(fit) - best < MIN_CHI2_DIFFERENCE);
        let first = fits.next()?;
        let last = fits.next_back().unwrap_or(first);
        let (low, high) = (first.view, last.view);
        if low >= high {
            return None;
        }
        let own = own.clamp(low, high);
        // The field of view of the second alternative is halfway between the first one and the farther end of
        // the range.
        let far = if own - low > high - own { low } else { high };
        let shown = shown(own, 0.5 * (own + far))?;
        let ends = Some([first.pose, last.pose]);
        Some(Self { camera: camera.clone(), range: Some([low, high]), ends, shown })
    }

    /// Whether the alternatives were computed from the current state of a camera.
    #[must_use]
    pub fn is_current(&self, camera: &SiteCamera) -> bool {
        self.camera == *camera
    }

    /// Replaces one of the two shown alternatives; `which` is 0 or 1. `view` is the new horizontal field of
    /// view, in degrees.
    pub fn show(&mut self, site: &Site, index: usize, which: usize, view: f64, lenses: &LensCache) {
        if let (Some(shown), Some(fit)) = (self.shown.get_mut(which), fit(site, index, view, lenses)) {
            *shown = fit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::{Annotation, Kind};
    use calib_site::Options;

    #[test]
    fn verticals_alone_leave_a_family_of_equal_fits() {
        let mut site = calib_demo::demo_site().site;
        site.cameras.truncate(1);
        let camera = &mut site.cameras[0];
        camera.annotations.retain(|annotation: &Annotation| annotation.kind == Kind::Vertical);
        (camera.control_points, camera.placement) = (Vec::new(), None);
        let report = site.calibrate(&Options { refine: false, ..Options::default() });
        let solution = report.cameras[0].1.as_ref().unwrap();
        let family = Family::find(&site, 0, solution, &LensCache::default())
            .expect("verticals alone do not determine the focal length");
        let [low, high] = family.range.expect("a family, not two cameras");
        assert!(high - low > 20.0, "{low} to {high}");
        let rms = |view: f64| fit(&site, 0, view, &LensCache::default()).unwrap().solution.rms_px.unwrap();
        assert!((rms(low) - rms(high)).abs() < 1.0, "{} and {} px", rms(low), rms(high));
        assert!(family.shown[0].view != family.shown[1].view);
    }

    #[test]
    fn well_determined_camera_has_no_family() {
        let site = calib_demo::demo_site().site;
        let report = site.calibrate(&Options { refine: false, ..Options::default() });
        let solution = report.cameras[0].1.as_ref().unwrap();
        assert!(Family::find(&site, 0, solution, &LensCache::default()).is_none());
    }
}
