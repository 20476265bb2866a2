//! What `calib render` draws on a camera's image.

use calib_core::{
    Annotation, Camera, FloorPoint, Kind, Pixel, ResidualOf, Site, SiteCamera, Solution, floor_grid, horizon,
    line_name, on_image, prism,
};

use crate::overlay_links::{self, Shared};
use crate::svg::{Anchor, Stroke, Svg};
use crate::{lens_grid, style};

/// Everything known of a camera, drawn on its image; beneath it, if wanted, the grid that shows the lens.
pub(crate) fn overlay(site: &Site, entry: &SiteCamera, lens_grid: bool) -> Svg {
    let size = entry.size();
    let mut svg = Svg::new(size, style::scale(size));
    let colour = style::camera(site.cameras.iter().position(|other| std::ptr::eq(other, entry)).unwrap_or(0));
    if lens_grid {
        lens_grid::draw(&mut svg, &lens_grid::lens_of(entry), size);
    }
    if let (Some(solution), Some(camera)) = (&entry.solution, entry.camera()) {
        draw_floor(&mut svg, &camera, solution, size, colour);
        draw_horizon(&mut svg, &camera, size);
        draw_marks(&mut svg, site, &camera);
    }
    for (index, annotation) in entry.annotations.iter().enumerate() {
        draw_annotation(&mut svg, entry, index, annotation);
    }
    draw_control_points(&mut svg, site, entry);
    let shared = overlay_links::draw(&mut svg, site, entry);
    let title = entry.name.as_deref().unwrap_or(&entry.id);
    let margin = 10.0 * svg.scale;
    svg.tag([margin, margin], &format!("{title}{}", summary(entry)), colour);
    draw_legend(&mut svg, entry, colour, lens_grid, shared);
    svg
}

fn array(pixels: &[Pixel]) -> Vec<[f64; 2]> {
    pixels.iter().map(|&pixel| pixel.into()).collect()
}

/// A step of the grid that leaves cells to be told apart: 1, 2, 5, 10, ... metres.
pub(crate) fn grid_step(polygon: &[FloorPoint]) -> f64 {
    let span = |value: fn(&FloorPoint) -> f64| {
        let values = || polygon.iter().map(value);
        (values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)).max(0.0)
    };
    let reach = span(|p| p.x).hypot(span(|p| p.y));
    [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0].into_iter().find(|step| reach / step < 24.0).unwrap_or(100.0)
}

fn draw_floor(svg: &mut Svg, camera: &Camera, solution: &Solution, size: [f64; 2], colour: &str) {
    let polygon = &solution.efov_m;
    let step = grid_step(polygon);
    for line in floor_grid(polygon, step) {
        for piece in on_image(camera, &line) {
            svg.line(&array(&piece), false, Stroke::new(style::WHITE, style::GRID).faint(0.42));
        }
        label_grid_line(svg, camera, &line, size);
    }
    // A prism of many corners, as a clipped or bent outline has, shows its faces and no more.
    let corners = polygon.len();
    for (index, line) in prism(polygon).iter().enumerate() {
        if index >= 2 && corners > 8 {
            break;
        }
        for piece in on_image(camera, line) {
            let stroke = match index {
                0 => Stroke::new(colour, style::FIELD).dashed(&[10.0, 5.0]),
                _ => Stroke::new(colour, style::PRISM),
            };
            svg.line(&array(&piece), false, stroke);
        }
    }
}

