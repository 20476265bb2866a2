//! Principal point of a camera in the site file: exactly known, or with a standard deviation.

use calib_core::camera::Pixel;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Entered principal point: `[u, v]` if it is known, or an object with `value` and `sigma`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipalPointEntry {
    /// Principal point, in raw pixels.
    pub value: Pixel,
    /// Standard deviation of each coordinate, in pixels; `None` if the principal point is known.
    pub sigma: Option<f64>,
}

impl PrincipalPointEntry {
    /// Returns a principal point that is known.
    #[must_use]
    pub const fn known(value: Pixel) -> Self {
        Self { value, sigma: None }
    }

    /// Returns the entry for an image that is enlarged by the factor `by`.
    #[must_use]
    pub fn scaled(self, by: f64) -> Self {
        let Pixel { u, v } = self.value;
        Self { value: Pixel::new(by * u, by * v), sigma: self.sigma.map(|sigma| by * sigma) }
    }
}

/// Form of the entry in files.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
enum InFile {
    /// Principal point that is known, in raw pixels.
    Known(Pixel),
    /// Principal point with a standard deviation.
    Estimated(Estimated),
}

/// Principal point with a standard deviation.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct Estimated {
    /// Principal point, in raw pixels.
    value: Pixel,
    /// Standard deviation of each coordinate, in pixels.
    sigma: f64,
}

impl Serialize for PrincipalPointEntry {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.sigma {
            None => InFile::Known(self.value),
            Some(sigma) => InFile::Estimated(Estimated { value: self.value, sigma }),
        }
        .serialize(serializer)
    }
}

#[cfg(feature = "schema")]
impl schemars::JsonSchema for PrincipalPointEntry {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "PrincipalPointEntry".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        InFile::json_schema(generator)
    }
}

impl<'de> Deserialize<'de> for PrincipalPointEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> serde::de::Visitor<'de> for Visitor {
            type Value = PrincipalPointEntry;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("two pixel coordinates, or an object with \"value\" and \"sigma\"")
            }

            fn visit_seq<A: serde::de::SeqAccess<'de>>(
                self,
                list: A,
            ) -> Result<PrincipalPointEntry, A::Error> {
                Pixel::deserialize(SeqAccessDeserializer::new(list)).map(PrincipalPointEntry::known)
            }

            fn visit_map<A: serde::de::MapAccess<'de>>(
                self,
                map: A,
            ) -> Result<PrincipalPointEntry, A::Error> {
                let Estimated { value, sigma } = Estimated::deserialize(MapAccessDeserializer::new(map))?;
                Ok(PrincipalPointEntry { value, sigma: Some(sigma) })
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}
