//! What is painted on a camera's image: annotations, EFOV, grid, prism, horizon, marks, links. Reads only.

use std::collections::BTreeSet;

use calib_core::{
    Camera, PRISM_HEIGHT, Pixel, Residual, SiteCamera, Solution, floor_grid, on_image as project,
};
use calib_editor::{Family, Part, Session, Trace, Units};
use egui::{Align2, Color32, Painter, Pos2, Stroke, Vec2};

use crate::canvas::Mapping;
use crate::paint::{Pen, handle, line, ring, tag};
use crate::theme::{self, on_image};

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch above the image")]
pub struct Layers {
    /// The metre grid of the floor.
    pub grid: bool,
    /// The horizon.
    pub horizon: bool,
    /// The polygon of the field of view.
    pub field: bool,
    /// Its prism.
    pub prism: bool,
    /// A person of 1.75 m at the cursor.
    pub guide: bool,
    /// Lines extended to their vanishing point.
    pub extensions: bool,
    /// Colour lines by residual, not by kind.
    pub by_residual: bool,
    /// The likely next lines.
    pub suggestion: bool,
    /// Edges that were found are offered.
    pub edges: bool,
    /// The bend of the lens is taken out of the image.
    pub straight: bool,
    /// Everything is hidden.
    pub hidden: bool,
}

impl Default for Layers {
    fn default() -> Self {
        Self {
            grid: true,
            horizon: true,
            field: true,
            prism: true,
            guide: true,
            extensions: true,
            by_residual: false,
            suggestion: true,
            edges: true,
            straight: false,
            hidden: false,
        }
    }
}

/// What the overlay of one image needs to know.
#[derive(Debug)]
pub struct Overlay<'a> {
    /// The site and its results.
    pub session: &'a Session,
    /// The camera whose image it is.
    pub camera: usize,
    /// Where the image is on the screen.
    pub mapping: Mapping,
    /// What is shown.
    pub layers: Layers,
    /// Where the cursor is, if it is on this image.
    pub cursor: Option<Pixel>,
    /// A line that is lit because its row or it is under the cursor.
    pub lit: Option<(usize, usize)>,
    /// Whether a handle is in the hand.
    pub holding: bool,
    /// Seconds, for what blinks.
    pub time: f64,
    /// What fits as well as the solution, where anything does.
    pub family: Option<&'a Family>,
    /// The link that is to be shown in a further view.
    pub begun: Option<usize>,
    /// Whether names are shown: not on small images.
    pub labels: bool,
    /// Whether drawn lines are shown: among many views they hide what is compared.
    pub lines: bool,
}

