//! Covariances in the site file: angles in degrees, and distortion coefficients that refer to the camera's
//! focal length.
//!
//! The file also contains the cross-covariances of jointly solved cameras, whose errors are correlated.

use calib_core::bundle::CrossCovariance;
use calib_core::camera::{Camera, Covariance, Distortion, Pixel};
use calib_core::outcome::Failure;

use crate::bundle_step::BundleResult;
use crate::camera_result::CameraResult;
use crate::document::Site;
use crate::site_solution::CrossCovarianceEntry;
use crate::solution::{CovarianceEntry, Sigmas, Stage};

/// Returns the factor from the internal unit of a parameter to its unit in files: degrees for angles.
pub(crate) fn unit_in_file(index: usize) -> f64 {
    if matches!(index, Covariance::YAW | Covariance::PITCH | Covariance::ROLL) {
        1_f64.to_degrees()
    } else {
        1.0
    }
}

/// Returns the name of a camera parameter in files, by its index in [`Covariance`].
pub(crate) fn parameter_name(index: usize, distortion: &Distortion) -> Option<&'static str> {
    let own = || match index {
        Covariance::CENTRE => Some("cx_px"),
        Covariance::ASPECT => Some("pixel_aspect"),
        index if index > Covariance::CENTRE => Some("cy_px"),
        _ => distortion.names().get(index.checked_sub(Covariance::LENS)?).map(|which| which.name()),
    };
    Covariance::NAMES.get(index).copied().or_else(own)
}

/// Returns the current name of a parameter; files of earlier versions have other names for the principal point.
fn current_name(name: &str) -> &str {
    match name {
        "principal_point_u_px" => "cx_px",
        "principal_point_v_px" => "cy_px",
        other => other,
    }
}

/// Computes the derivatives of the distortion coefficients in a file with respect to the internal
/// coefficients and to the focal length.
///
/// Coefficients in a file refer to the camera's focal length and change with it. Coefficients of a
/// [`Lens`](calib_core::camera::Lens) refer to a constant focal length, which is `ratio` times smaller than
/// the camera's.
pub(crate) fn file_jacobian(distortion: &Distortion, ratio: f64, focal: f64) -> [[f64; Covariance::SIZE]; 2] {
    let (powers, coefficients) = (distortion.focal_powers(), distortion.coefficients());
    let mut jacobian = [[1.0; Covariance::SIZE], [0.0; Covariance::SIZE]];
    for (i, &power) in powers.iter().enumerate() {
        jacobian[0][Covariance::LENS + i] = ratio.powi(power);
        jacobian[1][Covariance::LENS + i] = f64::from(power) * coefficients[i] * ratio.powi(power) / focal;
    }
    jacobian
}

impl CovarianceEntry {
    /// Converts the entry to a covariance in metres, radians and pixels, for a camera with this focal length
    /// and distortion. Parameters that the camera does not have are ignored.
    #[must_use]
    pub fn covariance(&self, focal: f64, distortion: &Distortion) -> Covariance {
        let index = |known: &String| {
            let name = current_name(known);
            (0..Covariance::SIZE).find(|&i| parameter_name(i, distortion) == Some(name))
        };
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
        let [scale, by_focal] = file_jacobian(distortion, 1.0, focal);
        covariance.with_correlated_shift(&scale, &by_focal.map(|jacobian| -jacobian))
    }

    /// Creates the entry of a diagonal covariance from standard deviations.
    pub(crate) fn from_sigmas(sigmas: &Sigmas) -> Self {
        let named: Vec<(&str, f64)> =
            sigmas.named_values().into_iter().filter_map(|(name, sigma)| Some((name, sigma?))).collect();
        let rows = named.iter().enumerate();
        let row = |(k, (_, sigma)): (usize, &(&str, f64))| {
            std::iter::once(sigma * sigma).chain(std::iter::repeat_n(0.0, named.len() - 1 - k))
        };
        Self {
            of: named.iter().map(|(name, _)| (*name).to_owned()).collect(),
            upper: rows.flat_map(row).collect(),
        }
    }

    /// Creates the entry from the covariance of a camera; `None` if no parameter was estimated or the uncertainty
    /// is unknown.
    #[must_use]
    pub fn from_camera(camera: &Camera) -> Option<Self> {
        let distortion = camera.lens.distortion;
        let [scale, by_focal] = file_jacobian(&distortion, camera.focal / camera.lens.focal, camera.focal);
        let covariance = camera.covariance.with_correlated_shift(&scale, &by_focal);
        let is_estimated =
            |&i: &usize| camera.covariance.sigma(i).is_some() && parameter_name(i, &distortion).is_some();
        let rows: Vec<usize> = (0..Covariance::SIZE).filter(is_estimated).collect();
        let value = |a: usize, b: usize| covariance.0[a][b] * unit_in_file(a) * unit_in_file(b);
        (!rows.is_empty()).then(|| Self {
            of: rows.iter().filter_map(|&i| parameter_name(i, &distortion).map(str::to_owned)).collect(),
            upper: rows
                .iter()
                .enumerate()
                .flat_map(|(k, &a)| rows[k..].iter().map(move |&b| value(a, b)))
                .collect(),
        })
    }
}

