//! Icons: strokes on a grid of 16 units, and icon buttons with an accessible name.

use egui::{Color32, CornerRadius, Pos2, Rect, Response, Role, Sense, Stroke, Ui, Vec2, WidgetInfo};

use crate::theme;

/// Stroke, ring or dot of an icon, on the grid of 16 units.
#[derive(Clone, Copy, Debug)]
enum Piece {
    Line(&'static [[f32; 2]]),
    Ring([f32; 2], f32),
    Dot([f32; 2], f32),
}
use Piece::{Dot, Line, Ring};

macro_rules! icons {
    ($($(#[$doc:meta])* $name:ident = [$($piece:expr),+ $(,)?]),+ $(,)?) => {
        /// Icon of an object or a command.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Icon { $($(#[$doc])* $name),+ }

        impl Icon {
            const fn pieces(self) -> &'static [Piece] {
                match self { $(Self::$name => &[$($piece),+]),+ }
            }
        }
    };
}

impl From<calib_editor::Icon> for Icon {
    fn from(tool: calib_editor::Icon) -> Self {
        use calib_editor::Icon as Tool;
        match tool {
            Tool::Select => Self::Select,
            Tool::Vertical => Self::Vertical,
            Tool::Parallel => Self::Parallel,
            Tool::Perpendicular => Self::Perpendicular,
            Tool::Equal => Self::Equal,
            Tool::Known => Self::Known,
            Tool::Straight => Self::Straight,
            Tool::Upright => Self::Upright,
            Tool::Field => Self::Field,
            Tool::Control => Self::Control,
            Tool::Link => Self::Link,
            Tool::Mark => Self::Box,
            Tool::Measure => Self::Measure,
            Tool::Region => Self::Region,
            Tool::Area => Self::Area,
            Tool::Wall => Self::Wall,
        }
    }
}

icons! {
    /// An arrow.
    Select = [Line(&[[4.0, 2.5], [12.5, 8.5], [8.5, 9.3], [10.5, 13.5], [8.7, 14.2], [7.0, 10.0], [4.0, 12.5], [4.0, 2.5]])],
    /// A plumb line.
    Vertical = [Line(&[[8.0, 2.0], [8.0, 13.5]]), Line(&[[5.5, 10.5], [8.0, 13.5], [10.5, 10.5]])],
    /// Two lines of one direction.
    Parallel = [Line(&[[3.5, 13.5], [7.5, 2.5]]), Line(&[[8.5, 13.5], [12.5, 2.5]]), Line(&[[3.0, 8.5], [5.5, 7.0], [7.5, 9.0]]), Line(&[[8.5, 8.5], [10.7, 7.0], [12.7, 9.0]])],
    /// A right angle.
    Perpendicular = [Line(&[[4.0, 2.5], [4.0, 12.5], [13.5, 12.5]]), Line(&[[4.0, 9.0], [7.5, 9.0], [7.5, 12.5]])],
    /// Two lines with a tick.
    Equal = [Line(&[[2.5, 5.0], [13.5, 5.0]]), Line(&[[2.5, 11.0], [13.5, 11.0]]), Line(&[[7.0, 2.8], [7.0, 7.2]]), Line(&[[9.0, 2.8], [9.0, 7.2]]), Line(&[[7.0, 8.8], [7.0, 13.2]]), Line(&[[9.0, 8.8], [9.0, 13.2]])],
    /// A dimension line.
    Known = [Line(&[[2.5, 4.0], [2.5, 12.0]]), Line(&[[13.5, 4.0], [13.5, 12.0]]), Line(&[[2.5, 8.0], [13.5, 8.0]]), Line(&[[5.0, 6.0], [2.5, 8.0], [5.0, 10.0]]), Line(&[[11.0, 6.0], [13.5, 8.0], [11.0, 10.0]])],
    /// A curved edge with points.
    Straight = [Line(&[[2.5, 12.5], [5.0, 7.5], [8.5, 5.0], [13.5, 3.5]]), Dot([2.5, 12.5], 1.5), Dot([7.0, 6.0], 1.5), Dot([13.5, 3.5], 1.5)],
    /// A foot and a head.
    Upright = [Line(&[[8.0, 12.5], [8.0, 5.5]]), Ring([8.0, 3.6], 1.9), Line(&[[4.5, 13.0], [11.5, 13.0]])],
    /// A polygon on the floor.
    Field = [Line(&[[5.0, 4.0], [11.0, 4.0], [14.0, 12.0], [2.0, 12.0], [5.0, 4.0]])],
    /// Cross hairs.
    Control = [Ring([8.0, 8.0], 4.0), Line(&[[8.0, 1.5], [8.0, 6.0]]), Line(&[[8.0, 10.0], [8.0, 14.5]]), Line(&[[1.5, 8.0], [6.0, 8.0]]), Line(&[[10.0, 8.0], [14.5, 8.0]])],
    /// A chain.
    Link = [Line(&[[6.5, 9.5], [9.5, 6.5]]), Line(&[[7.5, 5.0], [9.7, 2.8], [13.2, 6.3], [11.0, 8.5]]), Line(&[[8.5, 11.0], [6.3, 13.2], [2.8, 9.7], [5.0, 7.5]])],
    /// A measuring rod.
    Measure = [Line(&[[2.0, 10.5], [10.5, 2.0], [14.0, 5.5], [5.5, 14.0], [2.0, 10.5]]), Line(&[[5.0, 7.5], [6.8, 9.3]]), Line(&[[7.5, 5.0], [9.3, 6.8]])],
    /// A ramp over the floor.
    Region = [Line(&[[2.0, 12.5], [14.0, 12.5]]), Line(&[[2.0, 12.5], [9.5, 5.0], [14.0, 5.0], [14.0, 12.5]]), Dot([9.5, 5.0], 1.2)],
    /// A hatched polygon.
    Area = [Line(&[[3.0, 5.0], [10.0, 2.5], [13.5, 8.0], [9.0, 13.5], [3.0, 11.0], [3.0, 5.0]]), Line(&[[4.0, 10.0], [9.0, 5.0]]), Line(&[[7.0, 11.5], [11.5, 7.0]])],
    /// Bricks.
    Wall = [Line(&[[2.0, 4.0], [14.0, 4.0], [14.0, 12.0], [2.0, 12.0], [2.0, 4.0]]), Line(&[[2.0, 8.0], [14.0, 8.0]]), Line(&[[8.0, 4.0], [8.0, 8.0]]), Line(&[[5.0, 8.0], [5.0, 12.0]]), Line(&[[11.0, 8.0], [11.0, 12.0]])],
    /// Two crossed lines.
    Cross = [Line(&[[8.0, 2.5], [8.0, 13.5]]), Line(&[[2.5, 8.0], [13.5, 8.0]])],
    /// A vertical post on the floor.
    Post = [Line(&[[8.0, 13.5], [8.0, 3.0]]), Dot([8.0, 3.0], 1.8), Line(&[[5.5, 13.5], [10.5, 13.5]])],
    /// A box.
    Box = [Line(&[[2.5, 5.0], [8.0, 2.5], [13.5, 5.0], [8.0, 7.5], [2.5, 5.0], [2.5, 11.0], [8.0, 13.5], [13.5, 11.0], [13.5, 5.0]]), Line(&[[8.0, 7.5], [8.0, 13.5]])],
    /// A cylinder.
    Cylinder = [Line(&[[4.0, 4.0], [6.0, 2.8], [10.0, 2.8], [12.0, 4.0], [10.0, 5.2], [6.0, 5.2], [4.0, 4.0], [4.0, 12.0], [6.0, 13.2], [10.0, 13.2], [12.0, 12.0], [12.0, 4.0]])],
    /// A person.
    Person = [Ring([8.0, 3.5], 1.7), Line(&[[4.5, 6.5], [11.5, 6.5]]), Line(&[[8.0, 6.5], [8.0, 9.5], [5.5, 14.0]]), Line(&[[8.0, 9.5], [10.5, 14.0]])],
    /// A rectangle on the floor.
    Rectangle = [Line(&[[1.5, 10.5], [4.5, 5.0], [13.0, 5.0], [14.5, 10.5], [1.5, 10.5]])],
    /// A circle on the floor.
    Circle = [Line(&[[2.0, 8.0], [3.5, 5.9], [6.5, 4.8], [9.5, 4.8], [12.5, 5.9], [14.0, 8.0], [12.5, 10.1], [9.5, 11.2], [6.5, 11.2], [3.5, 10.1], [2.0, 8.0]])],
    /// Crossed grid lines.
    Grid = [Line(&[[5.5, 2.5], [5.5, 13.5]]), Line(&[[10.5, 2.5], [10.5, 13.5]]), Line(&[[2.5, 5.5], [13.5, 5.5]]), Line(&[[2.5, 10.5], [13.5, 10.5]])],
    /// A photograph.
    Image = [Line(&[[2.0, 3.5], [14.0, 3.5], [14.0, 12.5], [2.0, 12.5], [2.0, 3.5]]), Line(&[[2.5, 12.0], [6.5, 7.5], [9.0, 10.0], [11.0, 8.5], [13.5, 11.5]]), Dot([10.5, 6.0], 1.0)],
    /// A floor plan.
    Plan = [Line(&[[2.5, 2.5], [13.5, 2.5], [13.5, 13.5], [2.5, 13.5], [2.5, 2.5]]), Line(&[[2.5, 7.5], [6.5, 7.5]]), Line(&[[9.0, 2.5], [9.0, 7.5], [13.5, 7.5]]), Line(&[[7.0, 13.5], [7.0, 10.5]])],
    /// Four tiles: the view of all cameras.
    All = [Line(&[[2.5, 2.5], [7.0, 2.5], [7.0, 7.0], [2.5, 7.0], [2.5, 2.5]]), Line(&[[9.0, 2.5], [13.5, 2.5], [13.5, 7.0], [9.0, 7.0], [9.0, 2.5]]), Line(&[[2.5, 9.0], [7.0, 9.0], [7.0, 13.5], [2.5, 13.5], [2.5, 9.0]]), Line(&[[9.0, 9.0], [13.5, 9.0], [13.5, 13.5], [9.0, 13.5], [9.0, 9.0]])],
    /// A cube: the 3-D scene.
    Scene = [Line(&[[8.0, 2.0], [13.5, 5.0], [13.5, 11.0], [8.0, 14.0], [2.5, 11.0], [2.5, 5.0], [8.0, 2.0]]), Line(&[[2.5, 5.0], [8.0, 8.0], [13.5, 5.0]]), Line(&[[8.0, 8.0], [8.0, 14.0]])],
    /// A closed lock.
    Locked = [Line(&[[4.0, 7.5], [12.0, 7.5], [12.0, 13.5], [4.0, 13.5], [4.0, 7.5]]), Line(&[[5.5, 7.5], [5.5, 5.0], [6.5, 3.0], [9.5, 3.0], [10.5, 5.0], [10.5, 7.5]]), Dot([8.0, 10.5], 1.2)],
    /// An open lock.
    Unlocked = [Line(&[[4.0, 7.5], [12.0, 7.5], [12.0, 13.5], [4.0, 13.5], [4.0, 7.5]]), Line(&[[5.5, 7.5], [5.5, 4.5], [6.5, 2.5], [9.5, 2.5], [10.5, 4.0]])],
    /// Arrow back.
    Undo = [Line(&[[6.0, 3.0], [3.0, 6.0], [6.0, 9.0]]), Line(&[[3.0, 6.0], [10.0, 6.0], [12.5, 7.5], [13.0, 10.0], [12.0, 12.0], [10.0, 12.8], [7.0, 12.8]])],
    /// Arrow forward.
    Redo = [Line(&[[10.0, 3.0], [13.0, 6.0], [10.0, 9.0]]), Line(&[[13.0, 6.0], [6.0, 6.0], [3.5, 7.5], [3.0, 10.0], [4.0, 12.0], [6.0, 12.8], [9.0, 12.8]])],
    /// Two bars: pause.
    Pause = [Line(&[[5.5, 3.0], [5.5, 13.0]]), Line(&[[10.5, 3.0], [10.5, 13.0]])],
    /// Triangle: play.
    Play = [Line(&[[4.5, 3.0], [12.5, 8.0], [4.5, 13.0], [4.5, 3.0]])],
    /// A magnifier.
    Search = [Ring([7.0, 7.0], 4.3), Line(&[[10.2, 10.2], [14.0, 14.0]])],
    /// A warning.
    Warn = [Line(&[[8.0, 2.5], [14.0, 13.0], [2.0, 13.0], [8.0, 2.5]]), Line(&[[8.0, 6.5], [8.0, 9.5]]), Dot([8.0, 11.3], 0.9)],
    /// Check mark.
    Check = [Line(&[[3.0, 8.5], [6.5, 12.0], [13.0, 4.5]])],
    /// Chevron that points right.
    Chevron = [Line(&[[6.0, 4.0], [10.0, 8.0], [6.0, 12.0]])],
    /// Empty circle.
    Open = [Ring([8.0, 8.0], 4.5)],
    /// Plus sign.
    Plus = [Line(&[[8.0, 3.0], [8.0, 13.0]]), Line(&[[3.0, 8.0], [13.0, 8.0]])],
    /// Diagonal cross.
    Close = [Line(&[[4.0, 4.0], [12.0, 12.0]]), Line(&[[12.0, 4.0], [4.0, 12.0]])],
    /// Three lines of a menu.
    Menu = [Line(&[[2.5, 4.5], [13.5, 4.5]]), Line(&[[2.5, 8.0], [13.5, 8.0]]), Line(&[[2.5, 11.5], [13.5, 11.5]])],
    /// Sun, for the light theme.
    Sun = [Ring([8.0, 8.0], 2.8), Line(&[[8.0, 1.8], [8.0, 3.4]]), Line(&[[8.0, 12.6], [8.0, 14.2]]), Line(&[[1.8, 8.0], [3.4, 8.0]]), Line(&[[12.6, 8.0], [14.2, 8.0]]), Line(&[[3.6, 3.6], [4.7, 4.7]]), Line(&[[11.3, 11.3], [12.4, 12.4]]), Line(&[[3.6, 12.4], [4.7, 11.3]]), Line(&[[11.3, 4.7], [12.4, 3.6]])],
}

/// Paints an icon in the middle of a rectangle; `size` is its side in points.
pub fn paint(painter: &egui::Painter, icon: Icon, rect: Rect, size: f32, colour: Color32) {
    let unit = size / 16.0;
    let corner = rect.center() - Vec2::splat(0.5 * size);
    let at = |[x, y]: [f32; 2]| Pos2::new(corner.x + unit * x, corner.y + unit * y);
    let stroke = Stroke::new(1.4 * unit.max(0.8), colour);
    for piece in icon.pieces() {
        match *piece {
            Line(points) => {
                painter.line(points.iter().map(|&point| at(point)).collect(), stroke);
            }
            Ring(centre, radius) => {
                painter.circle_stroke(at(centre), unit * radius, stroke);
            }
            Dot(centre, radius) => {
                painter.circle_filled(at(centre), unit * radius, colour);
            }
        }
    }
}

/// Shows an icon within a line of text.
pub fn inline(ui: &mut Ui, icon: Icon, colour: Color32) -> Response {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(16.0, 16.0), Sense::hover());
    paint(ui.painter(), icon, rect, 14.0, colour);
    response
}

/// Appearance of an icon button.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Size of the button, in points.
    pub size: Vec2,
    /// Whether a button with two states is on; `None` for a button that has no state.
    pub chosen: Option<bool>,
    /// Whether the button is enabled.
    pub enabled: bool,
    /// Colour of the icon; `None` for the text colour.
    pub colour: Option<Color32>,
}

