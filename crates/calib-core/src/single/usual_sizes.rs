//! Sizes that are known about: things whose length or height is much the same everywhere.
//!
//! A drawing that is `like` one of them gets its size with its spread, where nobody measured. The spread is
//! that between places, not that of one tape.

use crate::single::annotation::{Annotation, ConstraintKind, Known};

/// A thing of a usual size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UsualSize {
    /// Its name in files.
    pub id: &'static str,
    /// What it is called on screen, with what is measured of it.
    pub title: &'static str,
    /// In metres, with its standard deviation.
    pub size: Known,
    /// Whether it is a length on the floor or the height of something upright.
    pub constraint: ConstraintKind,
    /// Whether it lies along the way, as a mark does.
    pub lies_along: bool,
    /// Where the numbers come from.
    pub source: &'static str,
}

impl UsualSize {
    /// The one of this name.
    #[must_use]
    pub fn find(id: &str) -> Option<&'static Self> {
        USUAL_SIZES.iter().find(|usual| usual.id == id)
    }
}

/// Every usual size, in the order of menus.
pub const USUAL_SIZES: [UsualSize; 12] = {
    use ConstraintKind::{Length, Upright};
    const fn row(
        (id, title): (&'static str, &'static str),
        (value, sigma): (f64, f64),
        constraint: ConstraintKind,
        source: &'static str,
    ) -> UsualSize {
        UsualSize { id, title, size: Known::prior(value, sigma), constraint, lies_along: false, source }
    }
    [
        row(
            ("person", "Person, standing, with shoes"),
            (1.71, 0.09),
            Upright,
            "adults of both sexes, NCD-RisC 2020 country means 1.60 to 1.83 m with 0.07 m within a sex, shoes 0.02 m",
        ),
        row(("door", "Door leaf, height"), (2.03, 0.04), Upright, "1.985 m (DIN 18101) to 2.134 m (7 ft)"),
        row(
            ("door-width", "Door leaf, width"),
            (0.86, 0.07),
            Length,
            "0.735 to 0.985 m (DIN 18101), 32 to 36 in",
        ),
        row(
            ("lane-eu", "Lane of a main road, Europe, width"),
            (3.5, 0.15),
            Length,
            "3.25 to 3.75 m (RAA, RAL)",
        ),
        row(
            ("lane-us", "Lane of a main road, US, width"),
            (3.6, 0.15),
            Length,
            "11 to 12 ft (AASHTO Green Book)",
        ),
        UsualSize {
            lies_along: true,
            ..row(
                ("lane-mark-us", "Broken lane line, US, length of a mark"),
                (3.05, 0.1),
                Length,
                "10 ft (MUTCD 3A.06)",
            )
        },
        row(("parking-bay", "Parking bay, width"), (2.5, 0.1), Length, "2.3 to 2.7 m (EAR, IStructE)"),
        row(
            ("car-width", "Passenger car without mirrors, width"),
            (1.81, 0.08),
            Length,
            "ICCT pocketbook, mean of new cars 1.80 to 1.83 m",
        ),
        row(
            ("car-length", "Passenger car, length"),
            (4.4, 0.3),
            Length,
            "ICCT pocketbook, mean of new cars 4.35 to 4.45 m",
        ),
        row(("pallet-eur", "EUR pallet, long side"), (1.2, 0.005), Length, "1200 +- 5 mm (EN 13698-1)"),
        row(("pallet-gma", "GMA pallet, long side"), (1.219, 0.006), Length, "48 in"),
        row(
            ("container-20", "Container of 20 ft, length"),
            (6.058, 0.006),
            Length,
            "6058 mm -6 +0 (ISO 668)",
        ),
    ]
};

impl Annotation {
    /// The thing of a usual size that it is like.
    #[must_use]
    pub fn usual(&self) -> Option<&'static UsualSize> {
        self.like.as_deref().and_then(UsualSize::find)
    }

    /// The known length of its segments, in metres.
    #[must_use]
    pub fn length(&self) -> Option<Known> {
        let given = |length: f64| match self.length_sigma_rel.filter(|_| !self.exact) {
            Some(relative) => Known::prior(length, relative * length),
            None => Known::fixed(length),
        };
        self.length_m.map(given).or_else(|| self.usual_of(ConstraintKind::Length))
    }

    /// Its known height from foot to head, in metres.
    #[must_use]
    pub fn height(&self) -> Option<Known> {
        self.height_m.or_else(|| self.usual_of(ConstraintKind::Upright))
    }

    fn usual_of(&self, constraint: ConstraintKind) -> Option<Known> {
        self.usual().filter(|usual| usual.constraint == constraint).map(|usual| usual.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_apart_and_sizes_have_a_spread() {
        for (index, usual) in USUAL_SIZES.iter().enumerate() {
            assert_eq!(UsualSize::find(usual.id), Some(&USUAL_SIZES[index]));
            assert!(usual.size.sigma.is_some_and(|sigma| sigma > 0.0 && sigma < 0.1 * usual.size.value));
        }
    }
}
