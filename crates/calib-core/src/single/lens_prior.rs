//! What is believed of lenses before anything is drawn: normal priors on the coefficients of the Brown-Conrady
//! model, with coordinates divided by half the diagonal of the image, and on those of the Kannala-Brandt model with the
//! principal point, where it is open.
//!
//! Published calibrations of cameras from 45 to 100 degrees (KITTI, `EuRoC`, TUM RGB-D, MEVA, the samples of `OpenCV`)
//! have k1 between -0.27 and 0.16, of barrels k2 within 0.1 of k1 squared, and |p1|, |p2| below 0.003. So where
//! edges say little of k2 and k3, these stay small, and the uncertainty of the corners is that of lenses.

use crate::camera::{Coefficient, Distortion, DistortionModel, ImageCircle, Lens, Pixel};

/// Standard deviations of k1, of k2 less the square of a negative k1, of k3, and of p1 and p2.
const K1: f64 = 0.2;
const K2: f64 = 0.1;
const K3: f64 = 0.1;
const TANGENTIAL: f64 = 0.003;

/// Standard deviations of k1 to k4 of a fisheye. Of the families that lenses are designed by, k1 and k2 are 0 and 0
/// (equidistant), -0.042 and 0.0005 (equisolid), 0.083 and 0.008 (stereographic).
const FISHEYE: [f64; 4] = [0.07, 0.03, 0.01, 0.003];

/// Standard deviation of the log of the slope, `d radius / d angle` over that at the axis: at right angles to the axis it
/// is 0, -0.35 and 0.69 of the families. None turns back where it shows something; one that did near the outermost points
/// that are drawn would have all that they say.
const FISHEYE_SLOPE: f64 = 0.6;

/// Standard deviation of a principal point from the middle of the image, as a share of the image's diagonal: sensors of
/// small fisheyes sit some percent beside their lens.
const CENTRE: f64 = 0.02;

/// That from the middle of the image circle, as a share of its radius: the rim is that of a stop or of the mount, which sits
/// a little beside the glass.
const CENTRE_OF_CIRCLE: f64 = 0.01;

/// `(value - expected) / sigma` of one parameter, with its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LensResidual {
    pub(crate) value: f64,
    pub(crate) by: [f64; Lens::PARAMETERS],
    pub(crate) sigma: f64,
}

/// The residuals of these parameters of a lens, by their indices; none of the division model.
pub(crate) fn lens_prior(
    lens: &Lens,
    (size, circle): ([f64; 2], Option<ImageCircle>),
    fitted: &[usize],
) -> Vec<LensResidual> {
    let brown = match lens.distortion {
        Distortion::BrownConrady(brown) => brown,
        Distortion::KannalaBrandt { k } => {
            return fisheye_prior(&k, lens.principal_point, centre_belief(size, circle), fitted);
        }
        _ => return Vec::new(),
    };
    let row = DistortionModel::BrownConrady.row();
    // Coefficients of r^n in units of half the diagonal are those in units of the focal times this to the n.
    let ratio = 0.5 * size[0].hypot(size[1]) / lens.focal;
    let square = ratio * ratio;
    let place = |of: Coefficient| row.coefficients.iter().position(|&named| named == of);
    let residual = |&index: &usize| {
        let mut by = [0.0; Lens::PARAMETERS];
        let (value, scale, sigma) = match row.coefficients[index] {
            Coefficient::K1 => (square * brown.k1, square, K1),
            Coefficient::K2 => {
                let k1 = square * brown.k1.min(0.0);
                if let Some(first) = place(Coefficient::K1) {
                    by[first] = -2.0 * k1 * square / K2;
                }
                (square * square * brown.k2 - k1 * k1, square * square, K2)
            }
            Coefficient::K3 => (square.powi(3) * brown.k3, square.powi(3), K3),
            Coefficient::P1 => (ratio * brown.p1, ratio, TANGENTIAL),
            _ => (ratio * brown.p2, ratio, TANGENTIAL),
        };
        by[index] += scale / sigma;
        LensResidual { value: value / sigma, by, sigma: sigma / scale }
    };
    fitted.iter().map(residual).collect()
}

/// Where the principal point of a fisheye is believed to be, and its standard deviation, in pixels.
fn centre_belief([w, h]: [f64; 2], circle: Option<ImageCircle>) -> (Pixel, f64) {
    let of_image = || (Pixel::new(0.5 * w, 0.5 * h), CENTRE * w.hypot(h));
    circle.map_or_else(of_image, |circle| (circle.centre(), CENTRE_OF_CIRCLE * circle.radius))
}

