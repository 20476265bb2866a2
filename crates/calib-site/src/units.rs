//! Display and input of lengths in metres or feet; the site stores metres.
//!
//! Also formatting of numbers.

use serde::{Deserialize, Serialize};

/// Formats a number with `digits` decimals and a typographic minus sign.
#[must_use]
pub fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    if is_zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}

/// Display and input unit of lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Units {
    /// Metres and centimetres.
    #[default]
    Metres,
    /// Feet and inches.
    Feet,
}

/// Length of a foot, in metres.
const METRES_PER_FOOT: f64 = 0.3048;
/// Length of an inch, in metres.
const METRES_PER_INCH: f64 = 0.0254;

impl Units {
    /// Whether lengths are shown in metres.
    #[must_use]
    pub fn is_metres(&self) -> bool {
        *self == Self::Metres
    }

    /// Reads a length, in this unit unless the text names another one, and returns it in metres. `None` if the
    /// text is not a length. Examples: `1.75`, `1,75 m`, `175 cm`, `5 ft 9 in`, `5' 9"`, `69 in`.
    #[must_use]
    pub fn parse_length(self, text: &str) -> Option<f64> {
        let text = text.trim().to_lowercase().replace(['\u{2212}', '\u{2013}'], "-");
        let text =
            text.replace('\u{2019}', "'").replace('\u{201d}', "\"").replace("ft.", "ft").replace("in.", "in");
        // In feet, 1,000 can mean one thousand, or one with three decimals.
        let is_ambiguous = text.split_once(',').is_some_and(|(_, digits)| {
            self == Self::Feet && digits.len() == 3 && digits.chars().all(|c| c.is_ascii_digit())
        });
        if is_ambiguous {
            return None;
        }
        let text = text.replace(',', ".");
        let (sign, text) = text.strip_prefix('-').map_or((1.0, text.as_str()), |rest| (-1.0, rest));
        let mut sum = 0.0;
        let mut rest = text.trim_start();
        let mut smallest = f64::INFINITY;
        while !rest.is_empty() {
            let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
            let value: f64 = rest[..end].parse().ok()?;
            rest = rest[end..].trim_start();
            let end = rest.find(|c: char| c.is_ascii_digit() || c == '.').unwrap_or(rest.len());
            let unit = match rest[..end].trim() {
                // The inches of 5'9 need no unit.
                "" if smallest == METRES_PER_FOOT => METRES_PER_INCH,
                "" if smallest.is_infinite() && rest.is_empty() => self.metres(),
                "m" | "metres" | "meters" => 1.0,
                "cm" => 0.01,
                "mm" => 0.001,
                "ft" | "'" | "\u{2032}" | "feet" | "foot" => METRES_PER_FOOT,
                "in" | "\"" | "\u{2033}" | "''" | "inches" | "inch" => METRES_PER_INCH,
                _ => return None,
            };
            // Each part has a smaller unit than the part before.
            if unit >= smallest {
                return None;
            }
            smallest = unit;
            sum += value * unit;
            rest = rest[end..].trim_start();
        }
        (smallest < f64::INFINITY && sum.is_finite()).then_some(sign * sum)
    }

