//! View state of the window: mode, canvases, layers, fisheye windows, viewpoint of the scene, lists.

use std::collections::HashMap;

use calib_core::floor::{Mount, ViewDirection};
use calib_core::{FloorPoint, Window, WorldPoint};
use calib_editor::{Pane, Session};
use egui::{Pos2, Rect, Vec2};

use crate::canvas::{Bend, Mapping, View};

/// Kind of view in the middle of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Image of the current camera.
    #[default]
    Image,
    /// Image and plan.
    Plan,
    /// Images of all cameras, and the plan.
    All,
    /// 3-D scene.
    Scene,
}

/// Position of a canvas in the layout; each position has its own pan and zoom.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// Main canvas of the mode.
    Main,
    /// Canvas next to the plan or the 3-D scene.
    Half,
    /// Canvas that is one of several tiles.
    Tile,
}

/// State of the canvases between frames.
#[derive(Debug, Default)]
pub struct Panes {
    /// Pan and zoom of each canvas.
    pub views: HashMap<(Place, Pane), View>,
    /// Pan and zoom at which each canvas shows its whole image or plan, as last computed.
    pub(crate) fitted: HashMap<(Place, Pane), View>,
    /// Cache key of the plan image that was shown last, from `picture_key`.
    pub(crate) plan: Option<String>,
    /// Whether the tiles of all cameras are higher than the window, so that they scroll.
    pub tiles_overflow: bool,
    /// Canvas under the pointer, and the position of the pointer: in raw pixels of the image, or in floor metres on
    /// the plan.
    pub cursor: Option<(Pane, [f64; 2])>,
    /// Canvas that receives the pointer while a button is down.
    pub(crate) captured: Option<(Place, Pane)>,
    /// Screen point of the last press.
    pub(crate) pressed: Pos2,
    /// Whether the pointer has moved farther than a click allows since the last press.
    pub(crate) moved: bool,
    /// Last pointer position that was sent to the tool: in pixels of the image, or in metres on the plan.
    pub(crate) pointed: [f64; 2],
    /// Whether the last press was the second of a double click.
    pub(crate) double: bool,
    /// Whether no gesture was active before the last press.
    pub(crate) was_idle: bool,
    /// Whether one finger pans the canvas that receives the pointer.
    pub(crate) has_finger_pan: bool,
    /// Whether a second finger has ended the gesture; the fingers pan and zoom until all are lifted.
    pub(crate) has_pinch: bool,
    /// Time in seconds and screen point of the last press that can begin a double click.
    pub(crate) last_press: Option<(f64, Pos2)>,
    /// Canvas with a minimap, and the minimap's rectangle.
    pub(crate) minimap: Option<((Place, Pane), Rect)>,
    /// Canvas with the legend of the coverage, and the legend's rectangle.
    pub(crate) legend: Option<((Place, Pane), Rect)>,
    /// Canvas with the button that opens a floor plan, and the rectangle around the button.
    pub(crate) plan_button: Option<((Place, Pane), Rect)>,
    /// Canvas that wipes between two images, and the rectangle of its wipe handle.
    pub(crate) wipe: Option<((Place, Pane), Rect)>,
    /// Camera whose newer image the main canvas shows, and the screen x from which it is visible.
    pub(crate) newer_from: Option<(usize, f32)>,
    /// Canvas that was used last; zoom keys apply to it.
    pub active: Option<(Place, Pane)>,
    /// Rectangle of each canvas in the last frame, for zoom keys and tests.
    pub rects: HashMap<(Place, Pane), Rect>,
    /// Rectangle of the middle of the window.
    pub middle: Option<Rect>,
    /// Undistortions and fisheye windows that are applied to canvases.
    pub(crate) bends: HashMap<(Place, Pane), Bend>,
}

impl Panes {
    /// Forgets a pressed pointer whose release will not arrive.
    pub fn forget_pointer(&mut self) {
        (self.captured, self.last_press, self.has_finger_pan) = (None, None, false);
    }

    /// Clears the rectangles of the last frame, and a pointer position on a hidden canvas.
    pub fn begin_frame(&mut self) {
        let is_shown = |pane: Pane| self.rects.keys().any(|(_, shown)| *shown == pane);
        self.cursor = self.cursor.filter(|(pane, _)| is_shown(*pane));
        self.rects.clear();
        self.bends.clear();
    }

    /// Returns the zoom at which the whole image or plan is visible, in screen points per canvas unit. It is infinite
    /// before the canvas is first shown.
    pub(crate) fn fitted_zoom(&self, key: (Place, Pane)) -> f64 {
        self.fitted.get(&key).map_or(f64::INFINITY, |view| view.zoom)
    }

    /// Returns the pan and zoom that the operator chose, otherwise `whole`, which fits the document.
    pub(crate) fn fitted_or_chosen(&mut self, key: (Place, Pane), whole: View) -> View {
        let chosen = self.views.get(&key).copied();
        let was_fitted = chosen.is_none() || chosen == self.fitted.get(&key).copied();
        if was_fitted {
            self.fitted.insert(key, whole);
            self.views.insert(key, whole);
        }
        chosen.filter(|_| !was_fitted).unwrap_or(whole)
    }

