//! Annotated lines with their residuals, signs and extensions, and control points with their reprojections.

use calib_core::floor::line_extension;
use calib_core::single::{Shape, line_name};
use calib_core::{Annotation, Camera, Kind, Pixel, Residual, UndistortedPixel};

use crate::image::ImageView;
use crate::item::{AnnotatedLine, Geometry, Item, Meaning};
use crate::kind::{KindLook, SQUARE, SQUARE_OFFSET, Sign};

/// Signs on lines, in addition to their colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signs {
    /// Signs of all kinds of annotations.
    All,
    /// Right-angle signs only, for views in which the name of every line shows its kind. Only lines at right
    /// angles to the first line of their annotation have the sign.
    RightAngles,
}

/// Returns the annotated lines of a camera with their points, signs and names.
pub(super) fn annotations(view: &ImageView, signs: Signs) -> Vec<Item<Pixel>> {
    let Some(entry) = view.entry() else { return Vec::new() };
    let mut items = Vec::new();
    for (index, annotation) in entry.annotations.iter().enumerate() {
        for (segment, points) in annotation.polylines().enumerate() {
            let meaning = Meaning::Annotation(annotated_line(view, annotation, index, segment));
            let ends = points.first().copied().zip(points.last().copied());
            let dots: Vec<Item<Pixel>> = points.iter().map(|&at| Item::point(meaning, at)).collect();
            let drawn_points = points.len();
            let line = view.image_curve(points);
            let middle = line.get(line.len() / 2).copied().filter(|_| line.len() > drawn_points);
            items.push(Item::polyline(meaning, line));
            if let Some(ends) = ends {
                let (signs, ends) = (signs.of(annotation, segment), sign_segment(middle, ends));
                items.extend(signs.map(|sign| Item::new(meaning, Geometry::Sign(sign, ends))));
            }
            items.extend(dots);
            if let (Some((first, _)), Some(_)) = (ends, view.label_scale) {
                items.push(Item::label(meaning, first, line_name(&entry.annotations, index, segment)));
            }
        }
    }
    items
}

impl Signs {
    /// Returns the signs on a line of an annotation.
    fn of(self, annotation: &Annotation, segment: usize) -> impl Iterator<Item = Sign> {
        let of_kind = KindLook::of(annotation.kind).sign;
        let of_kind = match self {
            Self::All => Some(of_kind),
            Self::RightAngles => Some(of_kind).filter(|&sign| sign == SQUARE && segment > 0),
        };
        // The first line of a direction at right angles to another one has the square in addition.
        let is_second = annotation.at_right_angles_to.is_some() && segment == 0 && self == Self::All;
        of_kind.into_iter().chain(is_second.then_some(SQUARE_OFFSET))
    }
}

/// Returns the segment on which a sign is placed, in raw pixels: the chord of the line. If the line is
/// curved, the chord is moved to the middle of the curve.
fn sign_segment(middle: Option<Pixel>, (a, b): (Pixel, Pixel)) -> [Pixel; 2] {
    let Some(middle) = middle else { return [a, b] };
    let (u, v) = (middle.u - 0.5 * (a.u + b.u), middle.v - 0.5 * (a.v + b.v));
    [a, b].map(|end| Pixel::new(end.u + u, end.v + v))
}

/// Returns the kind, indices, state and residual of a line.
fn annotated_line(view: &ImageView, drawn: &Annotation, annotation: usize, segment: usize) -> AnnotatedLine {
    let residuals = view.scene.solution(view.camera).map_or(&[][..], |solution| &solution.residuals);
    let is_of = |r: &&Residual| r.annotation == Some(annotation) && r.segment == Some(segment);
    let residual = residuals.iter().find(is_of);
    let sigma = view.entry().and_then(|entry| entry.sigma_px).unwrap_or(1.0);
    AnnotatedLine {
        kind: drawn.kind,
        annotation,
        segment,
        is_off: drawn.off,
        is_outlier: residual.is_some_and(|residual| residual.outlier),
        residual_px: residual.map(|residual| residual.px),
        over_sigma: residual.map(|residual| residual.px.abs() / sigma),
    }
}

/// Returns the extensions of an annotated line beyond both ends, towards its vanishing point, curved by the
/// distortion. A polyline has no extensions, because it follows an edge that ends.
#[must_use]
pub fn extension(camera: &Camera, kind: Kind, points: &[Pixel]) -> Vec<Item<Pixel>> {
    /// Number of segments in an extension.
    const STEPS: i32 = 60;
    /// Length of an extension, in lengths of the annotated line.
    const EXTENSION_LENGTHS: f64 = 8.0;
    if kind.row().shape == Shape::Polyline {
        return Vec::new();
    }
    let ends = points.first().zip(points.last());
    if camera.lens.distortion.is_wide() {
        let sides = ends.map_or_else(Vec::new, |(&a, &b)| vec![[b, a], [a, b]]);
        let beyond = sides.into_iter().map(|ends| line_extension(&camera.lens, ends));
        return beyond.map(|line| Item::polyline(Meaning::Extension(kind), line)).collect();
    }
    let ends = ends.and_then(|(&a, &b)| camera.undistort(a).zip(camera.undistort(b)));
    let Some((a, b)) = ends else { return Vec::new() };
    let at = |t: f64| camera.distort(UndistortedPixel::new(a.u + t * (b.u - a.u), a.v + t * (b.v - a.v)));
    let side = |from: f64, to: f64| {
        let points = (0..=STEPS).map_while(|i| at(from + (to - from) * f64::from(i) / f64::from(STEPS)));
        Item::polyline(Meaning::Extension(kind), points.collect())
    };
    vec![side(0.0, -EXTENSION_LENGTHS), side(1.0, 1.0 + EXTENSION_LENGTHS)]
}

/// Returns the control points of a camera with their residuals and names.
pub(super) fn control_points(view: &ImageView) -> Vec<Item<Pixel>> {
    let Some(entry) = view.entry() else { return Vec::new() };
    let mut items = Vec::new();
    for (index, point) in entry.control_points.iter().enumerate() {
        let meaning = Meaning::ControlPoint { camera: view.camera, index, is_off: point.off };
        items.push(Item::point(meaning, point.px));
        let world = point.control_point(view.site()).map(|control| control.world);
        let shown = view.pose.and_then(|camera| camera.world_to_pixel(world?));
        let residual = Meaning::Residual { is_off: point.off };
        items.extend(shown.map(|shown| Item::polyline(residual, vec![point.px, shown])));
        let name = point.name.as_ref().or(point.id.as_ref());
        items.extend(name.map(|name| Item::label(meaning, point.px, name.clone())));
    }
    items
}
