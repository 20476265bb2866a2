//! Annotations: lines and objects that the operator draws on an image, in raw pixels, and the table of their
//! kinds.
//!
//! The file also contains the table of usual sizes. An annotation with `like` gets the usual size of an
//! object, with a standard deviation, instead of a measured size. The standard deviation is the variation of
//! the object's size between places, not the error of one measurement.

use crate::camera::Pixel;

/// Known value: fixed, or a prior with a standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Known {
    /// The value, in the unit of its field.
    pub value: f64,
    /// Whether the value is fixed: the solve does not change it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub fixed: bool,
    /// Standard deviation, in the unit of the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f64>,
}

impl Known {
    /// Returns a fixed value.
    #[must_use]
    pub const fn fixed(value: f64) -> Self {
        Self { value, fixed: true, sigma: None }
    }

    /// Returns a value with a standard deviation.
    #[must_use]
    pub const fn prior(value: f64, sigma: f64) -> Self {
        Self { value, fixed: false, sigma: Some(sigma) }
    }
}

/// Kind of an annotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Kind {
    /// Segments that are vertical in space.
    Vertical,
    /// Horizontal segments that are parallel to each other.
    Parallel,
    /// Horizontal segments, all at right angles to the first.
    Perpendicular,
    /// Floor segments of equal, unknown length.
    EqualLength,
    /// Floor segments of a known length.
    KnownLength,
    /// A polyline along an edge that is straight in space.
    Straight,
    /// A person or post of known height, from foot to head.
    Upright,
}

/// Shape of an annotation on the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Any number of lines, each with two or more points.
    Segments,
    /// One polyline of three or more points.
    Polyline,
    /// One foot and one head.
    FootAndHead,
}

/// Constraint that a kind of annotation puts on a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConstraintKind {
    /// Every segment points to the nadir.
    Vertical,
    /// Every segment follows one floor direction, which tied annotations share.
    Parallel,
    /// The first segment follows a floor direction, the others are at right angles to it.
    RightAngle,
    /// All segments have the same length on the floor, known or unknown.
    Length,
    /// The undistorted points are on one line.
    StraightEdge,
    /// A foot on the floor, and a head at a known height above it.
    Upright,
}

/// Whether a field must, may or must not be present in annotations of a kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldUse {
    /// The field must not be present.
    Never,
    /// The field may be omitted.
    Optionally,
    /// The field must be present.
    Always,
}

impl FieldUse {
    /// Returns `Always` if the condition is true, else `Never`.
    const fn always_if(is: bool) -> Self {
        if is { Self::Always } else { Self::Never }
    }
}

/// Entry of the table [`KINDS`]: the properties of one kind of annotation.
#[derive(Clone, Copy, Debug)]
pub struct KindRow {
    /// Kind of annotation that the entry describes.
    pub kind: Kind,
    /// Name of the kind in files.
    pub name: &'static str,
    /// Name of the kind on screen.
    pub title: &'static str,
    /// Letter that, with a number, names a line: V1, P3.
    pub letter: char,
    /// Shape of the annotation on the image.
    pub shape: Shape,
    /// Minimum number of segments that constrains the camera.
    pub min_segments: usize,
    /// Whether annotations of this kind have `length_m`.
    pub has_length: bool,
    /// Constraint that annotations of this kind put on the camera.
    pub constraint: ConstraintKind,
    /// Whether the paper's method uses annotations of this kind.
    pub in_paper: bool,
    /// Whether each annotation of this kind is a separate group, distinguished by a letter.
    pub has_letter: bool,
}

impl KindRow {
    /// Whether the annotated objects are upright in space.
    #[must_use]
    pub const fn is_upright(&self) -> bool {
        matches!(self.constraint, ConstraintKind::Vertical | ConstraintKind::Upright)
    }

    /// Whether the annotated lines are horizontal, so that they can be shown on the floor plan.
    #[must_use]
    pub const fn is_level(&self) -> bool {
        matches!(
            self.constraint,
            ConstraintKind::Parallel | ConstraintKind::RightAngle | ConstraintKind::Length
        )
    }

    /// Whether unnamed annotations of this kind are equivalent to one annotation with all their lines.
    #[must_use]
    pub const fn is_one_group(&self) -> bool {
        matches!(self.constraint, ConstraintKind::Vertical | ConstraintKind::StraightEdge)
    }
}

/// All kinds of annotations, in the order of tools, legends and reports.
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
            min_segments: least,
            has_length: false,
            constraint,
            in_paper: true,
            has_letter: false,
        }
    }
    const fn lettered(row: KindRow) -> KindRow {
        KindRow { has_letter: true, ..row }
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

/// Returns the name of a line on overlays and in messages: the letter of its kind, and its number among the
/// lines of that kind, from 1.
#[must_use]
pub fn line_name(annotations: &[Annotation], annotation: usize, segment: usize) -> String {
    let Some(kind) = annotations.get(annotation).map(|a| a.kind) else { return String::new() };
    let count = |a: &Annotation| a.segments.as_ref().map_or(1, Vec::len);
    let before: usize = annotations[..annotation].iter().filter(|a| a.kind == kind).map(count).sum();
    format!("{}{}", kind.row().letter, before + segment + 1)
}

impl Kind {
    /// Returns the entry of this kind in [`KINDS`].
    #[must_use]
    pub fn row(self) -> &'static KindRow {
        &KINDS[self as usize]
    }
}