    /// Whether a minimap, a legend, a button or a wipe handle covers a position on a canvas.
    pub(crate) fn is_covered(&self, key: (Place, Pane), at: Pos2) -> bool {
        let over = [self.minimap, self.legend, self.plan_button, self.wipe];
        over.into_iter().flatten().any(|(own, rect)| own == key && rect.contains(at))
    }

    /// Returns the mapping between screen points and the image or plan of a canvas. `None` before the canvas was first
    /// shown.
    #[must_use]
    pub fn mapping(&self, place: Place, pane: Pane) -> Option<Mapping> {
        let bend = self.bends.get(&(place, pane)).copied();
        let (view, rect) = (*self.views.get(&(place, pane))?, *self.rects.get(&(place, pane))?);
        Some(Mapping { view, rect, bend })
    }
}

/// Layers that are visible on images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch above the image")]
pub struct Layers {
    /// Grid of the floor.
    pub grid: bool,
    /// Horizon of the camera.
    pub horizon: bool,
    /// Field-of-view polygon.
    pub field: bool,
    /// Whether vertical walls are painted on the edges of the field-of-view polygon.
    pub prism: bool,
    /// Person of 1.75 m at the pointer.
    pub guide: bool,
    /// Extensions of lines to their vanishing point.
    pub extensions: bool,
    /// Colours of lines by residual instead of by kind.
    pub by_residual: bool,
    /// Suggested lines, which would reduce the uncertainty the most.
    pub suggestion: bool,
    /// Detected edges, which a click accepts as lines.
    pub edges: bool,
    /// Undistorted image instead of the raw image.
    pub straight: bool,
    /// Whether all layers are hidden.
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

/// Viewpoint of the 3-D scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Point in the middle of the view, in metres.
    pub target: [f64; 3],
    /// Distance of the eye from the target, in metres.
    pub distance: f64,
    /// Azimuth of the view direction, in radians: 0 along +y, positive towards −x.
    pub yaw: f64,
    /// Elevation of the eye above the floor, seen from the target, in radians.
    pub pitch: f64,
}

/// Distance of the near plane from the eye, in metres; closer points are not painted.
pub(crate) const NEAR: f64 = 0.05;

impl Orbit {
    /// Returns a viewpoint that shows the whole site.
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

    /// Returns the right, down and forward axes of the eye in world coordinates.
    fn axes(&self) -> [[f64; 3]; 3] {
        let ((sy, cy), (sp, cp)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        [[cy, sy, 0.0], [sy * sp, -cy * sp, -cp], [-sy * cp, cy * cp, -sp]]
    }

    /// Returns the coordinates of a world point in the frame of the eye (right, down, forward), in metres.
    pub(crate) fn seen(&self, point: WorldPoint) -> [f64; 3] {
        let by = [point.x - self.target[0], point.y - self.target[1], point.z - self.target[2]];
        let mut seen = self.axes().map(|axis| axis.iter().zip(by).map(|(a, b)| a * b).sum::<f64>());
        seen[2] += self.distance;
        seen
    }

    /// Projects a point in the frame of the eye (right, down, forward) to the screen.
    pub(crate) fn screen(rect: Rect, [x, y, z]: [f64; 3]) -> Pos2 {
        let focal = 0.9 * f64::from(rect.height().min(rect.width()));
        rect.center() + Vec2::new((focal * x / z) as f32, (focal * y / z) as f32)
    }

    /// Projects a world point to the screen; `None` for a point nearer than the near plane or behind the eye.
    #[must_use]
    pub fn project(&self, rect: Rect, point: WorldPoint) -> Option<Pos2> {
        let seen = self.seen(point);
        (seen[2] > NEAR).then(|| Self::screen(rect, seen))
    }

    /// Rotates the eye around the target by a drag on the screen, in points.
    pub fn turn(&mut self, by: Vec2) {
        self.yaw -= 0.008 * f64::from(by.x);
        self.pitch = (self.pitch + 0.008 * f64::from(by.y)).clamp(-0.2, 1.57);
    }

    /// Moves the target by a drag on the screen, in points.
    pub fn pan(&mut self, by: Vec2) {
        let [right, down, _] = self.axes();
        let share = self.distance / 700.0;
        for axis in 0..3 {
            self.target[axis] -= share * (f64::from(by.x) * right[axis] + f64::from(by.y) * down[axis]);
        }
    }

    /// Multiplies the magnification by `factor`, by moving the eye.
    pub fn zoom(&mut self, factor: f64) {
        self.distance = (self.distance / factor).clamp(0.2, 1e4);
    }
}

/// Command palette: its text and its selected row.
#[derive(Clone, Debug, Default)]
pub struct Palette {
    pub(crate) is_open: bool,
    pub(crate) query: String,
    pub(crate) row: usize,
}

impl Palette {
    /// Opens an empty palette, or closes it.
    pub fn toggle(&mut self) {
        *self = Self { is_open: !self.is_open, ..Self::default() };
    }

