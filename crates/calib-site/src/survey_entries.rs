//! Entries of walls, areas of interest, density levels and measurements. They do not influence the calibration.

use calib_core::camera::{FloorPoint, Pixel};
use calib_core::floor::{DensityLevel, LevelLimits};
use serde::{Deserialize, Serialize};

use crate::bounds;
use crate::solution::document;

document! {
    /// Vertical wall or obstacle that blocks the view. It begins at the floor.
    struct WallEntry {
        /// One end of the wall on the floor, in metres.
        from_m: FloorPoint,
        /// The other end of the wall on the floor, in metres.
        to_m: FloorPoint,
        /// Height of the wall, in metres; if absent, the wall is higher than every camera.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
    }

    /// Area of the floor that the cameras must see with a required pixel density.
    struct Area {
        /// Identifier of the area.
        id: String,
        /// Display name of the area.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Corners on the floor, in metres.
        #[serde(deserialize_with = "bounds::items")]
        polygon_m: Vec<FloorPoint>,
        /// Required level; if absent, the area only needs to be visible.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        level: Option<DensityLevel>,
    }

    /// Smallest pixel density of each level, in pixels per metre. An absent level has the limit of IEC 62676-4.
    #[derive(Copy, Default)]
    struct LevelLimitsEntry {
        /// Smallest pixel density of the level "monitor".
        #[serde(default, skip_serializing_if = "Option::is_none")]
        monitor: Option<f64>,
        /// Smallest pixel density of the level "detect".
        #[serde(default, skip_serializing_if = "Option::is_none")]
        detect: Option<f64>,
        /// Smallest pixel density of the level "observe".
        #[serde(default, skip_serializing_if = "Option::is_none")]
        observe: Option<f64>,
        /// Smallest pixel density of the level "recognise".
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recognise: Option<f64>,
        /// Smallest pixel density of the level "identify".
        #[serde(default, skip_serializing_if = "Option::is_none")]
        identify: Option<f64>,
    }

    /// Measurement in the images. It does not change the calibration; its value is computed when needed.
    struct Measurement {
        /// Identifier of the measurement.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// Display name of the measurement.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Measured quantity.
        kind: MeasurementKind,
        /// Measured points, in order.
        #[serde(deserialize_with = "bounds::items")]
        points: Vec<MeasurementPoint>,
        /// Time from the first point to the last, in seconds, for a speed; if absent, it is the difference of their
        /// times `at`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        duration_s: Option<f64>,
    }

    /// Point of a measurement: a pixel of one camera.
    struct MeasurementPoint {
        /// Id of the camera.
        camera: String,
        /// Raw pixel.
        px: Pixel,
        /// Height of the point above the floor, in metres; 0 if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
        /// Time of the image (RFC 3339); needed for a speed, and for a camera with several periods.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        at: Option<String>,
        /// Standard deviation of each coordinate, in pixels; the camera's `sigma_px` if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
    }
}

/// Quantity of a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum MeasurementKind {
    /// Length of the line through two or more points.
    #[default]
    Length,
    /// Height of the second point above the first, which is vertically below it.
    Height,
    /// Area of the polygon through three or more points, seen from above.
    Area,
    /// Length of the line through two or more points, divided by the time from the first to the last.
    Speed,
}

impl MeasurementKind {
    /// All kinds of measurements.
    pub const ALL: [Self; 4] = [Self::Length, Self::Height, Self::Area, Self::Speed];

    /// Returns the kind with this name; `None` for an unknown name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns the smallest number of points.
    #[must_use]
    pub const fn min_points(self) -> usize {
        match self {
            Self::Length | Self::Height | Self::Speed => 2,
            Self::Area => 3,
        }
    }

    /// Returns the name of the kind, as in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Length => "length",
            Self::Height => "height",
            Self::Area => "area",
            Self::Speed => "speed",
        }
    }
}

impl LevelLimitsEntry {
    /// Returns the entered limits, in the order of [`DensityLevel::ALL`].
    #[must_use]
    pub const fn entered(&self) -> [Option<f64>; DensityLevel::ALL.len()] {
        [self.monitor, self.detect, self.observe, self.recognise, self.identify]
    }

    /// Returns the limits of all levels.
    #[must_use]
    pub fn limits(&self) -> LevelLimits {
        let mut limits = LevelLimits::default();
        for (limit, entered) in limits.0.iter_mut().zip(self.entered()) {
            *limit = entered.unwrap_or(*limit);
        }
        limits
    }
}

impl From<LevelLimits> for LevelLimitsEntry {
    /// Creates the entry. Limits that equal the defaults of IEC 62676-4 stay absent.
    fn from(limits: LevelLimits) -> Self {
        let usual = LevelLimits::default();
        let own = |level: DensityLevel| Some(limits.of(level)).filter(|limit| *limit != usual.of(level));
        let [monitor, detect, observe, recognise, identify] = DensityLevel::ALL.map(own);
        Self { monitor, detect, observe, recognise, identify }
    }
}

impl Measurement {
    /// Creates a measurement through these points.
    #[must_use]
    pub const fn new(kind: MeasurementKind, points: Vec<MeasurementPoint>) -> Self {
        Self { id: None, name: None, kind, points, duration_s: None }
    }
}

impl MeasurementPoint {
    /// Creates a point on the floor.
    #[must_use]
    pub const fn new(camera: String, px: Pixel) -> Self {
        Self { camera, px, height_m: None, at: None, sigma_px: None }
    }
}