/// Annotation of an image. Its [`Kind`] determines which fields are present.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Annotation {
    /// Kind of the annotation.
    pub kind: Kind,
    /// Id for references from other annotations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Name given by the operator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Whether the annotation is switched off: it is not used, but its residual is reported.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub off: bool,
    /// Whether the annotation is never rejected as an outlier.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keep: bool,
    /// Segments, in raw pixels; a length is measured from the first point to the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segments: Option<Vec<Vec<Pixel>>>,
    /// Id of the parallel annotation whose direction is at right angles to this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_right_angles_to: Option<String>,
    /// Length of every segment, in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
    /// Points of the polyline, in raw pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<Vec<Pixel>>,
    /// Foot on the floor, in raw pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub foot: Option<Pixel>,
    /// Head, in raw pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub head: Option<Pixel>,
    /// Height from foot to head, in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_m: Option<Known>,
    /// Id of the plane of the annotation; the floor if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<String>,
    /// Id of an object of usual size, instead of a length or height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub like: Option<String>,
    /// Standard deviation of an annotated coordinate, in pixels; the camera's value if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_px: Option<f64>,
    /// Standard deviation of the right angle, in degrees; the scene's value if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_sigma_deg: Option<f64>,
    /// Relative standard deviation of the length. If absent, equal lengths use the scene's value, and a known
    /// length is exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_sigma_rel: Option<f64>,
    /// Whether the scene is assumed to be exactly as annotated, without errors of angle and length.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub exact: bool,
}

impl Annotation {
    /// Returns an empty annotation of a kind.
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

    /// Returns an annotation with segments.
    #[must_use]
    pub fn from_segments(kind: Kind, segments: Vec<Vec<Pixel>>) -> Self {
        Self { segments: Some(segments), ..Self::new(kind) }
    }

    /// Returns a straight-edge annotation with points along an edge.
    #[must_use]
    pub fn from_points(points: Vec<Pixel>) -> Self {
        Self { points: Some(points), ..Self::new(Kind::Straight) }
    }

    /// Returns the polylines of the annotation, of any kind, in the order of the residuals.
    pub fn polylines(&self) -> impl Iterator<Item = Vec<Pixel>> + '_ {
        let segments = self.segments.iter().flatten().cloned();
        let upright = self.foot.zip(self.head).map(|(foot, head)| vec![foot, head]);
        segments.chain(self.points.clone()).chain(upright)
    }

    /// Returns the fields that depend on the kind: name in files, whether the field is present, and whether
    /// it must, may or must not be present.
    pub fn fields(&self) -> [(&'static str, bool, FieldUse); 11] {
        let row = self.kind.row();
        let of_shape = |shape| FieldUse::always_if(row.shape == shape);
        let (segments, points) = (of_shape(Shape::Segments), of_shape(Shape::Polyline));
        let standing = of_shape(Shape::FootAndHead);
        let is_tied = self.at_right_angles_to.is_some();
        let optional = |belongs: bool| if belongs { FieldUse::Optionally } else { FieldUse::Never };
        let ties = optional(self.can_be_tied());
        let (angles, lengths) = (
            row.is_level() && row.constraint != ConstraintKind::Length,
            row.constraint == ConstraintKind::Length,
        );
        // With `like`, the size is optional.
        let size = |belongs: FieldUse| match belongs {
            FieldUse::Always if self.like.is_some() => FieldUse::Optionally,
            belongs => belongs,
        };
        [
            ("like", self.like.is_some(), optional(row.has_length || standing == FieldUse::Always)),
            ("angle_sigma_deg", self.angle_sigma_deg.is_some(), optional(angles)),
            ("length_sigma_rel", self.length_sigma_rel.is_some(), optional(lengths)),
            ("segments", self.segments.is_some(), segments),
            ("points", self.points.is_some(), points),
            ("foot", self.foot.is_some(), standing),
            ("head", self.head.is_some(), standing),
            ("height_m", self.height_m.is_some(), size(standing)),
            ("length_m", self.length_m.is_some(), size(FieldUse::always_if(row.has_length))),
            ("at_right_angles_to", is_tied, ties),
            ("plane", self.plane.is_some(), optional(row.is_level() || standing == FieldUse::Always)),
        ]
    }

    /// Whether the direction can be tied to the direction of another annotation.
    #[must_use]
    pub fn can_be_tied(&self) -> bool {
        self.kind.row().constraint == ConstraintKind::Parallel
    }

    /// Whether the annotation is a straight edge, which only constrains the lens.
    #[must_use]
    pub fn is_straight_edge(&self) -> bool {
        self.kind.row().constraint == ConstraintKind::StraightEdge
    }

    /// Returns the label of the annotation for messages: its name or id, else its kind, with the index.
    #[must_use]
    pub fn label(&self, index: usize) -> String {
        let title = self.kind.row().title;
        match self.name.as_ref().or(self.id.as_ref()) {
            Some(name) => format!("{title} \"{name}\" (annotation {index})"),
            None => format!("{title} (annotation {index})"),
        }
    }
}