/// Those of a fisheye, as near to equidistant as the lenses that are built, and about where its middle is believed.
fn fisheye_prior(
    k: &[f64; 4],
    centre: Pixel,
    (believed, of_centre): (Pixel, f64),
    fitted: &[usize],
) -> Vec<LensResidual> {
    let residual = |&index: &usize| {
        let (off, sigma) = match index {
            Lens::OWN_FOCAL => return None,
            Lens::CENTRE => (centre.u - believed.u, of_centre),
            coefficient if coefficient < FISHEYE.len() => (k[coefficient], FISHEYE[coefficient]),
            _ => (centre.v - believed.v, of_centre),
        };
        let mut by = [0.0; Lens::PARAMETERS];
        by[index] = sigma.recip();
        Some(LensResidual { value: off / sigma, by, sigma })
    };
    fitted.iter().filter_map(residual).collect()
}

/// What is believed of the slope of a fisheye at the outermost point that is drawn in it; `None` for other lenses.
/// Infinite where it shows nothing there.
pub(crate) fn slope_prior(lens: &Lens, outermost: Option<Pixel>) -> Option<LensResidual> {
    let pixel = outermost.filter(|_| lens.distortion.is_wide())?;
    let (log, by) = lens.log_slope(pixel).unwrap_or((f64::INFINITY, [0.0; Lens::PARAMETERS]));
    Some(LensResidual { value: log / FISHEYE_SLOPE, by: by.map(|by| by / FISHEYE_SLOPE), sigma: 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::BrownConrady;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn derivatives_are_those_of_differences(k in [-0.4..0.2_f64, -0.3..0.3_f64, -0.2..0.2_f64], p in [-0.01..0.01_f64, -0.01..0.01_f64], focal in 400.0..3000.0_f64) {
            const STEP: f64 = 1e-6;
            let brown = BrownConrady { k1: k[0], k2: k[1], k3: k[2], p1: p[0], p2: p[1] };
            let lens = Lens { principal_point: Pixel::new(960.0, 540.0), focal, distortion: Distortion::BrownConrady(brown), image_circle: None };
            let all = [0, 1, 2, 3, 4];
            let size = [1920.0, 1080.0];
            let here = lens_prior(&lens, (size, None), &all);
            prop_assert_eq!(here.len(), 5);
            for k in all {
                let (ahead, behind) = (lens_prior(&lens.nudged(k, STEP), (size, None), &all), lens_prior(&lens.nudged(k, -STEP), (size, None), &all));
                for (i, residual) in here.iter().enumerate() {
                    let numeric = (ahead[i].value - behind[i].value) / (2.0 * STEP);
                    prop_assert!((numeric - residual.by[k]).abs() < 1e-3 * (1.0 + residual.by[k].abs()), "{i} by {k}: {numeric} {:?}", residual.by);
                }
            }
        }

        #[test]
        fn derivatives_of_the_slope_of_a_fisheye_are_those_of_differences(
            k in [-0.03..0.1_f64, -0.002..0.01_f64], focal in 500.0..900.0_f64, at in [0.0..1920.0_f64, 0.0..1920.0_f64],
        ) {
            const STEPS: [f64; Lens::PARAMETERS] = [1e-8, 1e-8, 1e-8, 1e-8, 1e-6, 1e-3, 1e-3];
            let distortion = Distortion::KannalaBrandt { k: [k[0], k[1], 0.0, 0.0] };
            let lens = Lens { principal_point: Pixel::new(950.0, 970.0), focal, distortion, image_circle: None };
            let at = Pixel::from(at);
            prop_assume!(at.distance(lens.principal_point) > 50.0);
            let slope = |lens: &Lens| slope_prior(lens, Some(at)).map(|prior| prior.value).unwrap();
            let here = slope_prior(&lens, Some(at)).unwrap();
            prop_assume!(here.value.abs() < 2.0);
            for (k, step) in STEPS.into_iter().enumerate() {
                let numeric = (slope(&lens.nudged(k, step)) - slope(&lens.nudged(k, -step))) / (2.0 * step);
                prop_assert!((numeric - here.by[k]).abs() < 1e-3 * (1.0 + here.by[k].abs()), "{k}: {numeric} {:?}", here.by);
            }
        }
    }
}