impl Sigmas {
    /// Returns the standard deviations with the names of their parameters.
    const fn named_values(&self) -> [(&'static str, Option<f64>); 17] {
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
            ("cx_px", self.cx_px),
            ("cy_px", self.cy_px),
            ("pixel_aspect", self.pixel_aspect),
        ]
    }

    /// Creates the entry from the diagonal of a camera's covariance and the relative error of floor lengths.
    #[must_use]
    pub fn from_camera(camera: &Camera, floor_length_rel: Option<f64>) -> Self {
        let entry = CovarianceEntry::from_camera(camera);
        let (names, upper) = entry.as_ref().map_or((&[][..], &[][..]), |e| (&e.of[..], &e.upper[..]));
        let sigma = |known: &str| {
            let row = names.iter().position(|name| name == known)?;
            // Each row of an upper triangle is shorter by one than the row before.
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
            cx_px: sigma("cx_px"),
            cy_px: sigma("cy_px"),
            pixel_aspect: sigma("pixel_aspect"),
            floor_length_rel,
        }
    }
}

/// Derivatives of the parameters in a file with respect to the parameters of a camera.
struct FileJacobian {
    /// Indices and names of the estimated parameters.
    rows: Vec<(usize, &'static str)>,
    /// Derivative of each parameter with respect to the same parameter of the camera.
    by_own: [f64; Covariance::SIZE],
    /// Derivative of each parameter with respect to the focal length of the camera.
    by_focal: [f64; Covariance::SIZE],
}

impl FileJacobian {
    fn new(camera: &Camera) -> Self {
        let distortion = camera.lens.distortion;
        let [by_own, by_focal] = file_jacobian(&distortion, camera.focal / camera.lens.focal, camera.focal);
        let is_estimated = |&index: &usize| camera.covariance.sigma(index).is_some();
        let named = |index: usize| Some((index, parameter_name(index, &distortion)?));
        let rows = (0..Covariance::SIZE).filter(is_estimated).filter_map(named).collect();
        Self { rows, by_own, by_focal }
    }

    fn names(&self) -> Vec<String> {
        self.rows.iter().map(|(_, name)| (*name).to_owned()).collect()
    }
}

impl CrossCovarianceEntry {
    fn new(ids: [&str; 2], cameras: [&Camera; 2], covariance: &CrossCovariance) -> Self {
        let [a, b] = cameras.map(FileJacobian::new);
        // The same conversion as for one camera, with rows from the first camera and columns from the second.
        let row = |i: usize, j: usize| {
            a.by_own[i] * covariance[i][j] + a.by_focal[i] * covariance[Covariance::FOCAL][j]
        };
        let value = |i: usize, j: usize| {
            let both = b.by_own[j] * row(i, j) + b.by_focal[j] * row(i, Covariance::FOCAL);
            both * unit_in_file(i) * unit_in_file(j)
        };
        let of_row = |&(i, _): &(usize, &'static str)| b.rows.iter().map(move |&(j, _)| (i, j));
        Self {
            cameras: ids.map(str::to_owned),
            rows: a.names(),
            columns: b.names(),
            values: a.rows.iter().flat_map(of_row).map(|(i, j)| value(i, j)).collect(),
        }
    }

    /// Converts the entry to a matrix in metres, radians and pixels. Parameters that the cameras do not have
    /// are ignored.
    fn covariance(&self, cameras: [&Camera; 2]) -> CrossCovariance {
        let [a, b] = cameras;
        let index = |camera: &Camera, known: &String| {
            (0..Covariance::SIZE)
                .find(|&i| parameter_name(i, &camera.lens.distortion) == Some(current_name(known)))
        };
        let columns: Vec<Option<usize>> = self.columns.iter().map(|known| index(b, known)).collect();
        let mut found = Box::new([[0.0; Covariance::SIZE]; Covariance::SIZE]);
        for (known, values) in self.rows.iter().zip(self.values.chunks(columns.len().max(1))) {
            let Some(i) = index(a, known) else { continue };
            for (&column, value) in columns.iter().zip(values) {
                let Some(j) = column else { continue };
                found[i][j] = value / unit_in_file(i) / unit_in_file(j);
            }
        }
        // Converts coefficients for the camera's focal length to coefficients for a constant focal length.
        let by_focal = cameras.map(|camera| file_jacobian(&camera.lens.distortion, 1.0, camera.focal)[1]);
        for i in Covariance::LENS..Covariance::SIZE {
            for j in 0..Covariance::SIZE {
                found[i][j] -= by_focal[0][i] * found[Covariance::FOCAL][j];
            }
        }
        for row in found.iter_mut() {
            for j in Covariance::LENS..Covariance::SIZE {
                row[j] -= by_focal[1][j] * row[Covariance::FOCAL];
            }
        }
        found
    }

    /// Returns the entry with the two cameras exchanged.
    fn swapped(&self) -> Self {
        let (height, width) = (self.rows.len(), self.columns.len());
        let at = |i: usize, j: usize| self.values.get(j * width + i).copied().unwrap_or(0.0);
        let [a, b] = self.cameras.clone();
        Self {
            cameras: [b, a],
            rows: self.columns.clone(),
            columns: self.rows.clone(),
            values: (0..width)
                .flat_map(|i| (0..height).map(move |j| (i, j)))
                .map(|(i, j)| at(i, j))
                .collect(),
        }
    }
}

impl Site {
    /// Returns the entries of the cross-covariances of jointly solved cameras.
    pub(crate) fn cross_covariances(
        &self,
        bundle: &BundleResult,
        results: &[(usize, Result<CameraResult, Failure>)],
    ) -> Vec<CrossCovarianceEntry> {
        let camera = |index: usize| {
            let (_, result) = results.iter().find(|(of, _)| *of == index)?;
            result.as_ref().ok()?.solution.camera().filter(|camera| camera.covariance.is_known())
        };
        let mut pairs: Vec<_> = bundle.pairs.iter().collect();
        pairs.sort_by_key(|(pair, _)| **pair);
        let entry = |(&[a, b], covariance): (&[usize; 2], &CrossCovariance)| {
            let ids = [a, b].map(|index| self.cameras[index].id.as_str());
            Some(CrossCovarianceEntry::new(ids, [&camera(a)?, &camera(b)?], covariance))
        };
        pairs.into_iter().filter_map(entry).filter(|entry| !entry.values.is_empty()).collect()
    }

