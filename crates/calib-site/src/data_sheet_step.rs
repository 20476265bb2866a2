//! Comparison of the data sheet of a camera with the focal length that its lines alone determine.
//!
//! A wrong focal length does not always cause large residuals: the estimated principal point moves instead. Therefore
//! the camera is solved again without the data sheet, and both focal lengths are compared.

use calib_core::camera::{Camera, Covariance};

use crate::document::{Site, SiteCamera};
use crate::nominal_focal::DataSheetConflict;
use crate::options::Options;
use crate::single_step::{SharedInputs, SingleFit};
use crate::solution::Method;

/// Smallest difference of the log focal lengths, in standard deviations, that is a contradiction.
const MIN_DIFFERENCE_SIGMA: f64 = 3.0;

/// Largest standard deviation of the log focal length from the lines with which the data sheet is compared. The error
/// of a less certain focal length is not normally distributed.
const MAX_LOG_FOCAL_SIGMA_OF_LINES: f64 = 0.1;

impl Site {
    /// Adds the contradiction between the data sheet and the lines to the fit of a camera, if there is one.
    pub(crate) fn compared_with_data_sheet(
        &self,
        entry: &SiteCamera,
        fit: SingleFit,
        options: &Options,
        others: SharedInputs,
    ) -> SingleFit {
        match self.data_sheet_conflict(entry, options, others) {
            // Without the data sheet, the lines agree with the entered principal point.
            Some(conflict) => SingleFit { data_sheet_conflict: Some(conflict), other_centre: None, ..fit },
            None => fit,
        }
    }

    /// Solves a camera without its data sheet, and returns the contradiction between the lines and the data sheet.
    /// `None` if they agree, the camera has no data sheet, or the lines do not determine the focal length.
    fn data_sheet_conflict(
        &self,
        entry: &SiteCamera,
        options: &Options,
        others: SharedInputs,
    ) -> Option<DataSheetConflict> {
        if options.method == Method::Paper || entry.is_given() {
            return None;
        }
        let lens = entry.lens.as_ref()?.without_data_sheet()?;
        let without = SiteCamera { lens: Some(lens), ..entry.clone() };
        let (single, of_lines) = self.fit_lines_alone(&without, options, others)?;
        let fit = single.fit.as_ref().filter(|fit| !fit.is_misfit)?;
        let sigma = of_lines.covariance.sigma(Covariance::FOCAL)?;
        let log_sigma = sigma / of_lines.focal;
        if single.is_from_points || single.other_centre.is_some() || log_sigma > MAX_LOG_FOCAL_SIGMA_OF_LINES
        {
            return None;
        }
        let entered = entry.data_sheet_focal(&of_lines.lens)?;
        let entered_sigma = entered.sigma.filter(|_| !entered.fixed).unwrap_or(0.0) / entered.value;
        let limit = MIN_DIFFERENCE_SIGMA * log_sigma.hypot(entered_sigma);
        // The lines may allow several cameras.
        let alternatives = fit.alternatives.iter().map(|other| other.orientation.focal);
        let mut focals = std::iter::once(of_lines.focal).chain(alternatives);
        let is_conflict = focals.all(|focal| (focal / entered.value).ln().abs() > limit);
        is_conflict.then_some(DataSheetConflict { entered, of_lines, sigma })
    }

