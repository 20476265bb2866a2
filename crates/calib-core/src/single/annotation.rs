//! Annotations: what the operator drew on an image, in raw pixels, and the table of their kinds.
//!
//! Sizes that are known about: things whose length or height is much the same everywhere.
//!
//! A drawing that is `like` one of them gets its size with its spread, where nobody measured. The spread is
//! that between places, not that of one tape.

use crate::camera::Pixel;

/// A value the operator knows, with how well: held, or a prior with a standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Known {
    /// The value, in the unit of its field.
    pub value: f64,
    /// Held: the solve does not change it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub fixed: bool,
    /// Standard deviation, in the unit of the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f64>,
}

impl Known {
    /// A value that is held.
    #[must_use]
    pub const fn fixed(value: f64) -> Self {
        Self { value, fixed: true, sigma: None }
    }

    /// A value with a standard deviation.
    #[must_use]
    pub const fn prior(value: f64, sigma: f64) -> Self {
        Self { value, fixed: false, sigma: Some(sigma) }
    }
}

/// What a drawing says about the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Kind {
    /// Segments that are plumb in space.
    Vertical,
    /// Level segments of one direction.
    Parallel,
    /// Level segments, every one at right angles to the first.
    Perpendicular,
    /// Floor segments of one unknown length.
    EqualLength,
    /// Floor segments of one known length.
    KnownLength,
    /// One polyline along an edge that is straight in space.
    Straight,
    /// A person or post of known height, from foot to head.
    Upright,
}

/// How a kind is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Any number of segments of two or more points.
    Segments,
    /// One polyline of three or more points.
    Polyline,
    /// One foot and one head.
    FootAndHead,
}

/// The constraint that a kind of annotation puts on a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConstraintKind {
    /// Every segment is a line to the nadir.
    Vertical,
    /// Every segment is a line along one floor direction, which annotations tied to it share.
    Parallel,
    /// The first segment is a line along a floor direction, the others lie at right angles to it.
    RightAngle,
    /// Every segment has one length on the floor, known or not.
    Length,
    /// The undistorted points lie on one line.
    StraightEdge,
    /// A foot on the floor with a head at a known height above it.
    Upright,
}

/// Whether annotations of a kind have a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Belongs {
    /// It has no such field.
    Never,
    /// It may be left out.
    Optionally,
    /// It must be there.
    Always,
}

impl Belongs {
    const fn always_if(is: bool) -> Self {
        if is { Self::Always } else { Self::Never }
    }
}

/// A row of the table of kinds.
#[derive(Clone, Copy, Debug)]
pub struct KindRow {
    /// Which kind.
    pub kind: Kind,
    /// Its name in files.
    pub name: &'static str,
    /// Its name on screen.
    pub title: &'static str,
    /// With a number, the name of a line: V1, P3.
    pub letter: char,
    /// How it is drawn.
    pub shape: Shape,
    /// The least number of segments that constrains the camera.
    pub least: usize,
    /// Whether `length_m` belongs to it.
    pub has_length: bool,
    /// The constraint that it puts on the camera.
    pub constraint: ConstraintKind,
    /// Whether the paper's method uses it.
    pub in_paper: bool,
    /// Whether annotations of this kind are told apart by a letter: each is a group of its own.
    pub is_lettered: bool,
}

impl KindRow {
    /// Whether what is drawn stands upright in space.
    #[must_use]
    pub const fn is_upright(&self) -> bool {
        matches!(self.constraint, ConstraintKind::Vertical | ConstraintKind::Upright)
    }

    /// Whether what is drawn is level: it can be shown from above.
    #[must_use]
    pub const fn is_level(&self) -> bool {
        matches!(
            self.constraint,
            ConstraintKind::Parallel | ConstraintKind::RightAngle | ConstraintKind::Length
        )
    }

    /// Whether annotations of this kind without a name say the same as one with all their lines.
    #[must_use]
    pub const fn is_one_group(&self) -> bool {
        matches!(self.constraint, ConstraintKind::Vertical | ConstraintKind::StraightEdge)
    }
}

