//! The app's state, and what is done with it without a view.
//!
//! Windows onto the images of fisheyes.
//!
//! The lines that would help most, where the image has edges for them.
//!
//! What the still in hand proposes, as the view shows it.

use std::collections::VecDeque;
use std::path::PathBuf;

use calib_core::floor::{Mount, lens_reach};
use calib_core::outcome::Drawing;
use calib_core::{Lens, Pixel};
use calib_editor::{
    Action, Command, Edge, Editor, Pane, Part, Period, Proposed, TOOLS, edges, edit, hit, suggest,
};
use calib_site::{DrawNext, LensEntry, Site};
use egui::Context;
use web_time::{SystemTime, UNIX_EPOCH};

use crate::canvas::{Bend, View};
use crate::choice::{Chosen, Purpose};
use crate::edges::Edges;
use crate::edges::Proposing;
use crate::edges::Refining;
use crate::picture::Pictures;
use crate::platform::{Here, Platform, Task};
use crate::state::{
    Comparing, Conflict, Decision, Glance, Layers, List, Looking, Mode, Orbit, Outside, Palette, Panes,
    PathField, Place, Planning, Read, Recovering, Sent, Sheet, Tour,
};
use crate::storage::autosave::Shelf;
use crate::storage::autosave::Thumbnail;
use crate::storage::autosave::{self, Recent};
use crate::storage::autosave::{Autosave, Found, Slots};
use crate::storage::dialog::Dialog;
use crate::theme;

/// How the document is viewed: mode, canvases, layers and switches.
#[derive(Debug)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch on screen")]
pub struct ViewState {
    /// What the middle shows.
    pub mode: Mode,
    /// How canvases are looked at.
    pub panes: Panes,
    /// What lies on images.
    pub layers: Layers,
    /// How the images of fisheyes are looked at.
    pub looking: Looking,
    /// The image stands beside the plan.
    pub beside_plan: bool,
    /// The image stands beside the scene.
    pub beside_scene: bool,
    /// Images of all cameras lie on the plan.
    pub blend: bool,
    /// Fields are filled on the plan.
    pub coverage: bool,
    /// The floor from above is shown beside the image.
    pub above: bool,
    /// Poses before the joint solve are shown beside the new ones.
    pub show_before: bool,
    /// From where the scene is looked at.
    pub orbit: Option<Orbit>,
    /// Two cameras that fit equally well are shown side by side.
    pub compares_views: bool,
    /// How the list of cameras is filtered and sorted.
    pub list: List,
    /// How a newer still is looked at.
    pub glance: Glance,
}

/// Highlights that follow the pointer and the selection.
#[derive(Debug, Default)]
pub struct Hover {
    /// The line whose row is under the cursor.
    pub lit: Option<(usize, usize)>,
    /// The group of proposed lines whose row is under the cursor.
    pub lit_group: Option<usize>,
    /// When the suspect changed, for its blinking, in seconds.
    pub suspect_since: f64,
    pub(crate) suspect: Option<(usize, usize, usize)>,
    /// A field for text had the focus when the last frame ended.
    pub(crate) was_typing: bool,
}

/// Sheets and dialogs above the window.
#[derive(Debug)]
pub struct Dialogs {
    /// What other programs take.
    pub export: Sheet,
    /// The command palette.
    pub palette: Palette,
    /// The shortcut sheet is open.
    pub shortcuts: bool,
    /// The about sheet is open.
    pub about: bool,
    /// How files are asked for.
    pub chooser: fn(Purpose) -> Dialog,
    /// A file that waits for a decision.
    pub conflict: Option<Conflict>,
    /// Images that the site names outside its folder.
    pub outside: Outside,
    /// A path that is typed in place of a file chooser.
    pub path_field: Option<PathField>,
    pub(crate) dialog: Option<Dialog>,
}

/// Files, autosaves and recent sites.
#[derive(Debug)]
pub struct Storage {
    /// Work of crashed sessions, offered, each with where it is kept.
    pub found: Vec<(Autosave, Found)>,
    /// Sites that were opened or saved last.
    pub recent: Vec<Recent>,
    /// The small still by which the site is known where sites are kept.
    pub(crate) thumbnail: Thumbnail,
    /// Where a browser keeps sites.
    pub shelf: Option<Box<dyn Shelf>>,
    pub(crate) autosave: Option<Autosave>,
    /// What the site's own file held when it was read or written last.
    pub(crate) held: Option<u64>,
    /// The site as its file had it then.
    pub(crate) as_held: Option<Site>,
    /// Where autosaves are.
    pub(crate) folder: Option<PathBuf>,
    /// The autosaves that no other window touches while this one lives.
    pub(crate) claims: Vec<(PathBuf, <Here as Platform>::Claim)>,
    pub(crate) kept: u64,
}