    /// Fits a camera to its lines, without a weak prior on the focal length. The covariance includes the uncertainty
    /// of the lens and of the principal point.
    fn fit_lines_alone(
        &self,
        entry: &SiteCamera,
        options: &Options,
        others: SharedInputs,
    ) -> Option<(SingleFit, Camera)> {
        let options = Options { prior: false, ..options.clone() };
        let mut single = self.fit_single(entry, &options, None, others).ok()?;
        if single.fits_lens() || entry.pixel_aspect_prior().is_some() {
            let draft = self.refine_lens(entry, &single);
            let better = draft.as_ref().map(|draft| (&single.lens_estimate, &draft.camera));
            single = self.fit_single(entry, &options, better, others).ok()?;
        }
        let single = self.with_best_aspect(entry, Ok(single), &options, others);
        let single = self.with_best_centre(entry, single, &options, others).ok()?;
        // Without unknown lens parameters, the lens is not refined.
        let refined = self.refine_lens(entry, &single).map(|refined| refined.camera);
        let camera = refined.or_else(|| Some(single.fit.as_ref()?.camera))?;
        Some((single, camera))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data_sheet::Nominal;
    use crate::document::LensEntry;
    use crate::solution::Solution;
    use calib_core::camera::{Lens, Pixel, WorldPoint};
    use calib_core::outcome::{Code, Finding};
    use calib_core::single::{Annotation, Kind, Known};
    use calib_demo::random::{AnnotationSet, RandomScene, normal};
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    const SIZE: [u32; 2] = [1920, 1080];
    const FOCAL: f64 = 835.0;

    /// Returns a camera that sees five verticals and four floor lines in each of two directions at right angles,
    /// with noise of one pixel.
    fn turret(seed: u64) -> SiteCamera {
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 24_f64.to_radians(),
            roll: 1_f64.to_radians(),
            focal: FOCAL,
            lens: Lens::pinhole(Pixel::new(975.0, 530.0)),
            covariance: Covariance::EXACT,
        };
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut line = |ends: [[f64; 3]; 2]| -> Vec<Pixel> {
            let seen = ends.map(|[x, y, z]| camera.world_to_pixel(WorldPoint::new(x, y, z)).unwrap());
            seen.map(|at| Pixel::new(at.u + normal(&mut random), at.v + normal(&mut random))).to_vec()
        };
        let verticals = [(-3.0, 4.0), (-3.0, 7.0), (3.0, 5.0), (3.0, 8.0), (-1.0, 9.0)]
            .map(|(x, y)| line([[x, y, 0.0], [x, y, 1.8]]));
        let along = [-1.8, -0.8, 0.7, 1.7].map(|x| line([[x, 3.0, 0.0], [x + 1.0, 9.0, 0.0]]));
        let across = [3.2, 4.2, 5.4, 7.0].map(|y| line([[-2.4, y + 0.4, 0.0], [2.4, y - 0.4, 0.0]]));
        let parallel = |id: &str, lines: [Vec<Pixel>; 4]| Annotation {
            id: Some(id.into()),
            ..Annotation::from_segments(Kind::Parallel, lines.to_vec())
        };
        let annotations = vec![
            Annotation::from_segments(Kind::Vertical, verticals.to_vec()),
            parallel("along", along),
            Annotation { at_right_angles_to: Some("along".into()), ..parallel("across", across) },
        ];
        SiteCamera { annotations, ..SiteCamera::new("turret", SIZE) }
    }

    fn field_of_view(focal: f64) -> LensEntry {
        let degrees = 2.0 * (960.0 / focal).atan().to_degrees();
        LensEntry { hfov_deg: Some(Nominal::Number(degrees)), ..LensEntry::default() }
    }

    fn millimetres(focal: f64) -> LensEntry {
        let sensor_mm = Some([5.6, 3.15]);
        LensEntry { focal_mm: Some(Nominal::Number(focal * 5.6 / 1920.0)), sensor_mm, ..LensEntry::default() }
    }

    fn solve(camera: SiteCamera) -> (Solution, Vec<Finding>) {
        let report = Site { cameras: vec![camera], ..Site::new() }.calibrate(&Options::default());
        let (mut cameras, mut findings) = (report.cameras, report.findings);
        (cameras.remove(0).1.unwrap(), findings.remove(0).unwrap())
    }

    fn with_lens(camera: SiteCamera, lens: LensEntry) -> SiteCamera {
        SiteCamera { lens: Some(lens), ..camera }
    }

    fn reports(findings: &[Finding], code: Code) -> bool {
        findings.iter().any(|finding| finding.code() == code)
    }

    #[test]
    fn correct_data_sheet_is_not_reported() {
        for seed in 0..8 {
            for lens in [field_of_view(FOCAL), millimetres(1.03 * FOCAL), millimetres(0.96 * FOCAL)] {
                let (_, findings) = solve(with_lens(turret(seed), lens));
                assert!(!reports(&findings, Code::FocalConflict), "{seed}: {findings:?}");
            }
        }
    }