/// Writes the metres where a grid line comes into the image, on the side of the camera.
fn label_grid_line(svg: &mut Svg, camera: &Camera, line: &[calib_core::WorldPoint], [w, h]: [f64; 2]) {
    const SAMPLES: usize = 200;
    let (Some(&a), Some(&b)) = (line.first(), line.last()) else { return };
    let along_y = (a.x - b.x).abs() < 1e-9;
    let margin = 16.0 * svg.scale;
    // Title and legend stand on the left: labels stay clear of them.
    let inside = |p: &Pixel| p.u > 7.0 * margin && p.v > 3.0 * margin && p.u < w - margin && p.v < h - margin;
    let nearest = (0..=SAMPLES)
        .map(|i| {
            let t = i as f64 / SAMPLES as f64;
            calib_core::WorldPoint::new(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), 0.0)
        })
        .filter_map(|point| {
            Some((point.distance(camera.position), camera.world_to_pixel(point).filter(inside)?))
        })
        .min_by(|one, other| one.0.total_cmp(&other.0));
    let Some((_, pixel)) = nearest else { return };
    let text = if along_y { format!("x {}", metres(a.x)) } else { format!("y {}", metres(a.y)) };
    // Below the edge of the field, and clear of its line.
    svg.text([pixel.u, pixel.v + 15.0 * svg.scale], &text, style::WHITE, Anchor::Middle);
}

/// Metres with a real minus and no more digits than there are.
pub(crate) fn metres(value: f64) -> String {
    let rounded = (value * 1000.0).round() / 1000.0;
    format!("{}", rounded + 0.0).replace('-', "\u{2212}")
}

fn draw_horizon(svg: &mut Svg, camera: &Camera, [w, h]: [f64; 2]) {
    let pieces = horizon(camera, [w, h]);
    for piece in &pieces {
        svg.line(
            &array(piece),
            false,
            Stroke::new(style::WHITE, style::HORIZON).dashed(&[14.0, 5.0, 3.0, 5.0]),
        );
    }
    let shown = |p: &&Pixel| p.u > 0.1 * w && p.u < 0.9 * w && p.v > 48.0 * svg.scale && p.v < h;
    if let Some(at) = pieces.iter().flatten().filter(shown).max_by(|a, b| a.u.total_cmp(&b.u)) {
        svg.text([at.u, at.v - 7.0 * svg.scale], "horizon", style::WHITE, Anchor::Middle);
    }
}

fn draw_marks(svg: &mut Svg, site: &Site, camera: &Camera) {
    for mark in site.marks.iter().filter(|mark| !mark.off) {
        let shape = mark.shape();
        for line in shape.polylines() {
            for piece in on_image(camera, &line) {
                svg.line(&array(&piece), false, Stroke::new(style::WHITE, style::LINE));
            }
        }
        let name = mark.name.as_ref().or(mark.id.as_ref());
        if let (Some(name), Some(at)) = (name, camera.world_to_pixel(shape.at)) {
            svg.text([at.u, at.v + 16.0 * svg.scale], name, style::WHITE, Anchor::Middle);
        }
    }
}

fn draw_annotation(svg: &mut Svg, entry: &SiteCamera, index: usize, annotation: &Annotation) {
    let colour = style::kind(annotation.kind);
    let outlier = |segment: usize| {
        let residuals = entry.solution.iter().flat_map(|solution| &solution.residuals);
        residuals.into_iter().any(|r| r.outlier && r.annotation == Some(index) && r.segment == Some(segment))
    };
    for (segment, pixels) in annotation.polylines().enumerate() {
        let points = array(&pixels);
        let suspect = outlier(segment);
        let stroke = match (annotation.off, suspect) {
            (true, _) => Stroke::new(colour, style::LINE).faint(0.5).dashed(&[3.0, 6.0]),
            (false, true) => Stroke::new(style::BAD, style::LINE + 1.0).dashed(&[6.0, 4.0]),
            (false, false) => Stroke::new(colour, style::LINE),
        };
        svg.line(&points, false, stroke);
        if annotation.kind == Kind::Perpendicular && segment > 0 {
            draw_square(svg, &points, colour);
        }
        let colour = if suspect { style::BAD } else { colour };
        for &point in &points {
            svg.dot(point, style::HANDLE, colour);
        }
        if let Some([x, y]) = points.first() {
            let name = line_name(&entry.annotations, index, segment);
            svg.text([x + 7.0 * svg.scale, y - 5.0 * svg.scale], &name, colour, Anchor::Start);
        }
    }
}

