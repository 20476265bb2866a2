//! Values from the data sheet of a camera: their tolerance, and the sizes of sensors.

use calib_core::single::Known;
use serde::de::value::MapAccessDeserializer;
use serde::{Deserialize, Deserializer, Serialize};

/// Relative standard deviation of a focal length or field of view from a data sheet that states no tolerance.
/// This is an assumption, not a measurement: an error of up to 5 % in either direction, by rounding and between
/// samples, has a standard deviation of 3 % if it is uniform.
pub(crate) const NOMINAL_SIGMA_REL: f64 = 0.03;

/// Value from a data sheet: a number with the usual tolerance, or a value that is fixed or has a standard
/// deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum Nominal {
    /// Number without a stated tolerance.
    Number(f64),
    /// Value that is fixed or has a standard deviation, in its unit.
    Known(Known),
}

impl Nominal {
    /// Returns the value with its certainty; a bare number has the usual tolerance.
    #[must_use]
    pub fn known(self) -> Known {
        match self {
            Self::Number(value) => Known::prior(value, NOMINAL_SIGMA_REL * value),
            Self::Known(known) => known,
        }
    }
}

impl<'de> Deserialize<'de> for Nominal {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> serde::de::Visitor<'de> for Visitor {
            type Value = Nominal;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a number, or an object with \"value\" and \"sigma\" or \"fixed\"")
            }

            fn visit_f64<E>(self, value: f64) -> Result<Nominal, E> {
                Ok(Nominal::Number(value))
            }

            fn visit_u64<E>(self, value: u64) -> Result<Nominal, E> {
                Ok(Nominal::Number(value as f64))
            }

            fn visit_i64<E>(self, value: i64) -> Result<Nominal, E> {
                Ok(Nominal::Number(value as f64))
            }

            fn visit_map<A: serde::de::MapAccess<'de>>(self, map: A) -> Result<Nominal, A::Error> {
                Known::deserialize(MapAccessDeserializer::new(map)).map(Nominal::Known)
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

/// Returns the diagonal of a sensor in millimetres from its optical format, such as `1/2.8` or `2/3`, in
/// inches. `None` for other text.
///
/// The format is the outer diameter of an old camera tube. The diagonal is 16 mm per inch from 1/2 inch, and
/// 18 mm per inch for smaller sensors.
pub(crate) fn sensor_diagonal_mm(format: &str) -> Option<f64> {
    let inches = match format.trim().trim_end_matches('"').split_once('/') {
        Some((over, under)) => over.trim().parse::<f64>().ok()? / under.trim().parse::<f64>().ok()?,
        None => format.trim().trim_end_matches('"').parse().ok()?,
    };
    let per_inch = if inches >= 0.5 { 16.0 } else { 18.0 };
    (0.05..=4.0).contains(&inches).then_some(per_inch * inches)
}