    #[test]
    fn data_sheet_that_is_wrong_by_30_percent_is_reported_first() {
        for seed in 0..4 {
            for lens in [field_of_view(1.3 * FOCAL), millimetres(1.3 * FOCAL), field_of_view(0.7 * FOCAL)] {
                let (solution, findings) = solve(with_lens(turret(seed), lens.clone()));
                let Finding::DataSheetConflict { entered, entered_sigma, estimated, sigma } = findings[0]
                else {
                    panic!("{lens:?}: {findings:?}");
                };
                let factor = if entered > FOCAL { 1.3 } else { 0.7 };
                // The focal length from a field of view depends slightly on the principal point.
                assert!((entered / (factor * FOCAL) - 1.0).abs() < 0.01, "{entered}");
                assert!((entered_sigma.unwrap() / entered - 0.03).abs() < 1e-9, "{entered_sigma:?}");
                assert!(
                    (estimated - FOCAL).abs() < 3.0 * sigma && sigma < 0.05 * FOCAL,
                    "{estimated} {sigma}"
                );
                assert!(!reports(&findings, Code::PrincipalPoint), "{findings:?}");
                let text = format!(
                    "{entered:.0} \u{b1} {:.0} px, but the lines give {estimated:.0}",
                    0.03 * entered
                );
                assert!(solution.warnings[0].message.contains(&text), "{:?}", solution.warnings);
                assert!(solution.warnings[0].code.fails_check());
            }
        }
    }

    #[test]
    fn fixed_data_sheet_is_compared_without_a_tolerance() {
        let fixed = |focal: f64| LensEntry {
            focal_mm: Some(Nominal::Known(Known::fixed(focal * 5.6 / 1920.0))),
            ..millimetres(focal)
        };
        let (solution, findings) = solve(with_lens(turret(1), fixed(1.3 * FOCAL)));
        assert!(
            matches!(findings[0], Finding::DataSheetConflict { entered_sigma: None, .. }),
            "{findings:?}"
        );
        assert!(solution.warnings[0].message.contains("of 1086 px, but"), "{:?}", solution.warnings);
        let (_, findings) = solve(with_lens(turret(1), fixed(FOCAL)));
        assert!(!reports(&findings, Code::FocalConflict), "{findings:?}");
    }

    #[test]
    fn lines_that_do_not_determine_the_focal_length_report_nothing() {
        for seed in 0..4 {
            for lens in [field_of_view(1.3 * FOCAL), millimetres(0.7 * FOCAL)] {
                let mut camera = with_lens(turret(seed), lens);
                camera.annotations.truncate(1);
                let report = Site { cameras: vec![camera], ..Site::new() }.calibrate(&Options::default());
                let findings = report.findings[0].clone().unwrap_or_default();
                assert!(!reports(&findings, Code::FocalConflict), "{findings:?}");
            }
        }
    }

    #[test]
    fn entered_focal_length_has_priority_and_is_not_compared() {
        let focal_px = Some(Known::prior(FOCAL, 30.0));
        let lens = LensEntry { focal_px, ..millimetres(1.3 * FOCAL) };
        let (_, findings) = solve(with_lens(turret(2), lens));
        assert!(!reports(&findings, Code::FocalConflict), "{findings:?}");
    }

    /// Solves `count` random cameras, and returns the numbers of solved and of reported cameras. Their principal
    /// points deviate from the image centre by a usual amount. The focal length of the data sheet is wrong by
    /// `factor`, in addition to the usual error.
    fn reported_random_cameras(count: usize, factor: f64) -> (usize, usize) {
        let mut random = ChaCha8Rng::seed_from_u64(45);
        let (mut solved, mut reported) = (0, 0);
        for index in 0..count {
            let drawn = if index % 2 == 0 { AnnotationSet::Directions } else { AnnotationSet::Lengths };
            let scene = RandomScene::new(&mut random, drawn, None, None);
            let [du, dv] = [0, 1].map(|_| 42.0 * normal(&mut random));
            let mut annotations = scene.noisy(&mut random, 1.0);
            let pixels =
                annotations.iter_mut().flat_map(|drawn| drawn.segments.iter_mut().flatten().flatten());
            pixels.for_each(|pixel| *pixel = Pixel::new(pixel.u + du, pixel.v + dv));
            let lens = millimetres(factor * scene.camera.focal * (1.0 + 0.03 * normal(&mut random)));
            let camera = SiteCamera { annotations, ..SiteCamera::new("a", SIZE) };
            let site = Site { cameras: vec![with_lens(camera, lens)], ..Site::new() };
            let Ok(findings) = site.calibrate(&Options::default()).findings.remove(0) else { continue };
            solved += 1;
            reported += usize::from(reports(&findings, Code::FocalConflict));
        }
        (solved, reported)
    }

    #[test]
    fn random_cameras_are_reported_if_the_data_sheet_is_wrong() {
        let (solved, reported) = reported_random_cameras(150, 1.0);
        assert!(solved > 140 && reported <= 2, "{reported} of {solved}");
        let (solved, reported) = reported_random_cameras(60, 1.3);
        assert!(10 * reported > 8 * solved, "{reported} of {solved}");
    }
}
