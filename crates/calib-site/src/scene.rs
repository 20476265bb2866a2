//! How far a scene may be from what was drawn, as the site file says it.
//!
//! Planes of the scene besides the floor, as the document has them.

use std::fmt;

use calib_core::camera::{FloorPoint, Plane};
use calib_core::floor::Surface;
use calib_core::single::{Known, PlanePrior, SceneErrors};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, IntoDeserializer as _, MapAccess, Unexpected, Visitor};
use serde::{Deserialize, Serialize};

use crate::bounds;
use crate::solution::document;

/// The word for a scene that is what the drawing says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum ExactScene {
    /// `"exact"`.
    Exact,
}

/// The scene's own errors: the word "exact", or their standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum SceneEntry {
    /// The scene is what the drawing says.
    Exact(ExactScene),
    /// Standard deviations; those left out are the usual ones, but for the crossfall of who says how floors tilt.
    Sigmas(SceneSigmas),
}

document! {
    /// Standard deviations of the scene's own errors.
    #[derive(Copy, Default)]
    struct SceneSigmas {
        /// Of the lean of verticals against the normal of the floor, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_tilt_sigma_deg: Option<f64>,
        /// Of the fall of the floor to the side of marks of equal length, in degrees, besides its tilt, and of a quarter
        /// of that along them; where that is given, there is none unless this is, too.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        crossfall_sigma_deg: Option<f64>,
        /// Of a right angle, in degrees; a direction is off level by a quarter of it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        angle_sigma_deg: Option<f64>,
        /// Of a length that is equal to others, relative.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_sigma_rel: Option<f64>,
    }
}

/// By hand, so that a key that is wrong is named.
impl<'de> Deserialize<'de> for SceneEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct WordOrSigmas;

        impl<'de> Visitor<'de> for WordOrSigmas {
            type Value = SceneEntry;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "\"exact\", or an object of floor_tilt_sigma_deg, crossfall_sigma_deg, angle_sigma_deg and \
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
    /// The scene is what the drawing says.
    pub const EXACT: Self = Self::Exact(ExactScene::Exact);

    /// In radians and logs.
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

/// A number of a plane: known, or known about.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, or {\"value\", \"sigma\"}, or {\"value\", \"fixed\": true}"
)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum PlaneNumber {
    /// As it is.
    Exact(f64),
    /// Held, or with a standard deviation.
    Known(Known),
}

document! {
    /// A plane besides the floor: another carriageway, a ramp, a platform, a step of stairs.
    struct PlaneEntry {
        /// By which annotations, links and fields of view refer to it.
        id: String,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Height above the floor at the mean of the corners of its region, in metres; unknown if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<PlaneNumber>,
        /// Its fall; level, as far as floors are, if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        tilt: Option<TiltEntry>,
        /// Where it holds: a polygon on the plan, in metres. A pixel is mapped to the plane whose region its ray
        /// meets first.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        region: Vec<FloorPoint>,
        /// What solving found out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<PlaneSolution>,
    }

    /// The fall of a plane.
    #[derive(Copy, Default)]
    struct TiltEntry {
        /// The direction it falls toward, counter-clockwise from +x, in degrees; unknown if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        toward_deg: Option<PlaneNumber>,
        /// The angle by which it falls, in degrees; unknown if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        fall_deg: Option<PlaneNumber>,
    }

    /// Where solving found a plane.
    #[derive(Copy)]
    struct PlaneSolution {
        /// Height above the floor at the mean of the corners of its region, in metres.
        height_m: f64,
        /// Rise per metre along x and y.
        slope: [f64; 2],
        /// Covariance of height and slope, the upper triangle row by row.
        covariance: [f64; 6],
    }
}

/// Standard deviation of a height of which nothing is known, in metres.
const ANY_HEIGHT: f64 = 3.0;
/// Standard deviation of a fall of which nothing is known, in degrees.
const ANY_FALL_DEG: f64 = 6.0;

impl PlaneNumber {
    /// Its value.
    #[must_use]
    pub const fn value(&self) -> f64 {
        match self {
            Self::Exact(value) => *value,
            Self::Known(known) => known.value,
        }
    }

    /// Its standard deviation; 0 of what is held.
    fn sigma(&self) -> f64 {
        match self {
            Self::Exact(_) => 0.0,
            Self::Known(known) => known.sigma.unwrap_or(0.0),
        }
    }
}

impl PlaneEntry {
    /// A level plane of unknown height without a region.
    #[must_use]
    pub fn new(id: impl Into<String>) -> Self {
        Self { id: id.into(), name: None, height_m: None, tilt: None, region: Vec::new(), solution: None }
    }

    /// What it is called where it is shown: its name, or its id.
    #[must_use]
    pub fn title(&self) -> &str {
        self.name.as_deref().unwrap_or(&self.id)
    }

    /// The mean of the corners of its region; the origin without one.
    #[must_use]
    pub fn anchor(&self) -> FloorPoint {
        let count = self.region.len().max(1) as f64;
        let sum = |of: fn(&FloorPoint) -> f64| self.region.iter().map(of).sum::<f64>() / count;
        FloorPoint { x: sum(|at| at.x), y: sum(|at| at.y) }
    }

    /// What is known of it before solving; `floor_tilt` is how far a level plane may be off, in radians.
    #[must_use]
    pub fn prior(&self, floor_tilt: f64) -> PlanePrior {
        let (height, height_sigma) =
            self.height_m.map_or((0.0, ANY_HEIGHT), |height| (height.value(), height.sigma()));
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
        let [fall, fall_sigma] = tilt.fall_deg.map_or([0.0, ANY_FALL_DEG.to_radians()], degrees);
        let steepness = 1.0 + fall.tan() * fall.tan();
        let Some([toward, toward_sigma]) = tilt.toward_deg.map(degrees) else {
            // Of a fall without a direction only its size is known.
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

    /// Where it is: as solving found it, or as it is known.
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
    /// A plane with its covariance.
    #[must_use]
    pub const fn of(plane: &Plane, covariance: &[[f64; 3]; 3]) -> Self {
        let [[hh, hx, hy], [_, xx, xy], [.., yy]] = *covariance;
        Self { height_m: plane.height, slope: plane.slope, covariance: [hh, hx, hy, xx, xy, yy] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_in_a_scene_is_named() {
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
