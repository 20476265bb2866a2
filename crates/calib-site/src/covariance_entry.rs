//! Covariances in files: degrees for radians, and coefficients of a distortion for the focal of the camera.

use crate::solution::{CovarianceEntry, Sigmas};
use calib_core::camera::{Camera, Covariance, Distortion};

/// Files have degrees where the code has radians.
pub(crate) fn unit_in_file(index: usize) -> f64 {
    if matches!(index, Covariance::YAW | Covariance::PITCH | Covariance::ROLL) {
        1_f64.to_degrees()
    } else {
        1.0
    }
}

/// Name of an unknown in files.
pub(crate) fn name(index: usize, distortion: &Distortion) -> Option<&'static str> {
    let own = || match index {
        Covariance::CENTRE => Some("principal_point_u_px"),
        index if index > Covariance::CENTRE => Some("principal_point_v_px"),
        _ => distortion.names().get(index.checked_sub(Covariance::LENS)?).map(|which| which.name()),
    };
    Covariance::NAMES.get(index).copied().or_else(own)
}

/// The coefficients in a file are those for the camera's focal and change with it; those of a
/// [`Lens`](calib_core::Lens) are for a focal that stays. The derivatives of the former by the latter and by the focal,
/// where the latter are for a focal `ratio` times smaller.
pub(crate) fn in_file(distortion: &Distortion, ratio: f64, focal: f64) -> [[f64; Covariance::SIZE]; 2] {
    let (powers, coefficients) = (distortion.powers(), distortion.coefficients());
    let mut jacobian = [[1.0; Covariance::SIZE], [0.0; Covariance::SIZE]];
    for (i, &power) in powers.iter().enumerate() {
        jacobian[0][Covariance::LENS + i] = ratio.powi(power);
        jacobian[1][Covariance::LENS + i] = f64::from(power) * coefficients[i] * ratio.powi(power) / focal;
    }
    jacobian
}

impl CovarianceEntry {
    /// The matrix in metres, radians and pixels of a camera with this focal and distortion; names that
    /// are not of the camera are left out.
    #[must_use]
    pub fn covariance(&self, focal: f64, distortion: &Distortion) -> Covariance {
        let index = |known: &String| (0..Covariance::SIZE).find(|&i| name(i, distortion) == Some(known));
        let rows: Vec<Option<usize>> = self.of.iter().map(index).collect();
        let mut covariance = Covariance::EXACT;
        let mut upper = self.upper.iter();
        for (i, &a) in rows.iter().enumerate() {
            for &b in &rows[i..] {
                let value = upper.next().copied().unwrap_or(0.0);
                if let (Some(a), Some(b)) = (a, b) {
                    covariance.0[a][b] = value / unit_in_file(a) / unit_in_file(b);
                    covariance.0[b][a] = covariance.0[a][b];
                }
            }
        }
        let [scale, by_focal] = in_file(distortion, 1.0, focal);
        covariance.sheared(&scale, &by_focal.map(|jacobian| -jacobian))
    }

    /// The entry of independent errors.
    pub(crate) fn diagonal(sigmas: &Sigmas) -> Self {
        let named: Vec<(&str, f64)> =
            sigmas.named().into_iter().filter_map(|(name, sigma)| Some((name, sigma?))).collect();
        let rows = named.iter().enumerate();
        let row = |(k, (_, sigma)): (usize, &(&str, f64))| {
            std::iter::once(sigma * sigma).chain(std::iter::repeat_n(0.0, named.len() - 1 - k))
        };
        Self {
            of: named.iter().map(|(name, _)| (*name).to_owned()).collect(),
            upper: rows.flat_map(row).collect(),
        }
    }

    /// The entry of everything that was estimated; `None` when nothing was, or nothing is known of the errors.
    #[must_use]
    pub fn of(camera: &Camera) -> Option<Self> {
        let distortion = camera.lens.distortion;
        let [scale, by_focal] = in_file(&distortion, camera.focal / camera.lens.focal, camera.focal);
        let covariance = camera.covariance.sheared(&scale, &by_focal);
        let is_estimated =
            |&i: &usize| camera.covariance.sigma(i).is_some() && name(i, &distortion).is_some();
        let rows: Vec<usize> = (0..Covariance::SIZE).filter(is_estimated).collect();
        let value = |a: usize, b: usize| covariance.0[a][b] * unit_in_file(a) * unit_in_file(b);
        (!rows.is_empty()).then(|| Self {
            of: rows.iter().filter_map(|&i| name(i, &distortion).map(str::to_owned)).collect(),
            upper: rows
                .iter()
                .enumerate()
                .flat_map(|(k, &a)| rows[k..].iter().map(move |&b| value(a, b)))
                .collect(),
        })
    }
}

impl Sigmas {
    /// The standard deviations with the names of what they are of.
    const fn named(&self) -> [(&'static str, Option<f64>); 16] {
        [
            ("x_m", self.x_m),
            ("y_m", self.y_m),
            ("z_m", self.z_m),
            ("yaw_deg", self.yaw_deg),
            ("pitch_deg", self.pitch_deg),
            ("roll_deg", self.roll_deg),
            ("focal_px", self.focal_px),
            ("k1", self.k1),
            ("k2", self.k2),
            ("k3", self.k3),
            ("k4", self.k4),
            ("p1", self.p1),
            ("p2", self.p2),
            ("lambda", self.lambda),
            ("principal_point_u_px", self.principal_point_u_px),
            ("principal_point_v_px", self.principal_point_v_px),
        ]
    }

    /// The diagonal of a camera's covariance as files have it, and the error of floor lengths.
    #[must_use]
    pub fn of(camera: &Camera, floor_length_rel: Option<f64>) -> Self {
        let entry = CovarianceEntry::of(camera);
        let (names, upper) = entry.as_ref().map_or((&[][..], &[][..]), |e| (&e.of[..], &e.upper[..]));
        let sigma = |known: &str| {
            let row = names.iter().position(|name| name == known)?;
            // Rows of an upper triangle grow shorter by one.
            let diagonal = (0..row).map(|i| names.len() - i).sum::<usize>();
            upper.get(diagonal).map(|variance| variance.max(0.0).sqrt())
        };
        Self {
            x_m: sigma("x_m"),
            y_m: sigma("y_m"),
            z_m: sigma("z_m"),
            yaw_deg: sigma("yaw_deg"),
            pitch_deg: sigma("pitch_deg"),
            roll_deg: sigma("roll_deg"),
            focal_px: sigma("focal_px"),
            k1: sigma("k1"),
            k2: sigma("k2"),
            k3: sigma("k3"),
            k4: sigma("k4"),
            p1: sigma("p1"),
            p2: sigma("p2"),
            lambda: sigma("lambda"),
            principal_point_u_px: sigma("principal_point_u_px"),
            principal_point_v_px: sigma("principal_point_v_px"),
            floor_length_rel,
        }
    }
}
