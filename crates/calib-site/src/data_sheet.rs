//! Values from the data sheet of a camera: their tolerance, the sizes of sensors, and their form as text.

use std::fmt;

use calib_core::single::Known;
use serde::de::value::MapAccessDeserializer;
use serde::{Deserialize, Deserializer, Serialize};

/// Relative standard deviation of a focal length from a data sheet without a tolerance. It also applies to a focal
/// length from a stated field of view. This is an assumption, not a measurement: a uniform error of up to ±5 %, from
/// rounding and variation between samples, has a standard deviation of 3 %.
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
    /// Returns the value with its standard deviation; for a bare number, 3 % of the value.
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

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
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

/// Values of the data sheet of a camera.
///
/// The text form contains the focal length and the sensor (`2.8 mm 1/2.7`, `2.8 mm 5.6 x 3.15 mm`), or fields of view
/// (`horizontal 98° vertical 52°`), or both. A value can have a standard deviation (`2.8 ± 0.1 mm`) or be exact
/// (`exactly 2.8 mm`).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DataSheet {
    /// Horizontal, vertical and diagonal field of view, in degrees.
    pub fields_deg: [Option<Nominal>; 3],
    /// Focal length, in millimetres.
    pub focal_mm: Option<Nominal>,
    /// Width and height of the sensor, in millimetres.
    pub sensor_mm: Option<[f64; 2]>,
    /// Optical format of the sensor, in inches.
    pub sensor: Option<String>,
}

/// Text of a data sheet that is not understood.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DataSheetError {
    /// Focal length in millimetres without the size of the sensor.
    NoSensor,
    /// Size of the sensor without a focal length in millimetres.
    NoFocalLength,
    /// Second entry of this value.
    Repeated(&'static str),
    /// Field of view outside the range from 0.1 to 179 degrees.
    FieldOutOfRange,
    /// Optical format that no sensor has.
    UnknownFormat(String),
    /// Word that has no meaning at its position.
    UnknownWord(String),
    /// End of the text where a number is expected.
    MissingNumber,
}

impl std::error::Error for DataSheetError {}

/// Names of the fields of view in text, in the order of [`DataSheet::fields_deg`].
const FIELD_NAMES: [&str; 3] = ["horizontal", "vertical", "diagonal"];

impl DataSheet {
    /// Reads the values from a text. `size_px` is the size of the image. It determines the sensor size for a focal
    /// length that is stated as the equivalent of 35 mm film.
    ///
    /// A range of focal lengths (`2.8-12 mm`) is read as a uniform distribution of the log focal length.
    ///
    /// # Errors
    /// The part that is not understood, or the value that is missing.
    pub fn parse(text: &str, size_px: [u32; 2]) -> Result<Self, DataSheetError> {
        let mut words = Words::new(text);
        let mut sheet = Self::default();
        while !words.is_empty() {
            sheet.read(&mut words, size_px)?;
        }
        match (sheet.focal_mm, &sheet.sensor, sheet.sensor_mm) {
            (Some(_), None, None) => Err(DataSheetError::NoSensor),
            (None, Some(_), _) | (None, _, Some(_)) => Err(DataSheetError::NoFocalLength),
            _ => Ok(sheet),
        }
    }

    /// Reads the next value.
    fn read(&mut self, words: &mut Words, size_px: [u32; 2]) -> Result<(), DataSheetError> {
        if words.skip_any(&["lens", "sensor", "cmos", "fov", "field", "of", "view", "inch", "in", "type"]) {
            return Ok(());
        }
        let first = words.position;
        if let Some(axis) = words.axis() {
            while words.skip_any(&["fov", "field", "of", "view"]) {}
            let field = words.value().ok_or_else(|| words.error())?;
            words.skip_any(DEGREES);
            return self.set_field(axis, field);
        }
        if let Some(sides) = words.pair("x") {
            words.skip_any(&["mm"]);
            return self.set_sensor(None, Some(sides));
        }
        if let Some([over, under]) = words.pair("/") {
            words.skip_any(INCHES);
            return self.set_sensor(Some(format!("{over}/{under}")), None);
        }
        let value = words.value().ok_or_else(|| words.error())?;
        if let (Nominal::Number(inches), true) = (value, words.skip_any(INCHES)) {
            return self.set_sensor(Some(format!("{inches}\"")), None);
        }
        if words.skip_any(&["mm"]) {
            if self.focal_mm.replace(value).is_some() {
                return Err(DataSheetError::Repeated("focal length"));
            }
            let is_equivalent = words.skip_any(&["equivalent", "equiv", "eq"]);
            return if is_equivalent { self.set_sensor(None, Some(film_of(size_px))) } else { Ok(()) };
        }
        words.skip_any(DEGREES);
        let axis = words.axis().ok_or_else(|| words.error_at(first))?;
        self.set_field(axis, value)
    }

