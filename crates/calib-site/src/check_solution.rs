//! Checks of lenses, and of what solving wrote into a site.

use crate::bounds::{At, Bounds, Checked, count, optional};
use crate::site_error::quoted;
use crate::solution::{CovarianceEntry, DistortionEntry, Solution, Stage};
use calib_core::camera::{Coefficient, ImageCircle};

/// Most corners of an EFOV on the floor: eight for every corner drawn, and those of clipping.
const MAX_CORNERS: usize = 10_000;

/// Whether an image circle has a radius, and can be written and read again.
pub(crate) fn check_circle(at: &At, circle: ImageCircle) -> Checked {
    Bounds::COORDINATE.check_all(at, &<[f64; 3]>::from(circle))?;
    if circle.radius > 0.0 {
        return Ok(());
    }
    at.expected(
        format!("a radius of {}", circle.radius),
        "u and v of its middle and a radius above 0, in pixels",
    )
}

/// Whether a solution can be written and read again.
pub(crate) fn check_solution(at: &At, solution: &Solution) -> Checked {
    Bounds { low: 1e-6, ..Bounds::POSITIVE }.check(&at.key("focal_px"), solution.focal_px)?;
    let point = <[f64; 2]>::from(solution.principal_point_px);
    Bounds::COORDINATE.check_all(&at.key("principal_point_px"), &point)?;
    if let Some(circle) = solution.image_circle_px {
        check_circle(&at.key("image_circle_px"), circle)?;
    }
    let pose = [
        ("position_m", solution.position_m.is_some()),
        ("yaw_deg", solution.yaw_deg.is_some()),
        ("pitch_deg", solution.pitch_deg.is_some()),
        ("roll_deg", solution.roll_deg.is_some()),
    ];
    for (key, is_there) in pose {
        if !is_there && solution.stage != Stage::Lens {
            return at.expected(format!("no {key:?}"), "the pose, at every stage but \"lens\"");
        }
    }
    if let Some(position) = solution.position_m {
        Bounds::COORDINATE.check_all(&at.key("position_m"), &<[f64; 3]>::from(position))?;
    }
    let angles = [solution.yaw_deg, solution.pitch_deg, solution.roll_deg];
    for (key, angle) in ["yaw_deg", "pitch_deg", "roll_deg"].into_iter().zip(angles) {
        optional(&at.key(key), angle, Bounds::DEGREES)?;
    }
    if let Some(distortion) = &solution.distortion {
        check_distortion(&at.key("distortion"), distortion, Some(solution.focal_px))?;
    }
    let efov = at.key("efov_m");
    count(&efov, solution.efov_m.len(), MAX_CORNERS)?;
    for (i, &point) in solution.efov_m.iter().enumerate() {
        Bounds::COORDINATE.check_all(&efov.index(i), &<[f64; 2]>::from(point))?;
    }
    solution.covariance.as_ref().map_or(Ok(()), |c| check_covariance(&at.key("covariance"), c))
}

fn check_covariance(at: &At, covariance: &CovarianceEntry) -> Checked {
    let n = covariance.of.len();
    count(&at.key("of"), n, 100)?;
    let expected = n * (n + 1) / 2;
    if covariance.upper.len() != expected {
        let found = format!("{} numbers", covariance.upper.len());
        return at.key("upper").expected(found, format!("{expected}: the upper triangle of {n} by {n}"));
    }
    let broken = covariance.upper.iter().position(|value| !value.is_finite());
    if let Some(i) = broken {
        return at.key("upper").index(i).expected(covariance.upper[i], "a number");
    }
    // Row by row, the diagonal is the first of each row.
    let mut first = 0;
    for row in 0..n {
        if covariance.upper[first] < 0.0 {
            return at.key("upper").index(first).expected(covariance.upper[first], "a variance, not below 0");
        }
        first += n - row;
    }
    Ok(())
}

pub(crate) fn check_distortion(at: &At, entry: &DistortionEntry, focal: Option<f64>) -> Checked {
    let mut given = false;
    let own = entry.model.row().coefficients;
    for which in Coefficient::ALL {
        let (key, Some(value)) = (which.name(), entry.coefficient(which)) else { continue };
        given = true;
        if !own.contains(&which) {
            return at.key(key).expected(format!("a coefficient {key}"), "only those that this model has");
        }
        let [low, high] = which.bounds();
        let what = match which {
            Coefficient::Xi => "a number above -1 and up to 1e6",
            Coefficient::Alpha => "a number between 0 and 1",
            _ => "a number between -1e6 and 1e6",
        };
        Bounds { low, high, what }.check(&at.key(key), value)?;
    }
    optional(&at.key("focal_px"), entry.focal_px, Bounds { low: 1.0, ..Bounds::POSITIVE })?;
    if let Some(fit) = &entry.fit {
        if given {
            return at.key("fit").expected("\"fit\" beside coefficients", "one of them: fitted, or given");
        }
        for (i, wanted) in fit.iter().enumerate() {
            if !own.contains(wanted) || fit[..i].contains(wanted) {
                let found = quoted(wanted.name());
                return at.key("fit").index(i).expected(found, "coefficients of this model, each once");
            }
        }
    }
    if !given && !entry.model.row().is_fitted {
        let found = format!("{} without coefficients", entry.model.row().name);
        return at.expected(found, "its coefficients: it is given, and not fitted");
    }
    if given && entry.focal_px.is_none() && focal.is_none() {
        return at.expected(
            "coefficients without a focal",
            "\"focal_px\" here, which they refer to, or in the lens",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::Site;
    use calib_core::camera::Distortion;

    fn site(distortion: &str) -> Result<Site, String> {
        let text = format!(
            r#"{{"format": "calib-site", "version": 1, "cameras": [{{"id": "a", "size_px": [640, 480],
            "lens": {{"distortion": {distortion}}}, "annotations": []}}]}}"#
        );
        Site::from_json(&text).map_err(|error| error.to_string())
    }

    #[test]
    fn spheres_are_given_with_coefficients_of_a_lens() {
        let lens = |text: &str| site(text).map(|site| site.cameras[0].lens());
        let unified = lens(r#"{"model": "unified", "xi": 1.1, "focal_px": 300}"#);
        assert!(
            unified
                .is_ok_and(|lens| lens.distortion == Distortion::Unified { xi: 1.1 } && lens.focal == 300.0)
        );
        let double = lens(r#"{"model": "double-sphere", "xi": -0.2, "alpha": 0.6, "focal_px": 300}"#);
        assert!(
            double.is_ok_and(|lens| lens.distortion == Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 })
        );
        for (text, word) in [
            (r#"{"model": "unified", "xi": -1.0, "focal_px": 300}"#, "above -1"),
            (r#"{"model": "double-sphere", "xi": 0.0, "alpha": 1.1, "focal_px": 300}"#, "between 0 and 1"),
            (r#"{"model": "unified", "xi": 1.0, "alpha": 0.5, "focal_px": 300}"#, "this model has"),
            (r#"{"model": "unified", "fit": ["xi"]}"#, "not fitted"),
            (r#"{"model": "double-sphere"}"#, "not fitted"),
            (r#"{"model": "unified", "xi": 1.0}"#, "focal"),
        ] {
            let error = site(text).err().unwrap_or_default();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
