//! What canvases remember between frames: how each is looked at, and the pointer on them.
//!
//! What the middle of the window shows.
//!
//! What lies on images, each layer with its switch.
//!
//! From where the scene is looked at: turned, moved and zoomed by the pointer.
//!
//! How the image of a fisheye is looked at: whole, or through a window.
//!
//! How a newer still is looked at.
//!
//! How the list of cameras is filtered and sorted.
//!
//! The command palette: whether it is open, what was typed, and which row is lit.

use std::collections::HashMap;

use calib_core::floor::{Look, Mount};
use calib_core::{FloorPoint, Window, WorldPoint};
use calib_editor::{Pane, Session};
use egui::{Pos2, Rect, Vec2};

use crate::canvas::{Bend, Mapping, View};

/// What the middle of the window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The image of the camera in hand.
    #[default]
    Image,
    /// Image and plan.
    Plan,
    /// Every camera at once.
    All,
    /// The site in space.
    Scene,
}

/// Where a pane stands: a camera alone and among others is looked at in two ways.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// It has the canvas.
    Main,
    /// It stands beside the plan.
    Half,
    /// One of many.
    Tile,
}

/// What canvases remember between frames.
#[derive(Debug, Default)]
pub struct Panes {
    /// How each is looked at.
    pub views: HashMap<(Place, Pane), View>,
    /// What the views were when they were made to fit.
    pub(crate) fitted: HashMap<(Place, Pane), View>,
    /// The plan whose picture was shown last.
    pub(crate) plan: Option<String>,
    /// Whether there are more tiles than the window shows.
    pub tiles_overflow: bool,
    /// Where the cursor is, in the pane's units.
    pub cursor: Option<(Pane, [f64; 2])>,
    /// The pane and place that holds the pointer while a button is down.
    pub(crate) captured: Option<(Place, Pane)>,
    pub(crate) pressed: Pos2,
    pub(crate) moved: bool,
    /// The last point of the document that the pointer was at while a button was down.
    pub(crate) pointed: [f64; 2],
    pub(crate) double: bool,
    /// Whether nothing was in the hand before the last press.
    pub(crate) was_idle: bool,
    pub(crate) last_press: Option<(f64, Pos2)>,
    /// The pane over which the whole image lies small, and where.
    pub(crate) minimap: Option<((Place, Pane), Rect)>,
    /// The pane over which a line wipes between two stills, and the strip in which it is taken.
    pub(crate) wipe: Option<((Place, Pane), Rect)>,
    /// The pane that was used last: zoom keys mean it.
    pub active: Option<(Place, Pane)>,
    /// Where every pane was shown last, for zoom keys and tests.
    pub rects: HashMap<(Place, Pane), Rect>,
    /// The middle of the window, whatever it shows.
    pub middle: Option<Rect>,
    /// What is taken out of what panes show.
    pub(crate) bends: HashMap<(Place, Pane), Bend>,
}

impl Panes {
    /// Forgets a pointer whose release will never be told.
    pub fn forget_pointer(&mut self) {
        (self.captured, self.last_press) = (None, None);
    }

    /// Forgets where panes were, and a cursor on one that is no longer shown.
    pub fn begin_frame(&mut self) {
        let is_shown = |pane: Pane| self.rects.keys().any(|(_, shown)| *shown == pane);
        self.cursor = self.cursor.filter(|(pane, _)| is_shown(*pane));
        self.rects.clear();
        self.bends.clear();
    }

    /// The view the operator chose, or the one that fits: a pane that nobody panned goes on fitting.
    pub(crate) fn fitted_or_chosen(&mut self, key: (Place, Pane), whole: View) -> View {
        let chosen = self.views.get(&key).copied();
        let was_fitted = chosen.is_none() || chosen == self.fitted.get(&key).copied();
        if was_fitted {
            self.fitted.insert(key, whole);
            self.views.insert(key, whole);
        }
        chosen.filter(|_| !was_fitted).unwrap_or(whole)
    }