/// Object of a usual size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UsualSize {
    /// Name of the object in files.
    pub id: &'static str,
    /// Name of the object on screen, with the measured dimension.
    pub title: &'static str,
    /// Usual size with its standard deviation, in metres.
    pub size: Known,
    /// Constraint of the size: [`ConstraintKind::Length`] on the floor, or [`ConstraintKind::Upright`].
    pub constraint: ConstraintKind,
    /// Whether the object is parallel to the road, like a lane mark.
    pub is_along_road: bool,
    /// Source of the numbers.
    pub source: &'static str,
}

impl UsualSize {
    /// Returns the object with this name in files.
    #[must_use]
    pub fn find(id: &str) -> Option<&'static Self> {
        USUAL_SIZES.iter().find(|usual| usual.id == id)
    }
}

/// All usual sizes, in the order of menus.
pub const USUAL_SIZES: [UsualSize; 12] = {
    use ConstraintKind::{Length, Upright};
    const fn row(
        (id, title): (&'static str, &'static str),
        (value, sigma): (f64, f64),
        constraint: ConstraintKind,
        source: &'static str,
    ) -> UsualSize {
        UsualSize { id, title, size: Known::prior(value, sigma), constraint, is_along_road: false, source }
    }
    [
        row(
            ("person", "Person, standing, with shoes"),
            (1.71, 0.09),
            Upright,
            "adults of both sexes: country means 1.60 to 1.83 m (NCD-RisC 2020), \u{3c3} 0.07 m within each sex, \
             shoes 0.02 m",
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
            is_along_road: true,
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
        row(("pallet-eur", "EUR pallet, long side"), (1.2, 0.005), Length, "1200 \u{b1} 5 mm (EN 13698-1)"),
        row(("pallet-gma", "GMA pallet, long side"), (1.219, 0.006), Length, "48 in"),
        row(
            ("container-20", "20 ft container, length"),
            (6.058, 0.006),
            Length,
            "6058 mm, +0/\u{2212}6 mm (ISO 668)",
        ),
    ]
};

impl Annotation {
    /// Returns the object of usual size that `like` refers to.
    #[must_use]
    pub fn usual_size(&self) -> Option<&'static UsualSize> {
        self.like.as_deref().and_then(UsualSize::find)
    }

    /// Returns the known length of the segments, in metres.
    #[must_use]
    pub fn length(&self) -> Option<Known> {
        let given = |length: f64| match self.length_sigma_rel.filter(|_| !self.exact) {
            Some(relative) => Known::prior(length, relative * length),
            None => Known::fixed(length),
        };
        self.length_m.map(given).or_else(|| self.usual_size_for(ConstraintKind::Length))
    }

    /// Returns the known height from foot to head, in metres.
    #[must_use]
    pub fn height(&self) -> Option<Known> {
        self.height_m.or_else(|| self.usual_size_for(ConstraintKind::Upright))
    }

    /// Returns the usual size of the object, if the size is of this kind.
    fn usual_size_for(&self, constraint: ConstraintKind) -> Option<Known> {
        self.usual_size().filter(|usual| usual.constraint == constraint).map(|usual| usual.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_is_in_the_order_of_the_kinds() {
        for row in &KINDS {
            assert_eq!(row.kind.row().name, row.name);
        }
    }

    #[test]
    fn lines_are_numbered_by_kind() {
        let of = |kind, count| Annotation::from_segments(kind, vec![Vec::new(); count]);
        let annotations = [of(Kind::Vertical, 3), of(Kind::Parallel, 2), of(Kind::Vertical, 2)];
        assert_eq!(line_name(&annotations, 0, 0), "V1");
        assert_eq!(line_name(&annotations, 2, 1), "V5");
        assert_eq!(line_name(&annotations, 1, 1), "P2");
    }

    #[test]
    fn usual_sizes_have_unique_names_and_plausible_sigmas() {
        for (index, usual) in USUAL_SIZES.iter().enumerate() {
            assert_eq!(UsualSize::find(usual.id), Some(&USUAL_SIZES[index]));
            assert!(usual.size.sigma.is_some_and(|sigma| sigma > 0.0 && sigma < 0.1 * usual.size.value));
        }
    }
}
