//! Lengths on screen: metres, or feet. In the site they are metres.
//!
//! Numbers as the screen writes them.

/// A number with so many digits and a real minus.
#[must_use]
pub fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    if is_zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}

/// What lengths are shown and typed in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Units {
    /// Metres and centimetres.
    #[default]
    Metres,
    /// Feet and inches.
    Feet,
}

/// Metres in a foot.
const FOOT: f64 = 0.3048;
/// Metres in an inch.
const INCH: f64 = 0.0254;

impl Units {
    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Metres => Self::Feet,
            Self::Feet => Self::Metres,
        }
    }

    /// Metres in one of them.
    #[must_use]
    pub const fn metres(self) -> f64 {
        match self {
            Self::Metres => 1.0,
            Self::Feet => FOOT,
        }
    }

    /// Its sign.
    #[must_use]
    pub const fn sign(self) -> &'static str {
        match self {
            Self::Metres => "m",
            Self::Feet => "ft",
        }
    }

    /// A length in metres as a number of these.
    #[must_use]
    pub fn number(self, metres: f64, digits: usize) -> String {
        number(metres / self.metres(), digits)
    }

    /// A length in metres, with the sign.
    #[must_use]
    pub fn length(self, metres: f64, digits: usize) -> String {
        format!("{} {}", self.number(metres, digits), self.sign())
    }

    /// A length in metres that is small as a rule: in centimetres or inches, with the sign; from a metre on
    /// as any other.
    #[must_use]
    pub fn small(self, metres: f64) -> String {
        match self {
            _ if metres.abs() >= 1.0 => self.length(metres, 2),
            Self::Metres => format!("{} cm", number(100.0 * metres, 1)),
            Self::Feet => format!("{} in", number(metres / INCH, 1)),
        }
    }

    /// A small length with its standard deviation, both in metres, in one unit.
    #[must_use]
    pub fn small_and_sigma(self, metres: f64, sigma: f64) -> String {
        let (one, sign) = match self {
            _ if metres.abs().max(sigma) >= 1.0 => (self.metres(), self.sign()),
            Self::Metres => (0.01, "cm"),
            Self::Feet => (INCH, "in"),
        };
        format!("{} \u{b1} {} {sign}", number(metres / one, 1), number(sigma / one, 1))
    }

    /// A point of the floor, in metres: two numbers and the sign.
    #[must_use]
    pub fn point(self, [x, y]: [f64; 2], digits: usize) -> String {
        format!("{}, {}", self.number(x, digits), self.length(y, digits))
    }

    /// The least step of these, in metres, of which `reach` metres are fewer than `most`.
    #[must_use]
    pub fn step(self, reach: f64, most: f64) -> f64 {
        let steps = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];
        let steps = steps.map(|step| step * self.metres());
        steps.into_iter().find(|step| reach / step < most).unwrap_or(steps[steps.len() - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_the_same_in_both() {
        assert_eq!(Units::Metres.length(3.048, 2), "3.05 m");
        assert_eq!(Units::Feet.length(3.048, 2), "10.00 ft");
        assert_eq!(Units::Feet.small(-0.0254), "\u{2212}1.0 in");
        assert_eq!(Units::Metres.small(0.034), "3.4 cm");
        assert_eq!(Units::Metres.small(9.987), "9.99 m");
        assert_eq!(Units::Metres.small_and_sigma(0.053, 0.08), "5.3 \u{b1} 8.0 cm");
        assert_eq!(Units::Metres.small_and_sigma(0.3, 2.0), "0.3 \u{b1} 2.0 m");
    }

    #[test]
    fn steps_are_round_in_their_unit() {
        assert_eq!(Units::Metres.step(25.0, 30.0), 1.0);
        assert!((Units::Feet.step(25.0, 30.0) - 5.0 * FOOT).abs() < 1e-12);
    }
}