impl Overlay<'_> {
    pub(crate) fn at(&self, pixel: Pixel) -> Pos2 {
        self.mapping.screen(pixel.into())
    }

    pub(crate) fn path(&self, pixels: &[Pixel]) -> Vec<Pos2> {
        pixels.iter().map(|&pixel| self.at(pixel)).collect()
    }

    fn entry(&self) -> Option<&SiteCamera> {
        self.session.site.cameras.get(self.camera)
    }

    /// Whether a thing says its name: all of them at once hide the image.
    fn says_name(&self, at: Pos2, selected: bool) -> bool {
        const NEAR: f32 = 48.0;
        let over = self.cursor.is_some_and(|cursor| self.at(cursor).distance(at) < NEAR);
        self.labels && (over || selected && self.session.camera == self.camera)
    }

    fn world(&self, painter: &Painter, camera: &Camera, points: &[calib_core::WorldPoint], pen: Pen) {
        for piece in project(camera, points) {
            line(painter, &self.path(&piece), pen);
        }
    }

    /// Paints everything.
    pub fn paint(&self, painter: &Painter) {
        let Some(entry) = self.entry() else { return };
        if self.layers.hidden {
            return;
        }
        let pose = self.session.solved.pose(self.camera);
        let solution = self.session.solved.solution(self.camera);
        if let (Some(camera), Some(solution)) = (pose, solution) {
            self.paint_floor(painter, camera, solution);
            self.paint_horizon(painter, camera, entry);
            self.paint_guide(painter, camera);
        }
        self.paint_field(painter, entry);
        if let Some(camera) = pose {
            self.paint_others(painter, camera);
            self.paint_marks(painter, camera);
        }
        for (index, annotation) in entry.annotations.iter().enumerate().filter(|_| self.lines) {
            self.paint_annotation(painter, entry, index, annotation);
        }
        self.paint_controls(painter, entry, pose);
        self.paint_links(painter, entry, pose);
        self.paint_suggestion(painter, solution);
        self.paint_selection(painter);
    }

    fn paint_floor(&self, painter: &Painter, camera: &Camera, solution: &Solution) {
        let polygon = &solution.efov_m;
        if self.layers.grid {
            let pen = Pen::new(Color32::from_white_alpha(120), 1.0).faint();
            for grid in floor_grid(polygon, grid_step(polygon, self.session.units)) {
                self.world(painter, camera, &grid, pen);
            }
        }
        // A field that nobody drew has no prism worth looking at.
        let is_drawn = self.entry().is_some_and(|entry| entry.efov_px.is_some());
        if self.layers.prism && is_drawn {
            let colour = theme::camera(self.camera);
            let top: Vec<_> =
                polygon.iter().chain(polygon.first()).map(|point| point.at_height(PRISM_HEIGHT)).collect();
            let edges = self.session.prism_edges(self.camera);
            for edge in std::iter::once(top).chain(edges) {
                self.world(painter, camera, &edge, Pen::new(colour, 1.25).faint());
            }
        }
    }

    /// A person on the floor under the cursor: a thing to judge height and plumb by.
    fn paint_guide(&self, painter: &Painter, camera: &Camera) {
        const HEIGHT: f64 = 1.75;
        let Some(foot) = self.cursor.filter(|_| self.layers.guide && !self.holding) else { return };
        let Some(at) = camera.pixel_to_floor(foot, 0.0) else { return };
        let shape = calib_core::Shape3 {
            kind: calib_core::MarkKind::Person,
            at: at.at_height(0.0),
            turn: camera.yaw,
            size: vec![HEIGHT],
        };
        for part in shape.polylines() {
            self.world(painter, camera, &part, Pen::new(Color32::from_white_alpha(200), 1.25));
        }
        if let Some(head) = camera.world_to_pixel(at.at_height(HEIGHT)).filter(|_| self.labels) {
            tag(
                painter,
                self.at(head) - Vec2::new(0.0, 6.0),
                Align2::CENTER_BOTTOM,
                &format!("person {}", self.session.units.length(HEIGHT, 2)),
                on_image::WHITE,
            );
        }
    }

    fn paint_field(&self, painter: &Painter, entry: &SiteCamera) {
        let Some(corners) = entry.efov_px.as_ref().filter(|c| self.layers.field && c.len() >= 2) else {
            return;
        };
        let colour = theme::camera(self.camera);
        let closed: Vec<Pixel> = corners.iter().chain(corners.first()).copied().collect();
        line(painter, &self.path(&closed), Pen::new(colour, 2.0).dashed(&[10.0, 5.0]));
        for &corner in corners {
            handle(painter, self.at(corner), colour);
        }
    }

    /// The fields of other placed cameras that reach into this image.
    fn paint_others(&self, painter: &Painter, camera: &Camera) {
        if !self.layers.field || self.session.solved.placed(self.camera).is_none() {
            return;
        }
        for other in 0..self.session.site.cameras.len() {
            let Some(solution) = self.session.solved.solution(other).filter(|_| other != self.camera) else {
                continue;
            };
            if self.session.solved.placed(other).is_none() || solution.efov_m.len() < 3 {
                continue;
            }
            let outline: Vec<_> =
                solution.efov_m.iter().chain(solution.efov_m.first()).map(|p| p.at_height(0.0)).collect();
            self.world(
                painter,
                camera,
                &outline,
                Pen::new(theme::camera(other), 1.25).dashed(&[5.0, 5.0]).faint(),
            );
        }
    }

    fn paint_marks(&self, painter: &Painter, camera: &Camera) {
        for (index, mark) in self.session.site.marks.iter().enumerate().filter(|(_, mark)| !mark.off) {
            let shape = mark.shape();
            let is_held = self.session.selection.contains(&Part::Mark(index));
            let colour = if is_held { on_image::ACCENT } else { on_image::WHITE };
            for part in shape.polylines() {
                self.world(painter, camera, &part, Pen::new(colour, 2.25));
            }
            let Some(at) = camera.world_to_pixel(shape.at) else { continue };
            let name = mark.name.as_ref().or(mark.id.as_ref());
            if let Some(name) = name.filter(|_| is_held || self.says_name(self.at(at), false)) {
                tag(painter, self.at(at) + Vec2::new(0.0, 6.0), Align2::CENTER_TOP, name, on_image::WHITE);
            }
            let id = self.entry().map(|entry| entry.id.as_str());
            for seen in mark.seen.iter().filter(|seen| Some(seen.camera.as_str()) == id) {
                let px = self.at(seen.px);
                handle(painter, px, on_image::ACCENT);
                if let Some(there) = shape.point(&seen.point).and_then(|point| camera.world_to_pixel(point)) {
                    line(painter, &[px, self.at(there)], Pen::new(on_image::BAD, 1.5));
                }
            }
        }
    }

    pub(crate) fn residual(&self, of: impl Fn(&&Residual) -> bool) -> Option<&Residual> {
        self.session.solved.solution(self.camera)?.residuals.iter().find(of)
    }

    fn paint_controls(&self, painter: &Painter, entry: &SiteCamera, pose: Option<&Camera>) {
        let plan = self.session.site.plan.as_ref();
        for (index, point) in entry.control_points.iter().enumerate() {
            let at = self.at(point.px);
            let colour = if point.off { Color32::GRAY } else { on_image::WHITE };
            let pen = Pen::new(colour, 1.75);
            for arm in [Vec2::new(9.0, 0.0), Vec2::new(0.0, 9.0)] {
                line(painter, &[at - arm, at - 0.4 * arm], pen);
                line(painter, &[at + 0.4 * arm, at + arm], pen);
            }
            painter.circle_stroke(at, 5.0, Stroke::new(1.5, colour));
            let world = point.control_point(plan).map(|control| control.world);
            if let Some(shown) = pose.and_then(|camera| camera.world_to_pixel(world?)) {
                line(painter, &[at, self.at(shown)], Pen::new(on_image::BAD, 1.75));
            }
            let selected = self.session.selection.contains(&Part::Control(index));
            let name = point.name.as_ref().or(point.id.as_ref());
            if let Some(name) = name.filter(|_| self.says_name(at, selected)) {
                tag(painter, at + Vec2::new(11.0, -4.0), Align2::LEFT_BOTTOM, name, colour);
            }
        }
    }

    fn paint_links(&self, painter: &Painter, entry: &SiteCamera, pose: Option<&Camera>) {
        for (index, link) in self.session.site.links.iter().enumerate() {
            let waits = link.seen.len() == 1 || self.begun == Some(index);
            let colour = if waits { on_image::WAITING } else { on_image::WHITE };
            let own = link.seen.iter().find(|seen| seen.camera == entry.id);
            if let Some(seen) = own {
                let points: Vec<Pos2> = seen
                    .px
                    .iter()
                    .chain(&seen.foot)
                    .chain(&seen.head)
                    .chain(seen.segment.iter().flatten())
                    .map(|&pixel| self.at(pixel))
                    .collect();
                line(painter, &points, Pen::new(colour, 2.0));
                for &at in &points {
                    diamond(painter, at, colour);
                }
                if let (Some(id), Some(&at)) = (link.id.as_ref(), points.first())
                    && (waits || self.says_name(at, false))
                {
                    tag(painter, at + Vec2::new(9.0, -2.0), Align2::LEFT_BOTTOM, id, colour);
                }
            } else if let (true, Some(camera)) = (waits, pose) {
                self.paint_trace(painter, camera, link);
            }
        }
    }

    /// Where this view must show the link that another view shows.
    fn paint_trace(&self, painter: &Painter, camera: &Camera, link: &calib_core::Link) {
        if self.session.solved.placed(self.camera).is_none() {
            return;
        }
        let trace = link.seen.iter().find_map(|seen| {
            let other = self.session.site.cameras.iter().position(|entry| entry.id == seen.camera)?;
            Trace::of(self.session.solved.placed(other)?, link, seen)
        });
        let Some(trace) = trace else { return };
        self.world(painter, camera, &trace.path, Pen::new(on_image::WAITING, 1.75).dashed(&[5.0, 4.0]));
        if let Some(at) = trace.at.and_then(|point| camera.world_to_pixel(point)) {
            let at = self.at(at);
            painter.circle_stroke(at, 8.0, Stroke::new(1.5, on_image::WAITING));
            let text = format!("{} {}", link.id.as_deref().unwrap_or("the link"), trace.invites);
            tag(painter, at + Vec2::new(12.0, 0.0), Align2::LEFT_CENTER, &text, on_image::WAITING);
        }
    }

    fn paint_suggestion(&self, painter: &Painter, solution: Option<&Solution>) {
        if !self.layers.suggestion || self.holding || !self.labels || self.session.camera != self.camera {
            return;
        }
        /// Floors known better than this need no more lines.
        const GOOD: f64 = 0.015;
        let rel = solution.and_then(|s| s.sigma.as_ref()?.floor_length_rel);
        let is_good = rel.is_some_and(|rel| rel < GOOD);
        let next = solution.and_then(|solution| solution.draw_next.as_ref());
        let Some(next) = next.filter(|_| !is_good) else { return };
        let colour = theme::kind(next.kind);
        for (i, segment) in next.segments_px.iter().enumerate() {
            let points = self.path(segment);
            line(painter, &points, Pen::new(colour, 2.25).dashed(&[3.0, 6.0]));
            for &at in &points {
                painter.circle_stroke(at, 4.0, Stroke::new(1.25, colour));
            }
            if i == 0 {
                let middle = points[0] + 0.5 * (points[1] - points[0]);
                let gain = 100.0 * next.floor_length_rel;
                let title = next.kind.row().title.to_lowercase();
                let text = format!("draw {title} here, then floor \u{b1} {gain:.1} %   N");
                tag(painter, middle + Vec2::new(10.0, 0.0), Align2::LEFT_CENTER, &text, colour);
            }
        }
    }

    fn paint_selection(&self, painter: &Painter) {
        if self.session.camera != self.camera {
            return;
        }
        let points: BTreeSet<Part> =
            calib_editor::edit::points_of(&self.session.site, self.camera, &self.session.selection);
        let handles = calib_editor::hit::handles(&self.session.site, self.camera);
        for (part, pixel) in handles.into_iter().filter(|(part, _)| points.contains(part)) {
            let whole = !self.session.selection.contains(&part);
            ring(painter, self.at(pixel), on_image::ACCENT, self.holding && !whole);
        }
    }
}

fn diamond(painter: &Painter, at: Pos2, colour: Color32) {
    let corners = [[0.0, -6.0], [6.0, 0.0], [0.0, 6.0], [-6.0, 0.0], [0.0, -6.0]];
    let points: Vec<Pos2> = corners.iter().map(|&[x, y]| at + Vec2::new(x, y)).collect();
    line(painter, &points, Pen::new(colour, 1.75));
    painter.circle_filled(at, 1.25, colour);
}

/// A step of the grid that leaves cells to be told apart: 1, 2, 5, 10, ... of the unit.
#[must_use]
pub fn grid_step(polygon: &[calib_core::FloorPoint], units: Units) -> f64 {
    let span = |value: fn(&calib_core::FloorPoint) -> f64| {
        let values = || polygon.iter().map(value);
        (values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)).max(0.0)
    };
    let reach = span(|p| p.x).hypot(span(|p| p.y));
    units.step(reach, 30.0).max(0.5 * units.metres())
}