/// Work off the frame's path.
#[derive(Debug, Default)]
pub struct Jobs {
    pub(crate) arriving: Vec<Task<Vec<Chosen>>>,
    pub(crate) picture: Option<std::sync::mpsc::Receiver<std::sync::Arc<egui::ColorImage>>>,
    pub(crate) pictured: Option<Vec<u8>>,
    pub(crate) adding: Vec<Task<Read>>,
    /// The camera whose still is asked for, or read.
    pub(crate) replaced: Period,
    pub(crate) replacing: Option<Task<Read>>,
    pub(crate) planning: Option<Planning>,
    pub(crate) refining: Option<Refining>,
    pub(crate) proposing: Option<Proposing>,
    pub(crate) comparing: VecDeque<Comparing>,
    pub(crate) recovering: Option<Recovering>,
}

/// What views read: the document, how it is looked at, and what is under way.
#[derive(Debug)]
pub struct App {
    /// The document.
    pub editor: Editor,
    pub(crate) sent: Vec<Sent>,
    /// Decoded stills.
    pub pictures: Pictures,
    /// Straight edges of the stills.
    pub edges: Edges,
    /// How far a newcomer has come.
    pub tour: Tour,
    /// Between which links or marks the next distance is measured.
    pub pair: [String; 2],
    /// Seconds since 1970, for how old calibrations are.
    pub clock: fn() -> u64,
    /// How the document is viewed: mode, canvases, layers and switches.
    pub view: ViewState,
    /// Highlights that follow the pointer and the selection.
    pub hover: Hover,
    /// Sheets and dialogs above the window.
    pub dialogs: Dialogs,
    /// Files, autosaves and recent sites.
    pub storage: Storage,
    /// Work off the frame's path.
    pub jobs: Jobs,
}

impl Default for ViewState {
    fn default() -> Self {
        Self {
            mode: Mode::Image,
            panes: Panes::default(),
            layers: Layers::default(),
            looking: Looking::default(),
            beside_plan: true,
            beside_scene: false,
            blend: false,
            coverage: true,
            above: true,
            show_before: true,
            orbit: None,
            compares_views: false,
            list: List::default(),
            glance: Glance::default(),
        }
    }
}

impl App {
    /// The app with nothing open; what a crashed session left in `folder` is offered.
    #[must_use]
    pub fn new(ctx: &Context, folder: Option<PathBuf>) -> Self {
        theme::install(ctx);
        let Slots { found, autosave, claims } = Slots::of(folder.as_deref());
        Self {
            editor: Editor::default(),
            sent: Vec::new(),
            pictures: Pictures::default(),
            edges: Edges::default(),
            tour: Tour::default(),
            pair: Default::default(),
            clock: || SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
            view: ViewState::default(),
            hover: Hover::default(),
            dialogs: Dialogs {
                export: Sheet::default(),
                palette: Palette::default(),
                shortcuts: false,
                about: false,
                chooser: Dialog::open,
                conflict: None,
                outside: Outside::default(),
                path_field: None,
                dialog: None,
            },
            storage: Storage {
                found,
                recent: folder.as_deref().map(autosave::list).unwrap_or_default(),
                thumbnail: Thumbnail::default(),
                shelf: None,
                autosave,
                held: None,
                as_held: None,
                folder,
                claims,
                kept: 0,
            },
            jobs: Jobs::default(),
        }
    }

    /// Has the editor do something now: for canvases, which show in this frame what the pointer does.
    pub fn act(&mut self, action: Action) {
        self.editor.apply(action);
    }

    /// Asks for something to be done at the end of the frame: for panels, which show one state of the site.
    pub fn send(&mut self, action: Action) {
        self.sent.push(Sent::Action(action));
    }

    /// Asks for a command to be run at the end of the frame.
    pub fn tell(&mut self, command: Command) {
        self.sent.push(Sent::Command(command));
    }

    /// Asks for a site file to be opened, at the end of the frame.
    pub(crate) fn open_later(&mut self, path: PathBuf) {
        self.sent.push(Sent::OpenPath(path));
    }

    /// Asks for what a crashed session left to be gone on with, or to be discarded.
    pub(crate) fn decide(&mut self, index: usize, goes_on: bool) {
        self.sent.push(if goes_on { Sent::Recover(index) } else { Sent::Discard(index) });
    }

    /// Decides what becomes of a file that is not written without asking, at the end of the frame.
    pub(crate) fn settle_conflict(&mut self, decision: Decision) {
        self.sent.push(Sent::Decide(decision));
    }

    /// Decides whether images outside the site's folder are read, at the end of the frame.
    pub(crate) fn decide_outside(&mut self, allows: bool) {
        self.sent.push(Sent::Outside(allows));
    }

