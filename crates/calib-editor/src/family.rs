//! Cameras that fit what was drawn as well as the solution does: a second one, or a whole family.

use calib_core::{Camera, Code};

use calib_core::single::{Known, RULED_OUT};

use calib_site::{LensCache, Site, SiteCamera, Solution};

/// A camera with a horizontal field of view that was asked for, and how it fits.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Horizontal field of view, in degrees.
    pub view: f64,
    /// Its result.
    pub solution: Solution,
    /// Its pose.
    pub pose: Camera,
}

/// What fits as well as the solution.
#[derive(Clone, Debug)]
pub struct Family {
    /// From what it follows.
    camera: SiteCamera,
    /// Between which fields of view everything fits, in degrees; `None` where there are but two cameras.
    pub range: Option<[f64; 2]>,
    /// The cameras at the ends of that range.
    pub ends: Option<[Camera; 2]>,
    /// The two that are shown.
    pub shown: [Fit; 2],
}

/// Fields of view that are tried, in degrees.
const VIEWS: std::ops::RangeInclusive<i32> = 2..=15;
const STEP: f64 = 8.0;

/// Horizontal field of view of a focal, in degrees.
#[must_use]
pub fn view_of(camera: &SiteCamera, focal: f64) -> f64 {
    2.0 * (0.5 * camera.size()[0] / focal).atan().to_degrees()
}

fn focal_of(camera: &SiteCamera, view: f64) -> f64 {
    0.5 * camera.size()[0] / (0.5 * view.to_radians()).tan()
}

/// The camera with this field of view that fits best.
#[must_use]
pub(crate) fn fit(site: &Site, index: usize, view: f64, lenses: &LensCache) -> Option<Fit> {
    let family = site.lens_families().into_iter().find(|family| family.contains(&index))?;
    let cameras = family.iter().filter_map(|&index| site.cameras.get(index)).cloned().collect();
    let mut alone = Site { cameras, plan: site.plan.clone(), ..Site::new() };
    let own = family.iter().position(|&camera| camera == index)?;
    let camera = alone.cameras.get_mut(own)?;
    let focal = focal_of(camera, view);
    camera.lens.get_or_insert_default().focal_px = Some(Known::fixed(focal));
    let everyone: Vec<usize> = (0..family.len()).collect();
    let (report, _) = alone.calibrate_family(&everyone, lenses);
    let solution = report.cameras.into_iter().nth(own)?.1.ok()?;
    let pose = solution.camera()?;
    Some(Fit { view, solution, pose })
}

impl Family {
    /// What else fits a camera; `None` where nothing does.
    #[must_use]
    pub fn of(site: &Site, index: usize, solution: &Solution, lenses: &LensCache) -> Option<Self> {
        let camera = site.cameras.get(index)?;
        // Views of a fisheye are not told by a focal alone, and its horizon is a ring.
        if solution.lens().distortion.is_wide() {
            return None;
        }
        let own = view_of(camera, solution.focal_px);
        let shown = |a: f64, b: f64| Some([fit(site, index, a, lenses)?, fit(site, index, b, lenses)?]);
        let is_open = solution.warns_of(Code::FocalUnobservable);
        if !is_open {
            let shown = shown(own, solution.alternatives.first()?.hfov_deg)?;
            return Some(Self { camera: camera.clone(), range: None, ends: None, shown });
        }
        let tried: Vec<Fit> = VIEWS.filter_map(|i| fit(site, index, STEP * f64::from(i), lenses)).collect();
        let chi2 = |fit: &Fit| fit.solution.chi2.unwrap_or(f64::INFINITY);
        let best = tried.iter().map(chi2).fold(f64::INFINITY, f64::min);
        let mut fits = tried.iter().filter(|fit| chi2(fit) - best < RULED_OUT);
        let first = fits.next()?;
        let last = fits.next_back().unwrap_or(first);
        let (low, high) = (first.view, last.view);
        if low >= high {
            return None;
        }
        let own = own.clamp(low, high);
        // The other one is that which differs most.
        let far = if own - low > high - own { low } else { high };
        let shown = shown(own, 0.5 * (own + far))?;
        let ends = Some([first.pose, last.pose]);
        Some(Self { camera: camera.clone(), range: Some([low, high]), ends, shown })
    }

    /// Whether it is that of a camera as it is now.
    #[must_use]
    pub fn is_of(&self, camera: &SiteCamera) -> bool {
        self.camera == *camera
    }

    /// Shows another member.
    pub fn choose(&mut self, site: &Site, index: usize, which: usize, view: f64, lenses: &LensCache) {
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
    fn verticals_alone_leave_a_family_and_all_of_it_fits() {
        let mut site = calib_demo::demo_site().site;
        site.cameras.truncate(1);
        let camera = &mut site.cameras[0];
        camera.annotations.retain(|annotation: &Annotation| annotation.kind == Kind::Vertical);
        (camera.control_points, camera.placement) = (Vec::new(), None);
        let report = site.calibrate(&Options { refine: false, ..Options::default() });
        let solution = report.cameras[0].1.as_ref().unwrap();
        let family = Family::of(&site, 0, solution, &LensCache::default())
            .expect("verticals alone do not tell the focal");
        let [low, high] = family.range.expect("a family, not two cameras");
        assert!(high - low > 20.0, "{low} to {high}");
        let rms = |view: f64| fit(&site, 0, view, &LensCache::default()).unwrap().solution.rms_px.unwrap();
        assert!((rms(low) - rms(high)).abs() < 1.0, "{} and {} px", rms(low), rms(high));
        assert!(family.shown[0].view != family.shown[1].view);
    }

    #[test]
    fn a_camera_that_is_known_has_no_family() {
        let site = calib_demo::demo_site().site;
        let report = site.calibrate(&Options { refine: false, ..Options::default() });
        let solution = report.cameras[0].1.as_ref().unwrap();
        assert!(Family::of(&site, 0, solution, &LensCache::default()).is_none());
    }
}