    /// Returns the covariance between the floor points of two pixels in two cameras, in square metres. Rows
    /// belong to the first camera, columns to the second. The result is the calibration part of the
    /// covariance, which jointly solved cameras share. A tracker that treats the two points as independent
    /// overestimates the accuracy of their mean.
    ///
    /// Cameras that were not solved jointly are independent. Returns `None` if a camera has no solution,
    /// shows no floor at the pixel, or has an unknown uncertainty. In groups of more than 45 cameras it also
    /// returns `None` for two cameras without shared observations, because the file does not contain their
    /// covariance.
    #[must_use]
    pub fn floor_covariance_between(&self, [a, b]: [(&str, Pixel); 2]) -> Option<[[f64; 2]; 2]> {
        let for_use = |id: &str| self.camera_for_use(self.camera(id)?);
        let cameras = [for_use(a.0)?, for_use(b.0)?];
        let [here, there] = [cameras[0].floor_jacobian(a.1)?, cameras[1].floor_jacobian(b.1)?];
        if !cameras.iter().all(|camera| camera.covariance.is_known()) {
            return None;
        }
        let covariance = self.covariance_between([a.0, b.0], [&cameras[0], &cameras[1]])?;
        Some(std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let row =
                    |k: usize| covariance[k].iter().zip(&there).map(|(value, by)| value * by[j]).sum::<f64>();
                (0..Covariance::SIZE).map(|k| here[k][i] * row(k)).sum()
            })
        }))
    }

    /// Whether a camera has a joint solution.
    fn is_refined(&self, id: &str) -> bool {
        let entries = self.cameras.iter().filter(|entry| entry.id == id);
        entries.filter_map(|entry| entry.solution.as_ref()).any(|solution| solution.stage == Stage::Refined)
    }

    /// Returns the cross-covariance of the parameters of two cameras, or the covariance if both are the same
    /// camera. The result is zero if the cameras were not solved jointly, and `None` if it is unknown.
    pub(crate) fn covariance_between(
        &self,
        [a, b]: [&str; 2],
        cameras: [&Camera; 2],
    ) -> Option<CrossCovariance> {
        if a == b {
            return Some(Box::new(cameras[0].covariance.0));
        }
        let solution = self.solution.as_ref();
        let entries = solution.map_or(&[][..], |solution| &solution.cross_covariances[..]);
        let of = |entry: &&CrossCovarianceEntry, ids: [&str; 2]| {
            entry.cameras.each_ref().map(String::as_str) == ids
        };
        if let Some(entry) = entries.iter().find(|entry| of(entry, [a, b])) {
            return Some(entry.covariance(cameras));
        }
        if let Some(entry) = entries.iter().find(|entry| of(entry, [b, a])) {
            return Some(entry.swapped().covariance(cameras));
        }
        let is_tied = |group: &Vec<String>| [a, b].iter().all(|id| group.iter().any(|other| other == id));
        let tied = match solution {
            Some(solution) => solution.components.iter().any(is_tied),
            // The joint solution is out of date: its cameras are correlated, but the correlation is lost.
            None => {
                [a, b].iter().all(|id| self.is_refined(id))
                    && cameras.iter().any(|camera| camera.covariance != Covariance::EXACT)
            }
        };
        (!tied).then(|| Box::new([[0.0; Covariance::SIZE]; Covariance::SIZE]))
    }
}
