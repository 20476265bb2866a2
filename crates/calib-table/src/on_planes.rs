//! The columns of a site with planes besides the floor: on which plane a point is, and how high.

use std::sync::Arc;

use arrow_array::builder::StringBuilder;
use arrow_array::{ArrayRef, Float64Array};
use calib_core::SurfaceProjector;
use calib_core::floor::SurfacePoint;

use crate::calibrations::{Calibration, Planes};
use crate::mapping::Mapped;
use crate::sigmas::Sigmas;

/// What the height of a point is called, and the plane that it is on.
const NAMES: [&str; 2] = ["z_m", "plane"];

/// Where points are, row by row; nowhere where a pixel shows nothing.
pub(crate) struct OnPlanes(Vec<Option<SurfacePoint>>);

impl OnPlanes {
    pub(crate) fn nowhere(rows: usize) -> Self {
        Self(vec![None; rows])
    }

    /// Maps pixels of the still to whichever of the floor and the planes each shows, `height` metres above it.
    pub(crate) fn map(
        calibration: &Calibration,
        planes: &Planes,
        [u, v]: [&[f64]; 2],
        height: f64,
        sigma: Option<f64>,
    ) -> Mapped {
        let mut mapped = Mapped::nowhere(u.len(), false, true);
        let projector = SurfaceProjector::new(calibration.projector.camera(), height, &planes.surfaces);
        let mut points: Vec<Option<SurfacePoint>> = vec![None; u.len()];
        projector.pixels_to_surfaces(&calibration.extent(), [u, v], &mut points, &mut mapped.status);
        for ((point, x), y) in points.iter().zip(&mut mapped.x).zip(&mut mapped.y) {
            (*x, *y) = point.map_or((f64::NAN, f64::NAN), |SurfacePoint { at, .. }| (at.x, at.y));
        }
        mapped.sigmas = sigma.map(|sigma| {
            Sigmas::of(calibration, [u, v], sigma, |row, pixel, sigma| {
                points[row].and_then(|point| projector.covariance(pixel, sigma, point.surface))
            })
        });
        mapped.on_planes = Some(Self(points));
        mapped
    }

    pub(crate) fn put(&mut self, rows: &[usize], some: &Self) {
        rows.iter().zip(&some.0).for_each(|(&row, &point)| self.0[row] = point);
    }

    /// The plane of a point of the floor is empty, as both are where there is no point.
    pub(crate) fn columns(self, planes: &Planes) -> [(&'static str, ArrayRef); 2] {
        let heights: Float64Array = self.0.iter().map(|point| point.map(|point| point.at.z)).collect();
        let mut ids = StringBuilder::new();
        for point in &self.0 {
            let surface = point.and_then(|point| point.surface);
            ids.append_option(surface.and_then(|surface| planes.ids.get(surface)));
        }
        let [height, plane] = NAMES;
        [(height, Arc::new(heights)), (plane, Arc::new(ids.finish()))]
    }
}
