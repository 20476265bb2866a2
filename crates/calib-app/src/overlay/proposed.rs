//! Overlay of an automatic calibration in faint colours: lines in the colour of their kind, horizon, and
//! floor grid.

use calib_core::{Camera, Kind, Pixel, Plane};

use calib_draw::{ImageLayer, ImageView, Look, Meaning, Scene, on_image as items_on_image};
use calib_editor::{PendingGroup, Preview, hit};
use calib_site::{Site, Solution};
use egui::{Align2, Painter, Pos2, Vec2};

use crate::overlay::{Overlay, Shown, grid_step};
use crate::paint::{Pen, line, tag};
use crate::theme;

/// Scene in which the automatic calibration replaces the pose and the solution of one camera.
#[derive(Debug)]
struct Supposed<'a> {
    shown: Shown<'a>,
    camera: usize,
    preview: &'a Preview,
}

impl Scene for Supposed<'_> {
    fn site(&self) -> &Site {
        self.shown.site()
    }

    fn pose(&self, camera: usize) -> Option<Camera> {
        if camera == self.camera { self.preview.pose } else { self.shown.pose(camera) }
    }

    fn solution(&self, camera: usize) -> Option<&Solution> {
        if camera == self.camera { self.preview.solution.as_ref() } else { self.shown.solution(camera) }
    }

    fn plane(&self, id: Option<&str>) -> Plane {
        self.shown.plane(id)
    }
}

/// Automatic calibration of the shown camera, for its overlay.
#[derive(Clone, Copy, Debug)]
pub struct ProposedLines<'a> {
    /// Pose and solution of the camera from the automatic calibration.
    pub preview: &'a Preview,
    /// Whether the confidence is high enough to show horizon and grid of the camera.
    pub is_believed: bool,
    /// Index of the group whose table row is under the pointer.
    pub lit: Option<usize>,
}

impl ProposedLines<'_> {
    /// Whether the automatic calibration contains a camera of sufficient confidence.
    pub(crate) fn is_camera(&self) -> bool {
        self.is_believed && self.preview.pose.is_some()
    }
}

impl Overlay<'_> {
    /// Paints floor grid and horizon of the automatic calibration, and the horizon of the alternative
    /// solution.
    pub(crate) fn paint_supposed(&self, painter: &Painter, ghosts: &ProposedLines<'_>) {
        let (Some(entry), Some(pose), Some(solution)) =
            (self.entry(), &ghosts.preview.pose, &ghosts.preview.solution)
        else {
            return;
        };
        if self.layers.grid {
            let supposed =
                Supposed { shown: Shown(self.session), camera: self.camera, preview: ghosts.preview };
            let step = grid_step(&solution.efov_m, self.session.site.units);
            let view = ImageView::new(&supposed, self.camera);
            self.paint_items(painter, &items_on_image(&view, &[ImageLayer::Grid(step)]));
        }
        if !self.layers.horizon {
            return;
        }
        self.paint_named(painter, pose, entry, (1.0, "detected horizon"));
        let rival = self.session.proposed().and_then(|proposed| proposed.alternative.as_ref());
        if let Some(rival) = rival.map(|rival| rival.orientation) {
            let rival = Camera { roll: rival.roll, pitch: rival.pitch, focal: rival.focal, ..*pose };
            self.paint_named(painter, &rival, entry, (0.25, "horizon of the other solution"));
        }
    }

    /// Paints the lines of the automatic calibration; the selected group and the group under the pointer are
    /// highlighted.
    pub(crate) fn paint_proposed(&self, painter: &Painter, ghosts: &ProposedLines<'_>) {
        let Some(proposed) = self.session.proposed() else { return };
        let at = self.cursor.zip(self.entry());
        let over = at.and_then(|(at, entry)| {
            let lens = hit::shown_lens(entry, self.session.solved.pose(self.camera));
            proposed.line_at(&lens, at, self.hit_radius_px())
        });
        let picked = self.session.picked_line();
        let lit = ghosts.lit.or(over.map(|(group, _)| group));
        for (index, group) in proposed.groups.iter().enumerate() {
            let is_bright = lit == Some(index) || picked.is_some_and(|(chosen, _)| chosen == index);
            for (number, points) in group.lines.iter().enumerate() {
                let is_picked = picked == Some((index, number));
                self.paint_ghost(painter, group.kind, points, [is_bright, is_picked]);
            }
            if self.labels {
                self.name_group(painter, group);
            }
        }
    }

    /// Returns the largest distance at which the pointer selects a line, in raw pixels.
    fn hit_radius_px(&self) -> f64 {
        self.mapping.units(theme::HIT)
    }

    fn paint_ghost(
        &self,
        painter: &Painter,
        kind: Kind,
        points: &[Pixel],
        [is_bright, is_picked]: [bool; 2],
    ) {
        let path = self.curve(points);
        let colour = theme::kind(kind);
        let pen = Pen::of(Look::of(Meaning::Suggestion(kind))).coloured(colour);
        match (is_picked, is_bright) {
            (true, _) => {
                line(painter, &path, Pen::new(theme::on_image::ACCENT, 7.0).faint());
                line(painter, &path, Pen::new(colour, 3.0));
            }
            (false, true) => line(painter, &path, Pen::new(colour, 2.5)),
            (false, false) => line(painter, &path, pen),
        }
    }

    /// Paints the name of a floor direction on its longest line, because all directions have the same colour.
    fn name_group(&self, painter: &Painter, group: &PendingGroup) {
        /// Width that the name of a direction needs, in points.
        const NAME_WIDTH: f32 = 64.0;
        if group.kind != Kind::Parallel {
            return;
        }
        let paths = group.lines.iter().map(|points| self.path(points));
        let length = |path: &Vec<Pos2>| path.first().zip(path.last()).map_or(0.0, |(a, b)| a.distance(*b));
        let longest = paths.max_by(|a, b| length(a).total_cmp(&length(b)));
        let Some((a, b)) = longest.and_then(|path| path.first().copied().zip(path.last().copied())) else {
            return;
        };
        let at = a.lerp(b, 0.5);
        // At the right border of the canvas the name is left of its line.
        let (by, align) = if at.x + NAME_WIDTH < painter.clip_rect().right() {
            (8.0, Align2::LEFT_CENTER)
        } else {
            (-8.0, Align2::RIGHT_CENTER)
        };
        tag(painter, at + Vec2::new(by, 0.0), align, group.title(), theme::kind(group.kind));
    }
}