    /// Takes a path that was typed, or none, at the end of the frame.
    pub(crate) fn take_typed(&mut self, typed: Option<PathField>) {
        self.sent.push(Sent::Typed(typed));
    }

    /// Whether a command would do something now.
    #[must_use]
    pub fn is_enabled(&self, command: Command) -> bool {
        self.editor.is_enabled(command, self.is_working())
    }

    /// Asks for files.
    pub fn ask(&mut self, purpose: Purpose) {
        self.dialogs.dialog = Some((self.dialogs.chooser)(purpose));
    }

    /// Asks for what is known of the lens of the camera in hand to be changed.
    pub(crate) fn change_lens(&mut self, name: &str, change: impl FnOnce(&mut LensEntry)) {
        let Some(entry) = self.editor.session().entry() else { return };
        let mut lens = entry.lens.clone().unwrap_or_default();
        change(&mut lens);
        self.send(Action::Lens { lens: Box::new(lens), name: name.to_owned() });
    }

    /// Shows another view.
    pub fn show(&mut self, mode: Mode) {
        // A control point that waits for the plan waits through this.
        if !self.editor.is_at_rest() {
            self.act(Action::Drop);
        }
        self.view.mode = mode;
        // What draws on an image has nothing to do on the plan: there the handles are meant.
        let drew =
            self.editor.tool_kind().is_some() || TOOLS[self.editor.tool_row()].title == "Field of view";
        if mode == Mode::Plan && drew {
            self.act(Action::TakeTool(0));
        }
    }

    /// Closes what is open above the window. Whether anything was.
    pub fn close_sheets(&mut self) -> bool {
        let exported = self.dialogs.export.close();
        let was_asked = self.dialogs.conflict.take().is_some()
            | self.dialogs.path_field.take().is_some()
            | !self.dialogs.outside.asked.is_empty();
        if !self.dialogs.outside.asked.is_empty() {
            self.decide_outside(false);
        }
        let was_open = exported
            || was_asked
            || self.dialogs.palette.is_open()
            || self.dialogs.shortcuts
            || self.dialogs.about
            || self.editor.error().is_some();
        self.dialogs.palette.close();
        (self.dialogs.shortcuts, self.dialogs.about) = (false, false);
        self.act(Action::CloseError);
        was_open
    }

    /// The canvas that zoom keys mean.
    #[must_use]
    pub fn zoom_key(&self) -> (Place, Pane) {
        let own = Pane::Image(self.editor.session().camera);
        match (self.view.mode, self.view.panes.active) {
            (Mode::Image, _) => (Place::Main, own),
            (Mode::Plan, None) => (Place::Half, own),
            (_, None) => (Place::Tile, own),
            (_, Some(active)) => active,
        }
    }

    /// Looks at a part of the image in hand so that it fills a good deal of the canvas.
    pub fn reveal(&mut self, part: Part) {
        let camera = self.editor.session().camera;
        let key = (Place::Main, Pane::Image(camera));
        let parts = edit::points_of(self.editor.site(), camera, &[part].into());
        let points: Vec<[f64; 2]> = hit::handles(self.editor.site(), camera)
            .into_iter()
            .filter(|(part, _)| parts.contains(part))
            .map(|(_, pixel)| pixel.into())
            .collect();
        let Some(mapping) = self.view.panes.mapping(key.0, key.1).filter(|_| !points.is_empty()) else {
            return;
        };
        let points: Vec<[f64; 2]> = points.into_iter().map(|at| mapping.flat(at)).collect();
        let low = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let margin = 0.5 * (high(0) - low(0)).max(high(1) - low(1)).max(20.0);
        let (low, high) = ([low(0) - margin, low(1) - margin], [high(0) + margin, high(1) + margin]);
        self.view.panes.views.insert(key, View::of(low, high, mapping.rect, false, false));
    }

    /// The edge of a camera's image under a pixel, while a tool that draws lines is in the hand.
    pub fn offer(&mut self, ctx: &Context, camera: usize, at: Pixel, radius: f64) -> Option<Edge> {
        let draws = self
            .editor
            .tool_kind()
            .is_some_and(|kind| kind.row().shape != calib_core::single::Shape::Polyline);
        if !draws || !self.view.layers.edges {
            return None;
        }
        if camera == self.editor.session().camera
            && let Some(edge) = self.suggested_under(ctx, at, 2.0 * radius)
        {
            return Some(edge);
        }
        let name = self.editor.session().site.cameras.get(camera)?.image.as_deref()?;
        let picture = self.pictures.ready(name)?;
        // What stands upright is not offered what lies flat.
        let plumb = self.editor.tool_kind().is_some_and(|kind| kind.row().is_upright());
        let edge = edges::under(self.edges.of(ctx, name, &picture.image), at, radius)?;
        let [a, b] = edge;
        (!plumb || (a.v - b.v).abs() > (a.u - b.u).abs()).then_some(edge)
    }
}