    fn set_field(&mut self, axis: usize, field: Nominal) -> Result<(), DataSheetError> {
        if !FIELDS_DEG.contains(&field.known().value) {
            return Err(DataSheetError::FieldOutOfRange);
        }
        match self.fields_deg[axis].replace(field) {
            Some(_) => Err(DataSheetError::Repeated("field of view in the same direction")),
            None => Ok(()),
        }
    }

    fn set_sensor(&mut self, format: Option<String>, sides: Option<[f64; 2]>) -> Result<(), DataSheetError> {
        if let Some(format) = format.as_ref().filter(|format| sensor_diagonal_mm(format).is_none()) {
            return Err(DataSheetError::UnknownFormat(format.clone()));
        }
        if self.sensor.is_some() || self.sensor_mm.is_some() {
            return Err(DataSheetError::Repeated("size of the sensor"));
        }
        (self.sensor, self.sensor_mm) = (format, sides);
        Ok(())
    }
}

/// Formats the data sheet as a text that [`DataSheet::parse`] reads.
impl fmt::Display for DataSheet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = |value: Nominal| match value {
            Nominal::Number(value) | Nominal::Known(Known { value, fixed: false, sigma: None }) => {
                value.to_string()
            }
            Nominal::Known(Known { value, fixed: true, .. }) => format!("exactly {value}"),
            Nominal::Known(Known { value, sigma: Some(sigma), .. }) => format!("{value} \u{b1} {sigma}"),
        };
        let focal = self.focal_mm.map(|focal| format!("{} mm", value(focal)));
        // A format without a fraction needs its unit.
        let format = self.sensor.as_ref().map(|format| match format.contains(['/', '"']) {
            true => format.clone(),
            false => format!("{format}\""),
        });
        let size = self.sensor_mm.map(|[width, height]| format!("{width} x {height} mm"));
        let fields = FIELD_NAMES.iter().zip(self.fields_deg);
        let fields = fields.filter_map(|(name, field)| Some(format!("{name} {}\u{b0}", value(field?))));
        let parts: Vec<String> = focal.into_iter().chain(format).chain(size).chain(fields).collect();
        f.write_str(&parts.join(" "))
    }
}

/// Names of the unit of angles.
const DEGREES: &[&str] = &["\u{b0}", "deg", "degree", "degrees"];
/// Names of the unit of optical formats.
const INCHES: &[&str] = &["\"", "inch", "in", "type"];
/// Accepted fields of view, in degrees. Fisheye models do not use a field of view.
const FIELDS_DEG: std::ops::RangeInclusive<f64> = 0.1..=179.0;

/// Returns the width and height of a sensor with the diagonal of 35 mm film and the aspect ratio of the image, in
/// millimetres. Equivalent focal lengths refer to the diagonal.
fn film_of(size_px: [u32; 2]) -> [f64; 2] {
    /// Diagonal of 36 mm x 24 mm.
    const DIAGONAL_MM: f64 = 43.267;
    let [width, height] = size_px.map(f64::from);
    [width, height].map(|side| (100.0 * DIAGONAL_MM * side / width.hypot(height)).round() / 100.0)
}

/// Words of a text: numbers, names and single signs, in lower case.
struct Words {
    words: Vec<String>,
    position: usize,
}