    /// Whether something lies over a pane there.
    pub(crate) fn is_covered(&self, key: (Place, Pane), at: Pos2) -> bool {
        let over = [self.minimap, self.wipe];
        over.into_iter().flatten().any(|(own, rect)| own == key && rect.contains(at))
    }

    /// Where a pane shows its document.
    #[must_use]
    pub fn mapping(&self, place: Place, pane: Pane) -> Option<Mapping> {
        let bend = self.bends.get(&(place, pane)).copied();
        let (view, rect) = (*self.views.get(&(place, pane))?, *self.rects.get(&(place, pane))?);
        Some(Mapping { view, rect, bend })
    }
}

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

/// From where the scene is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// The point in the middle, in metres.
    pub target: [f64; 3],
    /// Distance from it, in metres.
    pub distance: f64,
    /// Turn about the vertical, in radians.
    pub yaw: f64,
    /// Above the floor, in radians.
    pub pitch: f64,
}

/// Nearer than this to the eye nothing is drawn, in metres.
pub(crate) const NEAR: f64 = 0.05;

impl Orbit {
    /// Sees the whole site.
    #[must_use]
    pub fn of(session: &Session) -> Self {
        let count = session.site.cameras.len();
        let points: Vec<FloorPoint> = (0..count)
            .filter_map(|i| session.solved.solution(i))
            .flat_map(|solution| solution.efov_m.iter().copied())
            .chain((0..count).filter_map(|i| session.solved.pose(i)).map(|pose| pose.position.on_floor()))
            .collect();
        let range = |of: fn(&FloorPoint) -> f64| {
            let values = || points.iter().map(of);
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
        };
        let ((x0, x1), (y0, y1)) = (range(|p| p.x), range(|p| p.y));
        if points.is_empty() {
            return Self { target: [0.0, 4.0, 0.0], distance: 15.0, yaw: 0.5, pitch: 0.6 };
        }
        let target = [0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5];
        Self { target, distance: 1.1 * (x1 - x0).hypot(y1 - y0).clamp(3.0, 500.0), yaw: 0.5, pitch: 0.7 }
    }

    fn axes(&self) -> [[f64; 3]; 3] {
        let ((sy, cy), (sp, cp)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        [[cy, sy, 0.0], [sy * sp, -cy * sp, -cp], [-sy * cp, cy * cp, -sp]]
    }

    /// Right, down and forward of a point as the eye has it, in metres.
    pub(crate) fn seen(&self, point: WorldPoint) -> [f64; 3] {
        let by = [point.x - self.target[0], point.y - self.target[1], point.z - self.target[2]];
        let mut seen = self.axes().map(|axis| axis.iter().zip(by).map(|(a, b)| a * b).sum::<f64>());
        seen[2] += self.distance;
        seen
    }

    /// Where the screen shows what the eye has there.
    pub(crate) fn screen(rect: Rect, [x, y, z]: [f64; 3]) -> Pos2 {
        let focal = 0.9 * f64::from(rect.height().min(rect.width()));
        rect.center() + Vec2::new((focal * x / z) as f32, (focal * y / z) as f32)
    }

    /// Where the screen shows a point; `None` behind the eye.
    #[must_use]
    pub fn project(&self, rect: Rect, point: WorldPoint) -> Option<Pos2> {
        let seen = self.seen(point);
        (seen[2] > NEAR).then(|| Self::screen(rect, seen))
    }

    /// Turns by a drag of so many points.
    pub fn turn(&mut self, by: Vec2) {
        self.yaw -= 0.008 * f64::from(by.x);
        self.pitch = (self.pitch + 0.008 * f64::from(by.y)).clamp(-0.2, 1.57);
    }

    /// Moves the point in the middle by a drag of so many points.
    pub fn pan(&mut self, by: Vec2) {
        let [right, down, _] = self.axes();
        let share = self.distance / 700.0;
        for axis in 0..3 {
            self.target[axis] -= share * (f64::from(by.x) * right[axis] + f64::from(by.y) * down[axis]);
        }
    }

    /// Comes nearer or goes farther.
    pub fn zoom(&mut self, factor: f64) {
        self.distance = (self.distance / factor).clamp(0.2, 1e4);
    }
}

/// The palette: what was typed, and which row is lit.
#[derive(Clone, Debug, Default)]
pub struct Palette {
    pub(crate) is_open: bool,
    pub(crate) query: String,
    pub(crate) row: usize,
}

impl Palette {
    /// Opens it empty, or closes it.
    pub fn toggle(&mut self) {
        *self = Self { is_open: !self.is_open, ..Self::default() };
    }

