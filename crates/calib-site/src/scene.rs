//! Entries of the site file for scene errors (deviations of the scene from the annotations' assumptions) and
//! for planes other than the floor.

use std::fmt;

use calib_core::camera::{FloorPoint, Plane};
use calib_core::floor::Surface;
use calib_core::single::{Known, PlanePrior, SceneErrors};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, IntoDeserializer as _, MapAccess, Unexpected, Visitor};
use serde::{Deserialize, Serialize};

use crate::bounds;
use crate::solution::document;

/// Keyword for a scene that exactly matches the annotations' assumptions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum ExactScene {
    /// No scene errors.
    Exact,
}

/// Scene errors: the keyword "exact", or standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum SceneEntry {
    /// Scene that exactly matches the annotations' assumptions.
    Exact(ExactScene),
    /// Standard deviations; absent values have their usual value. Exception: if `floor_tilt_sigma_deg` is
    /// set, an absent crossfall is 0.
    Sigmas(SceneSigmas),
}

document! {
    /// Standard deviations of the scene errors.
    #[derive(Copy, Default)]
    struct SceneSigmas {
        /// Standard deviation of the angle between verticals and the floor's normal, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_tilt_sigma_deg: Option<f64>,
        /// Standard deviation of the crossfall, in degrees: the slope of the floor perpendicular to floor marks of
        /// equal length, such as lane marks, in addition to the floor tilt. A quarter of it applies along these
        /// marks. If absent, it is 0 when `floor_tilt_sigma_deg` is set, otherwise the usual value.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        crossfall_sigma_deg: Option<f64>,
        /// Standard deviation of a right angle, in degrees. A quarter of it applies to the elevation of a direction
        /// above the floor.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        angle_sigma_deg: Option<f64>,
        /// Relative standard deviation between lengths that are annotated as equal.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_sigma_rel: Option<f64>,
    }
}

/// Not derived, because the derived implementation would not name the wrong key in an error.
impl<'de> Deserialize<'de> for SceneEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct WordOrSigmas;

        impl<'de> Visitor<'de> for WordOrSigmas {
            type Value = SceneEntry;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "\"exact\", or an object with floor_tilt_sigma_deg, crossfall_sigma_deg, angle_sigma_deg and \
                     length_sigma_rel",
                )
            }

            fn visit_str<E: Error>(self, word: &str) -> Result<SceneEntry, E> {
                let exact = ExactScene::deserialize(word.into_deserializer());
                exact.map(SceneEntry::Exact).map_err(|_: E| E::invalid_value(Unexpected::Str(word), &self))
            }

            fn visit_map<A: MapAccess<'de>>(self, sigmas: A) -> Result<SceneEntry, A::Error> {
                SceneSigmas::deserialize(MapAccessDeserializer::new(sigmas)).map(SceneEntry::Sigmas)
            }
        }

        deserializer.deserialize_any(WordOrSigmas)
    }
}

impl SceneEntry {
    /// Scene that exactly matches the annotations' assumptions.
    pub const EXACT: Self = Self::Exact(ExactScene::Exact);

    /// Returns the standard deviations in radians; the length error is relative.
    #[must_use]
    pub fn errors(&self) -> SceneErrors {
        let Self::Sigmas(sigmas) = self else { return SceneErrors::EXACT };
        let usual = SceneErrors::default();
        let usual_crossfall = if sigmas.floor_tilt_sigma_deg.is_some() { 0.0 } else { usual.crossfall };
        SceneErrors {
            floor_tilt: sigmas.floor_tilt_sigma_deg.map_or(usual.floor_tilt, f64::to_radians),
            crossfall: sigmas.crossfall_sigma_deg.map_or(usual_crossfall, f64::to_radians),
            angle: sigmas.angle_sigma_deg.map_or(usual.angle, f64::to_radians),
            length: sigmas.length_sigma_rel.unwrap_or(usual.length),
        }
    }
}

/// Height or angle of a plane: exact, fixed, or with a standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, or {\"value\", \"sigma\"}, or {\"value\", \"fixed\": true}"
)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum PlaneNumber {
    /// Exact value, in the unit of the field.
    Exact(f64),
    /// Value in the unit of the field, fixed or with a standard deviation.
    Known(Known),
}

document! {
    /// Plane in addition to the floor, such as another carriageway, a ramp, a platform, or a step.
    struct PlaneEntry {
        /// Identifier for references from annotations, links and fields of view.
        id: String,
        /// Display name of the plane.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Height above the floor at the mean of the corners of the region, in metres; unknown if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<PlaneNumber>,
        /// Slope; if absent, the plane is level within the floor tilt of the scene.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        tilt: Option<TiltEntry>,
        /// Region of the plane: a polygon in floor coordinates, in metres. A pixel is mapped to the plane
        /// whose region its ray meets first.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        region: Vec<FloorPoint>,
        /// Result of solving: height and slope of the plane.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<PlaneSolution>,
    }

    /// Slope of a plane.
    #[derive(Copy, Default)]
    struct TiltEntry {
        /// Downhill direction, counter-clockwise from +x, in degrees; unknown if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        toward_deg: Option<PlaneNumber>,
        /// Angle of the slope, in degrees; unknown if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        fall_deg: Option<PlaneNumber>,
    }

    /// Estimated height and slope of a plane.
    #[derive(Copy)]
    struct PlaneSolution {
        /// Height above the floor at the mean of the corners of the region, in metres.
        height_m: f64,
        /// Rise per metre along x and along y.
        slope: [f64; 2],
        /// Covariance of height (metres) and slope along x and y (rise per metre): upper triangle, row by
        /// row.
        covariance: [f64; 6],
    }
}