impl Words {
    fn new(text: &str) -> Self {
        let given: Vec<char> = text.to_lowercase().chars().collect();
        let is_digit = |at: usize| given.get(at).is_some_and(char::is_ascii_digit);
        let is_part = |at: &usize| is_digit(*at) || given.get(*at) == Some(&'.');
        // A comma between two digits is a decimal comma. It is a separator in `1/2.7,2.8mm`, where a point separates
        // the decimals.
        let is_decimal_comma = |at: usize| {
            let mut beside =
                (0..at).rev().take_while(is_part).chain((at + 1..given.len()).take_while(is_part));
            at > 0 && is_digit(at - 1) && is_digit(at + 1) && !beside.any(|at| given[at] == '.')
        };
        let usual = |at: usize| match given[at] {
            ',' if is_decimal_comma(at) => '.',
            '.' if !is_digit(at + 1) => ' ',
            ',' | ';' | ':' | '=' | '(' | ')' => ' ',
            '\u{ba}' => '\u{b0}',
            '\u{d7}' => 'x',
            '\u{2013}' | '\u{2014}' | '\u{2212}' => '-',
            '\u{2033}' | '\u{201d}' | '\u{201c}' => '"',
            c => c,
        };
        let is_number = |c: char| c.is_ascii_digit() || c == '.';
        let mut words: Vec<String> = Vec::new();
        let mut before = ' ';
        for c in (0..given.len()).map(usual) {
            let continues = is_number(before) && is_number(c) || before.is_alphabetic() && c.is_alphabetic();
            match words.last_mut() {
                Some(word) if continues => word.push(c),
                _ if c.is_whitespace() => {}
                _ => words.push(c.into()),
            }
            before = c;
        }
        Self { words, position: 0 }
    }

    fn is_empty(&self) -> bool {
        self.position >= self.words.len()
    }

    fn peek(&self) -> Option<&str> {
        self.words.get(self.position).map(String::as_str)
    }

    /// Skips the next word if it is one of these.
    fn skip_any(&mut self, words: &[&str]) -> bool {
        let skips = self.peek().is_some_and(|word| words.contains(&word));
        self.position += usize::from(skips);
        skips
    }

    /// Reads the name of an axis, and returns its index in [`FIELD_NAMES`].
    fn axis(&mut self) -> Option<usize> {
        let word = self.peek()?;
        let is_name = |name: &str| {
            let short = &name[..1];
            word == name || word == short || word == format!("{short}fov") || word == &name[..4]
        };
        let axis = FIELD_NAMES.iter().position(|name| is_name(name))?;
        self.position += 1;
        Some(axis)
    }