    /// Returns feet for metres, and metres for feet.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Metres => Self::Feet,
            Self::Feet => Self::Metres,
        }
    }

    /// Returns the length of the unit, in metres.
    #[must_use]
    pub const fn metres(self) -> f64 {
        match self {
            Self::Metres => 1.0,
            Self::Feet => METRES_PER_FOOT,
        }
    }

    /// Returns the name of the unit.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Metres => "metres",
            Self::Feet => "feet",
        }
    }

    /// Returns the symbol of the unit.
    #[must_use]
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Metres => "m",
            Self::Feet => "ft",
        }
    }

    /// Formats a length given in metres as a number in this unit, with `digits` decimals and without the
    /// unit.
    #[must_use]
    pub fn number(self, metres: f64, digits: usize) -> String {
        number(metres / self.metres(), digits)
    }

    /// Formats a length given in metres in this unit, with `digits` decimals and the unit.
    #[must_use]
    pub fn length(self, metres: f64, digits: usize) -> String {
        format!("{} {}", self.number(metres, digits), self.symbol())
    }

    /// Formats a length given in metres in this unit, with the unit and at most 3 decimals; zeros at the end
    /// are omitted.
    #[must_use]
    pub fn trimmed_length(self, metres: f64) -> String {
        let rounded = (metres / self.metres() * 1000.0).round() / 1000.0;
        format!("{} {}", rounded + 0.0, self.symbol()).replace('-', "\u{2212}")
    }

    /// Formats a length given in metres in centimetres or inches; from one metre on, in metres or feet.
    #[must_use]
    pub fn short_length(self, metres: f64) -> String {
        match self {
            _ if metres.abs() >= 1.0 => self.length(metres, 2),
            Self::Metres => format!("{} cm", number(100.0 * metres, 1)),
            Self::Feet => format!("{} in", number(metres / METRES_PER_INCH, 1)),
        }
    }

    /// Formats a length and its standard deviation, both given in metres, in the same unit.
    #[must_use]
    pub fn short_length_and_sigma(self, metres: f64, sigma: f64) -> String {
        let (one, sign) = match self {
            _ if metres.abs().max(sigma) >= 1.0 => (self.metres(), self.symbol()),
            Self::Metres => (0.01, "cm"),
            Self::Feet => (METRES_PER_INCH, "in"),
        };
        format!("{} \u{b1} {} {sign}", number(metres / one, 1), number(sigma / one, 1))
    }

    /// Formats a floor point given in metres in this unit: x and y with `digits` decimals.
    #[must_use]
    pub fn point(self, [x, y]: [f64; 2], digits: usize) -> String {
        format!("{}, {}", self.number(x, digits), self.length(y, digits))
    }

    /// Returns the smallest step that divides the distance `reach` into fewer than `most` parts. Both are in metres.
    /// The step is a round number in this unit, such as 0.5, 1 or 2.
    #[must_use]
    pub fn step(self, reach: f64, most: f64) -> f64 {
        let steps = self.round_lengths();
        steps.into_iter().find(|step| reach / step < most).unwrap_or(steps[steps.len() - 1])
    }

    /// Returns the largest length below `limit` that is round in this unit, for a scale bar. Lengths are in
    /// metres.
    #[must_use]
    pub fn round_length_below(self, limit: f64) -> f64 {
        let lengths = self.round_lengths();
        lengths.into_iter().rfind(|length| *length < limit).unwrap_or(lengths[0])
    }

    /// Returns lengths that are round in this unit, in metres, in ascending order.
    fn round_lengths(self) -> [f64; 13] {
        let lengths = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];
        lengths.map(|length| length * self.metres())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_converted_to_both_units() {
        assert_eq!(Units::Metres.length(3.048, 2), "3.05 m");
        assert_eq!(Units::Feet.length(3.048, 2), "10.00 ft");
        assert_eq!(Units::Feet.short_length(-0.0254), "\u{2212}1.0 in");
        assert_eq!(Units::Metres.short_length(0.034), "3.4 cm");
        assert_eq!(Units::Metres.short_length(9.987), "9.99 m");
        assert_eq!(Units::Metres.short_length_and_sigma(0.053, 0.08), "5.3 \u{b1} 8.0 cm");
        assert_eq!(Units::Metres.short_length_and_sigma(0.3, 2.0), "0.3 \u{b1} 2.0 m");
    }

    #[test]
    fn lengths_of_steps_and_scale_bars_are_round() {
        assert_eq!(Units::Feet.trimmed_length(Units::Feet.step(30.0, 24.0)), "5 ft");
        assert_eq!(Units::Metres.trimmed_length(Units::Metres.step(30.0, 24.0)), "2 m");
        assert_eq!(Units::Feet.trimmed_length(Units::Feet.round_length_below(3.5)), "10 ft");
        assert_eq!(Units::Metres.trimmed_length(-2.5), "\u{2212}2.5 m");
        assert_eq!(Units::Metres.round_length_below(0.01), 0.1);
    }

    #[test]
    fn typed_lengths_have_units() {
        let feet = |text: &str| Units::Feet.parse_length(text).map(|metres| (metres * 1e4).round() / 1e4);
        for text in
            ["5 ft 9 in", "5' 9\"", "5'9", "5.75", "5,75 ft", "69 in", "1.7526 m", "175.26 cm", "5 ft. 9 in."]
        {
            assert_eq!(feet(text), Some(1.7526), "{text}");
        }
        assert_eq!(feet("-2 ft"), Some(-0.6096));
        assert_eq!(Units::Metres.parse_length("1,75"), Some(1.75));
        for text in ["", "ft", "5 yards", "1 2", "9 in 5 ft", "1..2", "1e3", "5' 9\" 3", "1,000"] {
            assert_eq!(feet(text), None, "{text}");
        }
    }

    #[test]
    fn steps_are_round_in_their_unit() {
        assert_eq!(Units::Metres.step(25.0, 30.0), 1.0);
        assert!((Units::Feet.step(25.0, 30.0) - 5.0 * METRES_PER_FOOT).abs() < 1e-12);
    }
}
