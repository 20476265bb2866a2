//! Pixel aspect of a camera in the site file, and the image sizes of recorders whose pixels are not square.
//!
//! The pixel aspect is the width of a pixel over its height, which is the ratio `fy / fx` of the focal
//! lengths. An image of w x h pixels that is shown with the ratio `D` of width to height has the pixel aspect
//! `D h / w`.

use calib_core::single::Prior;
use serde::de::value::MapAccessDeserializer;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Entered pixel aspect: a known number, an object with `value` and `sigma`, or `{"fit": true}`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelAspectEntry {
    /// Pixel aspect that is known.
    Known(f64),
    /// Pixel aspect that is estimated with this prior.
    Prior(Prior),
    /// Pixel aspect that is estimated from the annotations alone.
    Fit,
}

/// Standard deviation of the pixel aspect of an unknown recorder, relative to its start value. The annotations
/// must determine the aspect; the prior only limits it if they do not.
const FIT_SIGMA_REL: f64 = 0.5;

impl PixelAspectEntry {
    /// Returns the value from which an estimate starts, for images of this size.
    #[must_use]
    pub fn start(&self, size: [u32; 2]) -> f64 {
        match self {
            Self::Known(value) => *value,
            Self::Prior(prior) => prior.value,
            Self::Fit => usual_pixel_aspect(size).unwrap_or(1.0),
        }
    }

    /// Returns the prior of an estimated pixel aspect; `None` if the aspect is known.
    #[must_use]
    pub fn prior(&self, size: [u32; 2]) -> Option<Prior> {
        match self {
            Self::Known(_) => None,
            Self::Prior(prior) => Some(*prior),
            Self::Fit => {
                let value = self.start(size);
                Some(Prior { value, sigma: FIT_SIGMA_REL * value })
            }
        }
    }
}

/// Form of an estimated pixel aspect in files: with a prior.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(deny_unknown_fields))]
struct Estimated {
    /// Pixel aspect.
    value: f64,
    /// Standard deviation of the pixel aspect.
    sigma: f64,
}

/// Form of an estimated pixel aspect in files: without a prior.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(deny_unknown_fields))]
struct Fitted {
    /// Always true.
    fit: bool,
}

/// Form of the entry in files.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
enum InFile {
    /// Pixel aspect that is known.
    Known(f64),
    /// Pixel aspect with a standard deviation.
    Estimated(Estimated),
    /// Pixel aspect that is estimated from the annotations alone.
    Fitted(Fitted),
}

impl Serialize for PixelAspectEntry {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Self::Known(value) => InFile::Known(value),
            Self::Prior(Prior { value, sigma }) => InFile::Estimated(Estimated { value, sigma }),
            Self::Fit => InFile::Fitted(Fitted { fit: true }),
        }
        .serialize(serializer)
    }
}

#[cfg(feature = "schema")]
impl schemars::JsonSchema for PixelAspectEntry {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "PixelAspectEntry".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        InFile::json_schema(generator)
    }
}

impl<'de> Deserialize<'de> for PixelAspectEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> serde::de::Visitor<'de> for Visitor {
            type Value = PixelAspectEntry;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a number, an object with \"value\" and \"sigma\", or {\"fit\": true}")
            }

            fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<PixelAspectEntry, E> {
                Ok(PixelAspectEntry::Known(value))
            }

            fn visit_u64<E: serde::de::Error>(self, value: u64) -> Result<PixelAspectEntry, E> {
                Ok(PixelAspectEntry::Known(value as f64))
            }

            fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<PixelAspectEntry, E> {
                Ok(PixelAspectEntry::Known(value as f64))
            }

            fn visit_map<A: serde::de::MapAccess<'de>>(self, map: A) -> Result<PixelAspectEntry, A::Error> {
                #[derive(Deserialize)]
                #[serde(deny_unknown_fields)]
                struct Fields {
                    value: Option<f64>,
                    sigma: Option<f64>,
                    fit: Option<bool>,
                }
                let Fields { value, sigma, fit } = Fields::deserialize(MapAccessDeserializer::new(map))?;
                match (value, sigma, fit) {
                    (Some(value), Some(sigma), None) => Ok(PixelAspectEntry::Prior(Prior { value, sigma })),
                    (None, None, Some(true)) => Ok(PixelAspectEntry::Fit),
                    _ => {
                        Err(serde::de::Error::custom("expected \"value\" and \"sigma\", or {\"fit\": true}"))
                    }
                }
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