    fn number(&mut self) -> Option<f64> {
        let number = self.peek()?.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0)?;
        self.position += 1;
        Some(number)
    }

    /// Reads two numbers with a sign between them.
    fn pair(&mut self, sign: &str) -> Option<[f64; 2]> {
        let start = self.position;
        let first = self.number();
        let _ = self.skip_any(&["mm"]);
        let pair = first.filter(|_| self.skip_any(&[sign])).zip(self.number());
        if pair.is_none() {
            self.position = start;
        }
        pair.map(|(first, second)| [first, second])
    }

    /// Reads a value: a number, a number with a standard deviation, an exact number, or a range.
    fn value(&mut self) -> Option<Nominal> {
        if self.skip_any(&["exactly"]) {
            return self.number().map(|value| Nominal::Known(Known::fixed(value)));
        }
        if let Some([low, high]) = self.pair("-") {
            // The standard deviation of a uniform distribution is its width over the square root of 12.
            let sigma = (high / low).ln().abs() / 12.0_f64.sqrt();
            let rounded = |value: f64| (1000.0 * value).round() / 1000.0;
            let value = (low * high).sqrt();
            return Some(Nominal::Known(Known::prior(rounded(value), rounded(value * sigma).max(0.001))));
        }
        let value = self.number()?;
        // The unit may precede the standard deviation.
        let start = self.position;
        let _ = self.skip_any(&["mm"]) || self.skip_any(DEGREES);
        if self.skip_any(&["\u{b1}"]) {
            return self.number().map(|sigma| Nominal::Known(Known::prior(value, sigma)));
        }
        self.position = start;
        Some(Nominal::Number(value))
    }

    fn error(&self) -> DataSheetError {
        self.error_at(self.position)
    }

    /// Returns the error for the word at a position, which is not understood.
    fn error_at(&self, position: usize) -> DataSheetError {
        self.words
            .get(position)
            .map_or(DataSheetError::MissingNumber, |word| DataSheetError::UnknownWord(word.clone()))
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

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [1920, 1080];

    fn read(text: &str) -> DataSheet {
        DataSheet::parse(text, SIZE).unwrap_or_else(|error| panic!("{text}: {error}"))
    }

    #[test]
    fn usual_notations_are_read() {
        let usual = DataSheet {
            focal_mm: Some(Nominal::Number(2.8)),
            sensor: Some("1/2.7".into()),
            ..DataSheet::default()
        };
        for text in
            ["2.8 mm 1/2.7", "2.8mm 1/2.7\"", "1/2.7\u{2033} CMOS, 2,8 mm lens", "Lens: 2.8 mm; 1 / 2.7 inch"]
        {
            assert_eq!(read(text), usual, "{text}");
        }
        let field =
            DataSheet { fields_deg: [Some(Nominal::Number(98.0)), None, None], ..DataSheet::default() };
        for text in [
            "h 98\u{b0}",
            "98\u{b0} horizontal",
            "HFOV: 98",
            "Horizontal field of view 98 degrees",
            "H98\u{b0}",
        ] {
            assert_eq!(read(text), field, "{text}");
        }
        assert_eq!(read("5.6 \u{d7} 3.15 mm, 4 mm").sensor_mm, Some([5.6, 3.15]));
        assert_eq!(read("26 mm equivalent").sensor_mm, Some([37.71, 21.21]));
        assert_eq!(read("2/3 8 mm").sensor.as_deref(), Some("2/3"));
        assert_eq!(read("8.8 mm 1\" type").sensor.as_deref(), Some("1\""));
        for text in ["1/2.7,2.8mm", "2.8 mm 1/2.7."] {
            assert_eq!(read(text), usual, "{text}");
        }
        assert_eq!(read("26 mm equiv. 98\u{ba} horizontal").fields_deg[0], Some(Nominal::Number(98.0)));
        assert_eq!(read(""), DataSheet::default());
    }

    #[test]
    fn ranges_and_tolerances_have_standard_deviations() {
        let Some(Nominal::Known(Known { value, sigma, fixed: false })) = read("2.8-12 mm 1/2.8").focal_mm
        else {
            panic!("a range has a standard deviation");
        };
        assert!((value - 5.797).abs() < 1e-9 && (sigma.unwrap() / value - 0.42).abs() < 0.001);
        let with_sigma = Some(Nominal::Known(Known::prior(2.8, 0.1)));
        assert_eq!(read("2.8 \u{b1} 0.1 mm 1/2.8").focal_mm, with_sigma);
        assert_eq!(read("2.8 mm \u{b1} 0.1 mm 1/2.8").focal_mm, with_sigma);
        assert_eq!(read("exactly 2.8 mm 1/2.8").focal_mm, Some(Nominal::Known(Known::fixed(2.8))));
    }

    #[test]
    fn the_text_form_is_read_again() {
        for text in [
            "2.8 mm 1/2.7",
            "exactly 6 mm 5.6 x 3.15 mm",
            "2.8-12 mm 1/2.8 horizontal 98\u{b0}",
            "d 110 \u{b1} 2",
        ] {
            let sheet = read(text);
            assert_eq!(read(&sheet.to_string()), sheet, "{text}: {sheet}");
        }
    }

    #[test]
    fn errors_name_the_word_or_the_missing_value() {
        let error = |text: &str| DataSheet::parse(text, SIZE).unwrap_err().to_string();
        assert!(error("2.8 mm").contains("Add the size of the sensor"));
        assert!(error("1/2.8").contains("Add the focal length"));
        assert!(error("2.8 mm 1/2.8 wide").contains("\"wide\""));
        assert!(error("98\u{b0}").contains("\"98\""));
        assert!(error("horizontal").contains("number is missing"));
        assert!(error("4 mm 1/99").contains("No sensor"));
        assert!(error("-3 mm 1/3").contains("\"-\""));
        assert!(error("26 mm equivalent (4.2 mm)").contains("two values for the focal length"));
        assert!(error("2.8 mm 1/2.7 5.6 x 3.15 mm").contains("size of the sensor"));
        assert!(error("horizontal 200").contains("179"));
    }
}
