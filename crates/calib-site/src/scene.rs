//! How far a scene may be from what was drawn, as the site file says it.

use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, IntoDeserializer as _, MapAccess, Unexpected, Visitor};
use serde::{Deserialize, Serialize};

use crate::solution::document;
use calib_core::single::SceneErrors;

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
