//! What solving writes of links, marks, and the site as a whole.

use serde::{Deserialize, Serialize};

use crate::solution::{Sigmas, Warning, document};
use calib_core::camera::WorldPoint;

document! {
    /// What solving found out about a link or a mark.
    struct ElementSolution {
        /// Where it is, in metres.
        at_m: WorldPoint,
        /// In degrees, where it has a direction.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        turn_deg: Option<f64>,
        /// Length of a post, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_m: Option<f64>,
        /// Standard deviations.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma: Option<Sigmas>,
        /// One for every camera that shows it.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        residuals: Vec<SeenResidual>,
    }

    /// How far a camera's pixel of a link or mark is from the prediction.
    struct SeenResidual {
        /// Id of the camera.
        camera: String,
        /// In pixels.
        px: f64,
        /// Whether it was rejected.
        outlier: bool,
    }

    /// What solving found out about the site as a whole.
    #[derive(Default)]
    struct SiteSolution {
        /// Ids of the cameras that hang together, group by group.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        components: Vec<Vec<String>>,
        /// Whether metres are metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scale: Option<Scale>,
        /// Gap around the loops of the camera graph, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        loop_closure_m: Option<f64>,
        /// Pairs of cameras that see the same floor.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        overlaps: Vec<Overlap>,
        /// Covariances with each other of cameras that were solved together: of up to 45 cameras all, of more those that
        /// show something in common.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        cross_covariances: Vec<CrossCovarianceEntry>,
        /// What the operator should know.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        warnings: Vec<Warning>,
    }

    /// The covariance of what was estimated of one camera with what was estimated of another.
    struct CrossCovarianceEntry {
        /// Their ids.
        cameras: [String; 2],
        /// Names as in the solution of the first, with their units.
        rows: Vec<String>,
        /// Names as in the solution of the second, with their units.
        columns: Vec<String>,
        /// Row by row.
        values: Vec<f64>,
    }

    /// Two cameras that see the same floor, and how far they disagree there.
    struct Overlap {
        /// Their ids.
        cameras: [String; 2],
        /// Root mean square of the distances on the floor between where the two put what both show, in
        /// metres; absent where they share no evidence.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_rms_m: Option<f64>,
        /// Predicted standard deviation of such a distance from the calibration alone, over the floor
        /// that both see, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_sigma_m: Option<f64>,
    }
}

/// Whether the site's metres are metres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Something gives it.
    Known,
    /// The height of 3 m of the first camera stands.
    Unknown,
}

impl SiteSolution {
    /// Whether there is nothing to be said.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let Self { components, scale, loop_closure_m, overlaps, cross_covariances, warnings } = self;
        components.is_empty()
            && scale.is_none()
            && loop_closure_m.is_none()
            && overlaps.is_empty()
            && cross_covariances.is_empty()
            && warnings.is_empty()
    }
}