    /// Closes the palette.
    pub const fn close(&mut self) {
        self.is_open = false;
    }

    /// Whether the palette is open.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }
}

/// Order of the camera list.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Order of the site file.
    #[default]
    Site,
    /// Cameras with the most missing steps first.
    Missing,
    /// Largest floor error first.
    Sigma,
}

/// Filter and order of the camera list.
#[derive(Clone, Debug, Default)]
pub struct List {
    /// Filter of the list: only cameras whose ids contain this text are shown. Case is ignored.
    pub filter: String,
    /// Whether finished cameras are hidden.
    pub unfinished: bool,
    /// Order of the camera list.
    pub order: Order,
}

/// Display mode of a newer image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Showing {
    /// Old image left of the wipe line, newer image right of it.
    #[default]
    Wipe,
    /// Old and newer image in alternation.
    Blink,
    /// Newer image only.
    New,
    /// Old image only.
    Old,
}

impl Showing {
    /// All display modes with their labels.
    pub const ALL: [(Self, &str); 4] =
        [(Self::Wipe, "Wipe"), (Self::Blink, "Blink"), (Self::New, "New"), (Self::Old, "Old")];

    /// Returns the next display mode in the order of `ALL`.
    #[must_use]
    pub fn next(self) -> Self {
        let at = Self::ALL.iter().position(|(way, _)| *way == self).unwrap_or_default();
        Self::ALL[(at + 1) % Self::ALL.len()].0
    }
}

/// Display of a newer image over the calibrated image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glance {
    /// Mode of the display.
    pub showing: Showing,
    /// Position of the wipe line, as a fraction of the image width.
    pub share: f32,
}

impl Default for Glance {
    fn default() -> Self {
        Self { showing: Showing::default(), share: 0.5 }
    }
}

/// Virtual view (window) through which a fisheye image is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Looking {
    /// No window: the raw image.
    #[default]
    Whole,
    /// One of four views around the optical axis.
    Quadrant(usize),
    /// Unrolled panorama.
    Panorama,
    /// View in a direction, given in camera axes (right, down, forward).
    Toward([f64; 3]),
}

impl Looking {
    /// Returns the next kind of virtual view.
    #[must_use]
    pub const fn next(self) -> Self {
        match self {
            Self::Whole | Self::Toward(_) => Self::Quadrant(0),
            Self::Quadrant(index) if index < 3 => Self::Quadrant(index + 1),
            Self::Quadrant(_) => Self::Panorama,
            Self::Panorama => Self::Whole,
        }
    }

    /// Returns the window of the virtual view for a camera with this mount; `None` for the raw image. `reach`
    /// is the largest angle from the optical axis, in radians.
    pub(crate) fn window(self, mount: Mount, reach: f64) -> Option<Window> {
        /// Size of a flat window, in pixels.
        const FLAT_SIZE_PX: [usize; 2] = [1280, 800];
        /// Size of a panorama, in pixels.
        const PANORAMA_SIZE_PX: [usize; 2] = [2400, 800];
        /// Horizontal field of view of a view in a direction, in radians; similar to the human field of view.
        const HFOV_RAD: f64 = 1.7;
        match self {
            Self::Whole => None,
            Self::Quadrant(index) => Window::quadrants(mount, FLAT_SIZE_PX)?.get(index).copied(),
            Self::Panorama => Window::panorama(mount, reach, PANORAMA_SIZE_PX),
            Self::Toward([0.0, 0.0, _]) => {
                Window::flat(ViewDirection { hfov: HFOV_RAD, ..ViewDirection::default() }, FLAT_SIZE_PX)
            }
            Self::Toward(direction) => Window::toward(mount, direction, HFOV_RAD, FLAT_SIZE_PX),
        }
    }
}

/// Size of uncertainty ellipses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EllipseSize {
    /// Whether the ellipses are magnified. Otherwise their semi-axes are true to scale: two standard deviations.
    pub is_magnified: bool,
}

impl EllipseSize {
    /// Semi-axes at the scale of the plan, in standard deviations.
    const SIGMAS: f64 = 2.0;
    /// Magnification of the ellipses if `is_magnified` is set.
    const MAGNIFICATION: f64 = 10.0;

    /// Returns the semi-axes of the painted uncertainty ellipses, in standard deviations, with their magnification.
    #[must_use]
    pub fn sigmas(self) -> f64 {
        Self::SIGMAS * if self.is_magnified { Self::MAGNIFICATION } else { 1.0 }
    }

    /// Returns the label with the size of the ellipses, such as "Ellipses: 2σ, ×10".
    #[must_use]
    pub fn label(self) -> String {
        let magnified =
            if self.is_magnified { format!(", \u{d7}{}", Self::MAGNIFICATION) } else { String::new() };
        format!("Ellipses: {}\u{3c3}{magnified}", Self::SIGMAS)
    }
}