/// A small square on the middle of a line: the sign of a right angle.
fn draw_square(svg: &mut Svg, points: &[[f64; 2]], colour: &str) {
    let (Some(a), Some(b)) = (points.first(), points.last()) else { return };
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let size = 10.0 * svg.scale / dx.hypot(dy).max(1.0);
    let at = |along: f64, across: f64| {
        [
            0.5 * (a[0] + b[0]) + size * (along * dx - across * dy),
            0.5 * (a[1] + b[1]) + size * (along * dy + across * dx),
        ]
    };
    svg.line(&[at(0.0, 0.0), at(0.0, -1.0), at(1.0, -1.0), at(1.0, 0.0)], false, Stroke::new(colour, 1.5));
}

fn draw_control_points(svg: &mut Svg, site: &Site, entry: &SiteCamera) {
    let camera = entry.camera();
    let arm = 7.0 * svg.scale;
    for point in entry.control_points.iter().filter(|point| !point.off) {
        let [u, v] = <[f64; 2]>::from(point.px);
        let stroke = Stroke::new(style::WHITE, style::LINE);
        svg.line(&[[u - arm, v], [u + arm, v]], false, stroke);
        svg.line(&[[u, v - arm], [u, v + arm]], false, stroke);
        let world = point.control_point(site.plan.as_ref()).map(|p| p.world);
        let shown = camera.and_then(|camera| camera.world_to_pixel(world?));
        if let Some(shown) = shown.filter(|shown| shown.distance(point.px) > 1.0) {
            svg.line(&[[u, v], shown.into()], false, Stroke::new(style::BAD, style::LINE));
            svg.dot(shown.into(), 2.5, style::BAD);
        }
        if let Some(name) = point.name.as_ref().or(point.id.as_ref()) {
            svg.text([u + arm, v - 0.5 * arm], name, style::WHITE, Anchor::Start);
        }
    }
}

/// Pose and quality in a line.
fn summary(entry: &SiteCamera) -> String {
    let Some(solution) = &entry.solution else {
        return entry
            .error
            .as_ref()
            .map_or_else(String::new, |error| format!("  not solved: {}", error.message));
    };
    let (Some(pitch), Some(roll)) = (solution.pitch_deg, solution.roll_deg) else {
        return "   only its lens is known".into();
    };
    let hfov = 2.0 * (0.5 * entry.size()[0] / solution.focal_px).atan().to_degrees();
    let mut text = format!("   pitch {pitch:.1}\u{b0}  roll {roll:.1}\u{b0}  view {hfov:.0}\u{b0}");
    if let Some(position) = solution.position_m {
        text.push_str(&format!("  height {:.2} m", position.z));
    }
    if let Some(rel) = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel) {
        text.push_str(&format!("  floor \u{b1} {:.1} %", 100.0 * rel));
    }
    text.replace('-', "\u{2212}")
}

/// Names of the kinds that are drawn, each in its colour.
fn draw_legend(svg: &mut Svg, entry: &SiteCamera, camera: &str, lens_grid: bool, shared: Shared) {
    let [_, h] = entry.size();
    let step = 22.0 * svg.scale;
    let used: Vec<_> =
        calib_core::KINDS.iter().filter(|row| entry.annotations.iter().any(|a| a.kind == row.kind)).collect();
    let outliers = entry
        .solution
        .iter()
        .flat_map(|solution| &solution.residuals)
        .any(|residual| residual.outlier && residual.of == ResidualOf::Annotation);
    let outliers = outliers || shared.has_aside;
    let field = entry.solution.as_ref().is_some_and(|solution| !solution.efov_m.is_empty());
    let rows: Vec<(&str, &str)> = used
        .iter()
        .map(|row| (row.title, style::kind(row.kind)))
        .chain(field.then_some(("Field of view (dashed) and 2 m above it", camera)))
        .chain(lens_grid.then_some(("Straight in the scene, bent by the lens", style::LENS)))
        .chain(shared.has_any.then_some(("Link or mark: drawn (ring), solved (cross)", style::WHITE)))
        .chain(outliers.then_some(("Set aside", style::BAD)))
        .collect();
    for (index, (title, colour)) in rows.iter().enumerate() {
        let y = h - 10.0 * svg.scale - step * (rows.len() - index) as f64;
        svg.tag([10.0 * svg.scale, y], title, colour);
    }
}