    /// Closes it.
    pub const fn close(&mut self) {
        self.is_open = false;
    }

    /// Whether it is open.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }
}

/// How the list is ordered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// As in the site.
    #[default]
    Site,
    /// Those that miss most first.
    Missing,
    /// Those whose floor is known worst first.
    Sigma,
}

/// How the list is filtered and sorted.
#[derive(Clone, Debug, Default)]
pub struct List {
    /// Part of a name.
    pub filter: String,
    /// Only those that are not finished.
    pub unfinished: bool,
    /// How it is ordered.
    pub order: Order,
}

/// Which of two stills is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Showing {
    /// The old one on the left of a line, the newer one on its right.
    #[default]
    Wipe,
    /// Both by turns.
    Blink,
    /// The newer one.
    New,
    /// The old one.
    Old,
}

impl Showing {
    /// Every way, with its word.
    pub const ALL: [(Self, &str); 4] =
        [(Self::Wipe, "Wipe"), (Self::Blink, "Blink"), (Self::New, "New"), (Self::Old, "Old")];

    /// The next way.
    #[must_use]
    pub fn next(self) -> Self {
        let at = Self::ALL.iter().position(|(way, _)| *way == self).unwrap_or_default();
        Self::ALL[(at + 1) % Self::ALL.len()].0
    }
}

/// How a newer still is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glance {
    /// Which of the two is shown.
    pub showing: Showing,
    /// Where the line of a wipe stands, as a share of the width of the image.
    pub share: f32,
}

impl Default for Glance {
    fn default() -> Self {
        Self { showing: Showing::default(), share: 0.5 }
    }
}

/// Which window the image of a fisheye is looked at through.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Looking {
    /// None: the image as it is.
    #[default]
    Whole,
    /// One of four round its axis.
    Quadrant(usize),
    /// All round, unrolled.
    Panorama,
    /// One towards a direction in axes of the camera.
    Toward([f64; 3]),
}

impl Looking {
    /// The next one.
    #[must_use]
    pub const fn next(self) -> Self {
        match self {
            Self::Whole | Self::Toward(_) => Self::Quadrant(0),
            Self::Quadrant(index) if index < 3 => Self::Quadrant(index + 1),
            Self::Quadrant(_) => Self::Panorama,
            Self::Panorama => Self::Whole,
        }
    }

    /// The window itself, of a camera that hangs so and sees so far from its axis, in radians.
    pub(crate) fn window(self, mount: Mount, reach: f64) -> Option<Window> {
        const FLAT: [usize; 2] = [1280, 800];
        const ROUND: [usize; 2] = [2400, 800];
        /// As wide as a person takes in.
        const WIDE: f64 = 1.7;
        match self {
            Self::Whole => None,
            Self::Quadrant(index) => Window::quadrants(mount, FLAT)?.get(index).copied(),
            Self::Panorama => Window::panorama(mount, reach, ROUND),
            Self::Toward([0.0, 0.0, _]) => Window::flat(Look { hfov: WIDE, ..Look::default() }, FLAT),
            Self::Toward(direction) => Window::toward(mount, direction, WIDE, FLAT),
        }
    }
}
