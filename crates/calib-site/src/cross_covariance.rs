//! Covariances of cameras with each other: what a joint solve ties together errs together.

use crate::bundle_step::BundleResult;
use crate::camera_result::CameraResult;
use crate::covariance_entry::{in_file, name, unit_in_file};
use crate::document::Site;
use crate::site_solution::CrossCovarianceEntry;
use calib_core::bundle::CrossCovariance;
use calib_core::camera::{Camera, Covariance, Pixel};
use calib_core::outcome::Failure;

/// Derivatives of what files have by the parameters of a camera.
struct InFile {
    /// The parameters that were estimated, and their names.
    rows: Vec<(usize, &'static str)>,
    by_own: [f64; Covariance::SIZE],
    by_focal: [f64; Covariance::SIZE],
}

impl InFile {
    fn new(camera: &Camera) -> Self {
        let distortion = camera.lens.distortion;
        let [by_own, by_focal] = in_file(&distortion, camera.focal / camera.lens.focal, camera.focal);
        let is_estimated = |&index: &usize| camera.covariance.sigma(index).is_some();
        let named = |index: usize| Some((index, name(index, &distortion)?));
        let rows = (0..Covariance::SIZE).filter(is_estimated).filter_map(named).collect();
        Self { rows, by_own, by_focal }
    }

    fn names(&self) -> Vec<String> {
        self.rows.iter().map(|(_, name)| (*name).to_owned()).collect()
    }
}

impl CrossCovarianceEntry {
    fn new(ids: [&str; 2], cameras: [&Camera; 2], covariance: &CrossCovariance) -> Self {
        let [a, b] = cameras.map(InFile::new);
        // As of one camera, but rows are of the one and columns of the other.
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

    /// The matrix in metres, radians and pixels; names that are not of the cameras are left out.
    fn covariance(&self, cameras: [&Camera; 2]) -> CrossCovariance {
        let [a, b] = cameras;
        let index = |camera: &Camera, known: &String| {
            (0..Covariance::SIZE).find(|&i| name(i, &camera.lens.distortion) == Some(known))
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
        // From coefficients for the camera's focal to those for a focal that stays.
        let by_focal = cameras.map(|camera| in_file(&camera.lens.distortion, 1.0, camera.focal)[1]);
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

    /// The same with the second camera first.
    fn turned(&self) -> Self {
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
    /// The covariances of the cameras that were solved together.
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

    /// The covariance of the floor point that one camera shows at a pixel (rows) with that which another shows
    /// (columns), in square metres: the part of the calibration, which two cameras share that were solved
    /// together. A tracker that takes them for independent believes in their mean too much.
    ///
    /// Cameras that no joint solve ties together are independent. `None` where a camera has no solution or
    /// shows no floor there, where nothing is known of its errors, and for two of over 45 cameras of one group that
    /// show nothing in common: of them the file does not have it.
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

    fn covariance_between(&self, [a, b]: [&str; 2], cameras: [&Camera; 2]) -> Option<CrossCovariance> {
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
            return Some(entry.turned().covariance(cameras));
        }
        let is_tied = |group: &Vec<String>| [a, b].iter().all(|id| group.iter().any(|other| other == id));
        let tied = solution.is_some_and(|solution| solution.components.iter().any(is_tied));
        (!tied).then(|| Box::new([[0.0; Covariance::SIZE]; Covariance::SIZE]))
    }
}