/// Standard deviation of an unknown height, in metres.
const UNKNOWN_HEIGHT_SIGMA_M: f64 = 3.0;
/// Standard deviation of an unknown slope angle, in degrees.
const UNKNOWN_FALL_SIGMA_DEG: f64 = 6.0;

impl PlaneNumber {
    /// Returns the value in its unit (metres or degrees).
    #[must_use]
    pub const fn value(&self) -> f64 {
        match self {
            Self::Exact(value) => *value,
            Self::Known(known) => known.value,
        }
    }

    /// Returns the standard deviation; 0 if the value is exact or fixed.
    fn sigma(&self) -> f64 {
        match self {
            Self::Exact(_) => 0.0,
            Self::Known(known) => known.sigma.unwrap_or(0.0),
        }
    }
}

impl PlaneEntry {
    /// Creates a level plane of unknown height, without a region.
    #[must_use]
    pub fn new(id: impl Into<String>) -> Self {
        Self { id: id.into(), name: None, height_m: None, tilt: None, region: Vec::new(), solution: None }
    }

    /// Returns the display name: the name if set, otherwise the id.
    #[must_use]
    pub fn title(&self) -> &str {
        self.name.as_deref().unwrap_or(&self.id)
    }

    /// Returns the mean of the region's corners, or the origin without a region.
    #[must_use]
    pub fn anchor(&self) -> FloorPoint {
        let count = self.region.len().max(1) as f64;
        let sum = |of: fn(&FloorPoint) -> f64| self.region.iter().map(of).sum::<f64>() / count;
        FloorPoint { x: sum(|at| at.x), y: sum(|at| at.y) }
    }

    /// Returns the prior of the plane before solving. `floor_tilt` is the standard deviation of the tilt of a
    /// level plane, in radians.
    #[must_use]
    pub fn prior(&self, floor_tilt: f64) -> PlanePrior {
        let (height, height_sigma) =
            self.height_m.map_or((0.0, UNKNOWN_HEIGHT_SIGMA_M), |height| (height.value(), height.sigma()));
        let (id, anchor) = (self.id.clone(), self.anchor());
        let Some(tilt) = self.tilt else {
            let plane = Plane { anchor, ..Plane::level(height) };
            return PlanePrior {
                id,
                plane,
                along: [1.0, 0.0],
                sigma: [height_sigma, floor_tilt, floor_tilt],
            };
        };
        let degrees = |number: PlaneNumber| [number.value(), number.sigma()].map(f64::to_radians);
        let [fall, fall_sigma] = tilt.fall_deg.map_or([0.0, UNKNOWN_FALL_SIGMA_DEG.to_radians()], degrees);
        let steepness = 1.0 + fall.tan() * fall.tan();
        let Some([toward, toward_sigma]) = tilt.toward_deg.map(degrees) else {
            // Without a downhill direction, only the size of the slope is known.
            let any = fall.tan().hypot(steepness * fall_sigma);
            let plane = Plane { anchor, ..Plane::level(height) };
            return PlanePrior { id, plane, along: [1.0, 0.0], sigma: [height_sigma, any, any] };
        };
        let across = if tilt.fall_deg.is_some() { fall.tan().abs() * toward_sigma } else { 0.0 };
        PlanePrior {
            id,
            plane: Plane::falling(height, toward, fall, anchor),
            along: [toward.cos(), toward.sin()],
            sigma: [height_sigma, steepness * fall_sigma, across],
        }
    }

    /// Returns the surface of the plane: its estimate if solved, otherwise its prior.
    pub(crate) fn surface(&self, floor_tilt: f64) -> Surface {
        let region = self.region.clone();
        let Some(PlaneSolution { height_m, slope, covariance: [hh, hx, hy, xx, xy, yy] }) = self.solution
        else {
            let prior = self.prior(floor_tilt);
            return Surface { plane: prior.plane, covariance: prior.covariance(), region };
        };
        let plane = Plane { height: height_m, slope, anchor: self.anchor() };
        Surface { plane, covariance: [[hh, hx, hy], [hx, xx, xy], [hy, xy, yy]], region }
    }
}

impl PlaneSolution {
    /// Creates an entry from a plane and the covariance of its height and slope.
    #[must_use]
    pub const fn from_plane(plane: &Plane, covariance: &[[f64; 3]; 3]) -> Self {
        let [[hh, hx, hy], [_, xx, xy], [.., yy]] = *covariance;
        Self { height_m: plane.height, slope: plane.slope, covariance: [hh, hx, hy, xx, xy, yy] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_scene_entry_is_reported_with_its_key() {
        let refused = |text: &str| serde_json::from_str::<SceneEntry>(text).expect_err(text).to_string();
        assert!(refused(r#"{"floor_tlit_sigma_deg": 1}"#).contains("unknown field `floor_tlit_sigma_deg`"));
        assert!(refused(r#""level""#).contains(r#"string "level", expected "exact""#));
        assert!(refused("[]").contains("sequence, expected \"exact\""));
        let read = |text: &str| serde_json::from_str::<SceneEntry>(text).ok();
        assert_eq!(read(r#""exact""#), Some(SceneEntry::EXACT));
        let level = SceneSigmas { floor_tilt_sigma_deg: Some(0.0), ..SceneSigmas::default() };
        assert_eq!(read(r#"{"floor_tilt_sigma_deg": 0}"#), Some(SceneEntry::Sigmas(level)));
    }
}