/// Every kind of annotation, in the order of tools, legends and reports.
pub const KINDS: [KindRow; 7] = {
    use Shape::{FootAndHead, Polyline, Segments};
    const fn row(
        kind: Kind,
        names: (&'static str, &'static str, char),
        shape: Shape,
        least: usize,
        constraint: ConstraintKind,
    ) -> KindRow {
        let (name, title, letter) = names;
        KindRow {
            kind,
            name,
            title,
            letter,
            shape,
            least,
            has_length: false,
            constraint,
            in_paper: true,
            is_lettered: false,
        }
    }
    const fn lettered(row: KindRow) -> KindRow {
        KindRow { is_lettered: true, ..row }
    }
    const fn not_in_paper(row: KindRow) -> KindRow {
        KindRow { in_paper: false, ..row }
    }
    let equal_length = ("equal_length", "Equal length", 'E');
    let known_length =
        row(Kind::KnownLength, ("known_length", "Known length", 'L'), Segments, 1, ConstraintKind::Length);
    let right_angle = ("perpendicular", "Right angle", 'R');
    [
        row(Kind::Vertical, ("vertical", "Vertical", 'V'), Segments, 1, ConstraintKind::Vertical),
        lettered(row(Kind::Parallel, ("parallel", "Parallel", 'P'), Segments, 2, ConstraintKind::Parallel)),
        lettered(row(Kind::Perpendicular, right_angle, Segments, 2, ConstraintKind::RightAngle)),
        lettered(row(Kind::EqualLength, equal_length, Segments, 2, ConstraintKind::Length)),
        not_in_paper(KindRow { has_length: true, ..known_length }),
        row(Kind::Straight, ("straight", "Straight edge", 'S'), Polyline, 1, ConstraintKind::StraightEdge),
        not_in_paper(row(
            Kind::Upright,
            ("upright", "Upright", 'U'),
            FootAndHead,
            1,
            ConstraintKind::Upright,
        )),
    ]
};

/// The name of a line on overlays and in messages: the letter of its kind, and its number among the
/// lines of that kind, from 1.
#[must_use]
pub fn line_name(annotations: &[Annotation], annotation: usize, segment: usize) -> String {
    let Some(kind) = annotations.get(annotation).map(|a| a.kind) else { return String::new() };
    let count = |a: &Annotation| a.segments.as_ref().map_or(1, Vec::len);
    let before: usize = annotations[..annotation].iter().filter(|a| a.kind == kind).map(count).sum();
    format!("{}{}", kind.row().letter, before + segment + 1)
}

impl Kind {
    /// This kind's row in [`KINDS`].
    #[must_use]
    pub fn row(self) -> &'static KindRow {
        &KINDS[self as usize]
    }
}

/// One annotation of an image. Which fields it has, its [`Kind`] says.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Annotation {
    /// What it says about the scene.
    pub kind: Kind,
    /// By which others refer to it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// What the operator calls it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Not used; its residual is reported all the same.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub off: bool,
    /// Never rejected as an outlier.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keep: bool,
    /// Raw pixels; a length counts from the first point to the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segments: Option<Vec<Vec<Pixel>>>,
    /// The parallel annotation whose direction is at right angles to this one's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_right_angles_to: Option<String>,
    /// Length of every segment, in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
    /// The polyline, raw pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<Vec<Pixel>>,
    /// Where it stands on the floor, raw pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub foot: Option<Pixel>,
    /// Its top, raw pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub head: Option<Pixel>,
    /// From foot to head, in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_m: Option<Known>,
    /// The plane it is drawn on; the floor if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<String>,
    /// A thing of a usual size, in place of a length or height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub like: Option<String>,
    /// Standard deviation of a drawn coordinate, in pixels; that of the camera if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_px: Option<f64>,
    /// Standard deviation of the right angle that it claims, in degrees; that of the scene if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_sigma_deg: Option<f64>,
    /// Relative standard deviation of its length; if absent that of the scene for equal ones, none for a known
    /// one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_sigma_rel: Option<f64>,
    /// The scene is exactly what it says.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub exact: bool,
}

impl Annotation {
    /// An annotation of this kind with nothing drawn yet.
    #[must_use]
    pub const fn new(kind: Kind) -> Self {
        Self {
            kind,
            id: None,
            name: None,
            off: false,
            keep: false,
            segments: None,
            at_right_angles_to: None,
            length_m: None,
            points: None,
            foot: None,
            head: None,
            height_m: None,
            plane: None,
            like: None,
            sigma_px: None,
            angle_sigma_deg: None,
            length_sigma_rel: None,
            exact: false,
        }
    }

