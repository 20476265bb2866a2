//! Results of solving for links, marks and the site as a whole.

use serde::{Deserialize, Serialize};

use crate::solution::{Sigmas, Warning, document};
use calib_core::camera::WorldPoint;

document! {
    /// Result of solving a link or a mark.
    struct ElementSolution {
        /// World position, in metres.
        at_m: WorldPoint,
        /// Rotation about the vertical axis, counter-clockwise, in degrees; for a line, its direction from +x. Absent
        /// for elements without a direction.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        turn_deg: Option<f64>,
        /// Length of a post, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_m: Option<f64>,
        /// Standard deviations of position and rotation.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma: Option<Sigmas>,
        /// Residuals of the element, one for each observation.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        residuals: Vec<ObservationResidual>,
    }

    /// Residual of one observation of a link or mark: the distance between the observed and the predicted
    /// pixel.
    struct ObservationResidual {
        /// Id of the camera.
        camera: String,
        /// Residual, in pixels.
        px: f64,
        /// Whether the observation was rejected as an outlier.
        outlier: bool,
    }

    /// Results for the site as a whole.
    #[derive(Default)]
    struct SiteSolution {
        /// Connected groups of cameras, by their ids.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        components: Vec<Vec<String>>,
        /// State of the scale of the site: known or unknown.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scale: Option<Scale>,
        /// Loop closure: largest root mean square disagreement on the floor after initialisation, in metres.
        /// It is computed for pairs of cameras that close a loop of the view graph.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        loop_closure_m: Option<f64>,
        /// Pairs of cameras that share floor or links.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        overlaps: Vec<Overlap>,
        /// Covariances between pairs of jointly solved cameras: all pairs for up to 45 cameras, otherwise
        /// only pairs that share observations.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        cross_covariances: Vec<CrossCovarianceEntry>,
        /// Georeference that follows from control points with `lat_deg` and `lon_deg`; absent if the site has an
        /// entered one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        georeference: Option<GeoreferenceSolution>,
        /// Warnings about the site.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        warnings: Vec<Warning>,
    }

    /// Georeference that follows from control points: geographic position of world (0, 0) and direction of
    /// world +x.
    struct GeoreferenceSolution {
        /// WGS84 latitude, in degrees.
        lat_deg: f64,
        /// WGS84 longitude, in degrees.
        lon_deg: f64,
        /// Azimuth of world +x, clockwise from north, in degrees.
        x_axis_azimuth_deg: f64,
        /// Height of the floor above the WGS84 ellipsoid, in metres, if it is known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alt_m: Option<f64>,
        /// Standard deviations. They are zero if the control points define the coordinate system of the site.
        sigma: GeoreferenceSigmas,
    }

    /// Standard deviations of a georeference.
    #[derive(Copy)]
    struct GeoreferenceSigmas {
        /// Standard deviation of the position toward east, in metres.
        east_m: f64,
        /// Standard deviation of the position toward north, in metres.
        north_m: f64,
        /// Standard deviation of the azimuth, in degrees.
        azimuth_deg: f64,
        /// Correlations: of east and north, of east and the azimuth, and of north and the azimuth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        correlations: Option<[f64; 3]>,
    }

    /// Cross-covariance of the estimated parameters of two cameras.
    struct CrossCovarianceEntry {
        /// Ids of the two cameras.
        cameras: [String; 2],
        /// Names and units of the rows of `values`: the estimated parameters of the first camera, as in its solution.
        rows: Vec<String>,
        /// Names and units of the columns of `values`: the estimated parameters of the second camera.
        columns: Vec<String>,
        /// Covariance matrix, row by row, in the units of the rows and columns.
        values: Vec<f64>,
    }

    /// Two cameras that share floor or links, and their disagreement on the floor.
    struct Overlap {
        /// Ids of the two cameras.
        cameras: [String; 2],
        /// Root mean square distance between the floor positions of shared points as computed from the two
        /// cameras, in metres; absent without shared points.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_rms_m: Option<f64>,
        /// Predicted standard deviation of this distance due to the calibration alone, over the floor visible
        /// to both, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_sigma_m: Option<f64>,
    }
}

/// State of the scale of the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Determined by a measurement or placement.
    Known,
    /// Undetermined; the first camera is assumed to be 3 m high.
    Unknown,
}

impl SiteSolution {
    /// Whether the site has no results.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let Self { components, scale, loop_closure_m, overlaps, cross_covariances, georeference, warnings } =
            self;
        components.is_empty()
            && scale.is_none()
            && loop_closure_m.is_none()
            && overlaps.is_empty()
            && cross_covariances.is_empty()
            && georeference.is_none()
            && warnings.is_empty()
    }
}