/// Image sizes of recorders whose pixels are usually not square, with the ratio of width to height with which
/// the image is shown.
const CODED_SIZES: [([u32; 2], f64); 12] = [
    ([960, 1080], WIDE_SCREEN),
    ([1280, 1440], WIDE_SCREEN),
    ([960, 576], OLD_SCREEN),
    ([960, 480], OLD_SCREEN),
    ([720, 576], OLD_SCREEN),
    ([720, 480], OLD_SCREEN),
    ([704, 576], OLD_SCREEN),
    ([704, 480], OLD_SCREEN),
    ([704, 288], OLD_SCREEN),
    ([704, 240], OLD_SCREEN),
    ([352, 288], OLD_SCREEN),
    ([352, 240], OLD_SCREEN),
];

/// Ratio of width to height of a 16:9 image.
const WIDE_SCREEN: f64 = 16.0 / 9.0;
/// Ratio of width to height of a 4:3 image.
const OLD_SCREEN: f64 = 4.0 / 3.0;

/// Returns the usual pixel aspect of images of this size, if recorders code images of this size with pixels
/// that are not square.
#[must_use]
pub fn usual_pixel_aspect(size: [u32; 2]) -> Option<f64> {
    let (_, shown) = CODED_SIZES.iter().find(|(coded, _)| *coded == size)?;
    Some(shown * f64::from(size[1]) / f64::from(size[0]))
}

/// Returns the pixel aspect of square pixels: the default in files.
pub(crate) const fn square() -> f64 {
    1.0
}

/// Whether pixels of this aspect are square.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
pub(crate) const fn is_square(aspect: &f64) -> bool {
    *aspect == 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coded_sizes_have_the_aspects_of_their_standards() {
        let of = |size| usual_pixel_aspect(size).unwrap();
        assert!((of([960, 1080]) - 2.0).abs() < 1e-12);
        assert!((of([704, 576]) - 12.0 / 11.0).abs() < 1e-12 && (of([352, 288]) - 12.0 / 11.0).abs() < 1e-12);
        assert!((of([704, 240]) - 5.0 / 11.0).abs() < 1e-12 && (of([720, 480]) - 8.0 / 9.0).abs() < 1e-12);
        assert_eq!([[1920, 1080], [640, 480], [768, 576]].map(usual_pixel_aspect), [None; 3]);
    }

    #[test]
    fn the_forms_of_an_entry_round_trip_and_others_are_refused() {
        let entries = [
            ("1.5", PixelAspectEntry::Known(1.5)),
            (r#"{"value":1.0,"sigma":0.01}"#, PixelAspectEntry::Prior(Prior { value: 1.0, sigma: 0.01 })),
            (r#"{"fit":true}"#, PixelAspectEntry::Fit),
        ];
        for (text, entry) in entries {
            assert_eq!(serde_json::from_str::<PixelAspectEntry>(text).unwrap(), entry);
            assert_eq!(serde_json::to_string(&entry).unwrap(), text);
        }
        assert_eq!(serde_json::from_str::<PixelAspectEntry>("2").unwrap(), PixelAspectEntry::Known(2.0));
        for wrong in
            [r#"{"fit":false}"#, r#"{"value":1.0}"#, r#"{"sigma":0.1,"fit":true}"#, "[1.0]", r#""1""#]
        {
            let message = serde_json::from_str::<PixelAspectEntry>(wrong).unwrap_err().to_string();
            assert!(message.contains("{\"fit\": true}"), "{wrong}: {message}");
        }
    }
}