    /// An annotation of segments.
    #[must_use]
    pub fn of_segments(kind: Kind, segments: Vec<Vec<Pixel>>) -> Self {
        Self { segments: Some(segments), ..Self::new(kind) }
    }

    /// Points along an edge that is straight in space.
    #[must_use]
    pub fn of_points(points: Vec<Pixel>) -> Self {
        Self { points: Some(points), ..Self::new(Kind::Straight) }
    }

    /// Its polylines as drawn, whatever its kind: what to paint, and the order residuals count in.
    pub fn polylines(&self) -> impl Iterator<Item = Vec<Pixel>> + '_ {
        let segments = self.segments.iter().flatten().cloned();
        let upright = self.foot.zip(self.head).map(|(foot, head)| vec![foot, head]);
        segments.chain(self.points.clone()).chain(upright)
    }

    /// Its fields that not every kind has: the name in files, whether it is there, and whether it belongs.
    pub fn fields(&self) -> [(&'static str, bool, Belongs); 11] {
        let row = self.kind.row();
        let of_shape = |shape| Belongs::always_if(row.shape == shape);
        let (segments, points) = (of_shape(Shape::Segments), of_shape(Shape::Polyline));
        let standing = of_shape(Shape::FootAndHead);
        let is_tied = self.at_right_angles_to.is_some();
        let optional = |belongs: bool| if belongs { Belongs::Optionally } else { Belongs::Never };
        let ties = optional(self.may_be_tied());
        let (angles, lengths) = (
            row.is_level() && row.constraint != ConstraintKind::Length,
            row.constraint == ConstraintKind::Length,
        );
        // What it is like says its size.
        let size = |belongs: Belongs| match belongs {
            Belongs::Always if self.like.is_some() => Belongs::Optionally,
            belongs => belongs,
        };
        [
            ("like", self.like.is_some(), optional(row.has_length || standing == Belongs::Always)),
            ("angle_sigma_deg", self.angle_sigma_deg.is_some(), optional(angles)),
            ("length_sigma_rel", self.length_sigma_rel.is_some(), optional(lengths)),
            ("segments", self.segments.is_some(), segments),
            ("points", self.points.is_some(), points),
            ("foot", self.foot.is_some(), standing),
            ("head", self.head.is_some(), standing),
            ("height_m", self.height_m.is_some(), size(standing)),
            ("length_m", self.length_m.is_some(), size(Belongs::always_if(row.has_length))),
            ("at_right_angles_to", is_tied, ties),
            ("plane", self.plane.is_some(), optional(row.is_level() || standing == Belongs::Always)),
        ]
    }

    /// Whether its direction may be tied to that of another one.
    #[must_use]
    pub fn may_be_tied(&self) -> bool {
        self.kind.row().constraint == ConstraintKind::Parallel
    }

    /// Whether it is drawn to tell the lens: an edge that is straight in space, and nothing else is known of it.
    #[must_use]
    pub fn is_straight_edge(&self) -> bool {
        self.kind.row().constraint == ConstraintKind::StraightEdge
    }

    /// How a message calls it: its name or id if it has one, else its kind, with its index.
    #[must_use]
    pub fn label(&self, index: usize) -> String {
        let title = self.kind.row().title;
        match self.name.as_ref().or(self.id.as_ref()) {
            Some(name) => format!("{title} \"{name}\" (annotation {index})"),
            None => format!("{title} (annotation {index})"),
        }
    }
}

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
    fn the_table_is_in_the_order_of_the_kinds() {
        for row in &KINDS {
            assert_eq!(row.kind.row().name, row.name);
        }
    }

    #[test]
    fn lines_are_numbered_by_kind() {
        let of = |kind, count| Annotation::of_segments(kind, vec![Vec::new(); count]);
        let annotations = [of(Kind::Vertical, 3), of(Kind::Parallel, 2), of(Kind::Vertical, 2)];
        assert_eq!(line_name(&annotations, 0, 0), "V1");
        assert_eq!(line_name(&annotations, 2, 1), "V5");
        assert_eq!(line_name(&annotations, 1, 1), "P2");
    }

    #[test]
    fn names_are_told_apart_and_sizes_have_a_spread() {
        for (index, usual) in USUAL_SIZES.iter().enumerate() {
            assert_eq!(UsualSize::find(usual.id), Some(&USUAL_SIZES[index]));
            assert!(usual.size.sigma.is_some_and(|sigma| sigma > 0.0 && sigma < 0.1 * usual.size.value));
        }
    }
}
