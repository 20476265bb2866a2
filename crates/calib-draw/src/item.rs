//! One thing to be painted: where it lies, and what it means.

use crate::meaning::Meaning;
use crate::sign::Sign;

/// What there is to paint, in raw pixels of an image or in metres of the floor.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry<P> {
    /// From point to point.
    Polyline(Vec<P>),
    /// An outline that comes back to its start.
    Polygon(Vec<P>),
    /// A point, shown by a figure of the painter's.
    Point(P),
    /// A sign of the size of the screen, laid on the line between two points.
    Sign(Sign, [P; 2]),
    /// Words about a point.
    Label(P, String),
    /// A camera from above, a cone of the size of the screen.
    Cone {
        /// Where it stands.
        foot: P,
        /// A point ahead of it.
        ahead: P,
        /// Half its horizontal field of view, in radians.
        half_angle: f64,
    },
}

/// One thing to be painted.
#[derive(Clone, Debug, PartialEq)]
pub struct Item<P> {
    /// What it means.
    pub meaning: Meaning,
    /// Where it lies.
    pub geometry: Geometry<P>,
}

impl<P> Item<P> {
    pub(crate) const fn new(meaning: Meaning, geometry: Geometry<P>) -> Self {
        Self { meaning, geometry }
    }

    pub(crate) const fn polyline(meaning: Meaning, points: Vec<P>) -> Self {
        Self::new(meaning, Geometry::Polyline(points))
    }

    pub(crate) const fn polygon(meaning: Meaning, points: Vec<P>) -> Self {
        Self::new(meaning, Geometry::Polygon(points))
    }

    pub(crate) const fn point(meaning: Meaning, at: P) -> Self {
        Self::new(meaning, Geometry::Point(at))
    }

    pub(crate) const fn label(meaning: Meaning, at: P, text: String) -> Self {
        Self::new(meaning, Geometry::Label(at, text))
    }
}