impl App {
    /// The lens and focal of a camera, if it is a fisheye, with how it hangs: under a ceiling, while nothing tells.
    fn fisheye(&self, camera: usize) -> Option<(Lens, f64, Mount)> {
        let session = self.editor.session();
        let pose = session.solved.pose(camera);
        let lens = hit::lens_of(&session.site, camera, pose).filter(|lens| lens.distortion.is_wide())?;
        let mount = pose.map_or(Mount::Ceiling, |pose| Mount::of_pitch(pose.pitch));
        Some((lens, pose.map_or(lens.focal, |pose| pose.focal), mount))
    }

    /// Whether a camera is a fisheye, which windows are for.
    #[must_use]
    pub fn is_fisheye(&self, camera: usize) -> bool {
        self.fisheye(camera).is_some()
    }

    /// The window that a fisheye is looked at through.
    pub(crate) fn window(&self, camera: usize) -> Option<Bend> {
        let (lens, focal, mount) = self.fisheye(camera)?;
        let size = self.editor.session().site.cameras.get(camera)?.size();
        let ahead = Looking::Toward([0.0, 0.0, 1.0]);
        let looking = if self.view.looking == Looking::Whole && self.view.layers.straight {
            ahead
        } else {
            self.view.looking
        };
        let window = looking.window(mount, lens_reach(&lens, focal, size))?;
        Some(Bend::Window { lens, focal, window })
    }

    /// Looks at the image in hand through another window: shown whole at first.
    pub(crate) fn look(&mut self, looking: Looking) {
        self.view.looking = looking;
        let own = Pane::Image(self.editor.session().camera);
        self.view.panes.views.remove(&(Place::Main, own));
    }

    /// Turns the window towards what a pixel of the image in hand shows.
    pub(crate) fn look_at(&mut self, pixel: Pixel) {
        let camera = self.editor.session().camera;
        let Some((lens, focal, _)) = self.fisheye(camera) else { return };
        if let Some([x, y, z]) = lens.bearing(pixel) {
            self.look(Looking::Toward([x / focal, y / focal, z]));
        }
    }
}

impl App {
    /// What the camera in hand proposes to draw, while its floor is not known well enough without.
    #[must_use]
    pub fn proposal(&self) -> Option<&DrawNext> {
        /// Floors known better than this need no more lines.
        const GOOD: f64 = 0.015;
        let solution = self.editor.session().solution()?;
        let next = self.editor.session().proposal();
        let rel = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
        let is_needed =
            |next: &&DrawNext| rel.is_none_or(|rel| rel >= GOOD) || next.drawing == Some(Drawing::KnownSize);
        next.filter(|next| self.view.layers.suggestion && is_needed(next))
    }

    /// Edges of the image in hand on which the proposed lines can be drawn; none while something is in the hand.
    #[must_use]
    pub fn suggested(&mut self, ctx: &Context) -> Vec<Edge> {
        let Some(next) = self.proposal().cloned() else { return Vec::new() };
        let session = self.editor.session();
        let (Some(entry), Some(&pose)) = (session.entry(), session.pose()) else { return Vec::new() };
        let (entry, name) = (entry.clone(), entry.image.clone().unwrap_or_default());
        let Some(picture) = self.pictures.ready(&name).filter(|_| self.editor.tool().is_idle()) else {
            return Vec::new();
        };
        suggest::on_edges(&next, &pose, &entry, self.edges.of(ctx, &name, &picture.image))
    }

    /// The suggested edge under a pixel, while the tool that draws it is in the hand.
    pub(crate) fn suggested_under(&mut self, ctx: &Context, at: Pixel, radius: f64) -> Option<Edge> {
        let kind = self.proposal()?.kind;
        if kind.is_none() || self.editor.tool_kind() != kind {
            return None;
        }
        let edges = self.suggested(ctx);
        edges.into_iter().find(|&[a, b]| hit::to_segment(a, b, at) <= radius)
    }
}

impl App {
    /// What the still of the camera in hand proposes, where its image is what is looked at.
    #[must_use]
    pub fn shown_proposal(&self) -> Option<&Proposed> {
        self.editor.session().proposed().filter(|_| self.view.mode == Mode::Image)
    }

    /// Whether Enter and Escape mean the proposal: nothing is in the hand, and no button has the focus.
    pub(crate) fn decides_proposal(&self, ctx: &Context) -> bool {
        self.shown_proposal().is_some()
            && self.editor.tool().is_idle()
            && ctx.memory(|memory| memory.focused().is_none())
    }
}