impl Default for Look {
    fn default() -> Self {
        Self { size: Vec2::new(24.0, 24.0), chosen: None, enabled: true, colour: None }
    }
}

/// Shows an icon button; `label` is its accessible name, `tip` its tooltip. If `tip` is empty, the label is the
/// tooltip.
pub fn button(ui: &mut Ui, icon: Icon, label: &str, tip: &str, look: Look) -> Response {
    let sense = if look.enabled { Sense::click() } else { Sense::hover() };
    let (rect, response) = ui.allocate_exact_size(look.size, sense);
    response.widget_info(|| match look.chosen {
        Some(is_on) => WidgetInfo::selected(Role::Button, look.enabled, is_on, label),
        None => WidgetInfo::labeled(Role::Button, look.enabled, label),
    });
    let is_on = look.chosen == Some(true);
    let palette = theme::palette(ui.ctx());
    let fill = match (is_on, response.hovered() && look.enabled) {
        (true, _) => palette.accent_bg,
        (false, true) => palette.line,
        (false, false) => Color32::TRANSPARENT,
    };
    let radius = CornerRadius::same(4);
    ui.painter().rect_filled(rect, radius, fill);
    if is_on || response.has_focus() {
        let stroke = Stroke::new(1.0, palette.accent);
        ui.painter().rect_stroke(rect, radius, stroke, egui::StrokeKind::Inside);
    }
    let colour = if look.enabled { look.colour.unwrap_or(palette.text) } else { palette.line };
    paint(ui.painter(), icon, rect, 0.75 * look.size.y.min(24.0), colour);
    if tip.is_empty() { response.on_hover_text(label) } else { response.on_hover_text(tip) }
}
