//! State of the app, and the operations on it that need no view.

use std::collections::VecDeque;
use std::path::PathBuf;

use calib_core::floor::{Mount, lens_reach};
use calib_core::outcome::SuggestedAnnotation;
use calib_core::{Annotation, Lens, Pixel};
use calib_editor::{
    Action, Command, Edge, Editor, Pane, Part, PendingCalibration, Period, Phase, TOOLS, ToolRow, edges,
    edit, hit, suggest,
};
use calib_site::{LensEntry, Site, SiteCamera, SuggestionEntry};
use egui::Context;
use web_time::{SystemTime, UNIX_EPOCH};

use crate::canvas::{Bend, View};
use crate::choice::{Chosen, Purpose};
use crate::edges::Edges;
use crate::edges::Proposing;
use crate::edges::Refining;
use crate::focus::{FocusWatch, RequestedField};
use crate::picture::Pictures;
use crate::platform::{Here, Platform, Task};
use crate::state::{
    AddressSheet, Automatic, AutomaticReport, Comparing, Conflict, Decision, EllipseSize, Glance, Layers,
    List, Looking, Mode, Orbit, Outside, Palette, Panes, PathField, Place, Planning, Read, Recovering, Sent,
    Sheet, ShownCoverage, ShownMeasurements, Tour, VideoSheet,
};
use crate::storage::autosave::Shelf;
use crate::storage::autosave::Thumbnail;
use crate::storage::autosave::{self, Recent};
use crate::storage::autosave::{Autosave, Found, Slots};
use crate::storage::dialog::Dialog;
use crate::theme;

/// View of the document: mode, canvases, layers and switches.
#[derive(Debug)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch on screen")]
pub struct ViewState {
    /// Kind of view in the middle of the window.
    pub mode: Mode,
    /// Pan, zoom and pointer of every canvas.
    pub panes: Panes,
    /// Layers that are painted on images.
    pub layers: Layers,
    /// Virtual view through which fisheye images are shown.
    pub looking: Looking,
    /// Whether the image is shown next to the plan.
    pub beside_plan: bool,
    /// Whether the image is shown next to the 3-D scene.
    pub beside_scene: bool,
    /// Whether the images of all cameras are projected onto the plan.
    pub blend: bool,
    /// Whether the plan shows the measured coverage.
    pub coverage: bool,
    /// Whether uncertainty ellipses are magnified.
    pub magnified: bool,
    /// Whether the floor, seen from above, is shown below the camera list.
    pub above: bool,
    /// Whether the poses before the joint solve are shown next to the new ones.
    pub show_before: bool,
    /// Viewpoint of the 3-D scene; `None` until the scene is first shown.
    pub orbit: Option<Orbit>,
    /// Whether two solutions of a camera that fit its lines equally well are shown side by side.
    pub compares_views: bool,
    /// Filter and order of the camera list.
    pub list: List,
    /// Display of a newer image over the calibrated image.
    pub glance: Glance,
    /// Field that gets the focus when a panel shows it next, because its value is missing.
    pub(crate) requested_field: Option<RequestedField>,
    /// Fields that waited for a value before the current gesture.
    pub(crate) open_fields: Vec<OpenField>,
}

/// Highlights that follow the pointer and the selection.
#[derive(Debug, Default)]
pub struct Hover {
    /// Annotation and segment whose table row is under the pointer.
    pub lit: Option<(usize, usize)>,
    /// Index of the group of the automatic calibration whose table row is under the pointer.
    pub lit_group: Option<usize>,
    /// Time at which `suspect` changed, on the clock of egui in seconds. The line blinks from this time.
    pub suspect_since: f64,
    /// First rejected line (outlier) of the current camera in the last frame: indices of camera, annotation and
    /// segment. `None` without an outlier.
    pub(crate) suspect: Option<(usize, usize, usize)>,
    /// Whether a text field had the focus at the end of the last frame.
    pub(crate) was_typing: bool,
    /// Result that was announced last to screen readers.
    pub(crate) announced: AnnouncedResult,
    /// Keyboard focus at the start of the last frame.
    pub(crate) focus: FocusWatch,
}

/// Field that waits for a value, with the index of its camera; `None` for the plan.
type OpenField = (Option<usize>, RequestedField);

/// Result of a camera that was announced to screen readers.
#[derive(Debug, Default)]
pub(crate) struct AnnouncedResult {
    /// Index of the camera.
    pub(crate) camera: Option<usize>,
    /// Announced sentence: id, status and floor error of the camera.
    pub(crate) result: String,
    /// Time of the announcement, on the clock of egui in seconds.
    pub(crate) since: f64,
}

/// Sheets and dialogs above the window.
#[derive(Debug)]
pub struct Dialogs {
    /// Export sheet.
    pub export: Sheet,
    /// Command palette.
    pub palette: Palette,
    /// Whether the shortcut sheet is open.
    pub shortcuts: bool,
    /// Whether the about sheet is open.
    pub about: bool,
    /// Function that opens a file chooser.
    pub chooser: fn(Purpose) -> Dialog,
    /// Conflict on saving: a file that is written only after a decision of the operator.
    pub conflict: Option<Conflict>,
    /// Images that the site names outside its folder, and the decisions about them.
    pub outside: Outside,
    /// Result of the automatic calibration and placement of all cameras, until it is closed.
    pub(crate) automatic: Option<AutomaticReport>,
    /// Sheet for an image from the address of a camera; `None` if it is closed.
    pub(crate) address: Option<Box<AddressSheet>>,
    /// Field for a typed path, used where no file chooser is available.
    pub path_field: Option<PathField>,
    /// Open file chooser.
    pub(crate) dialog: Option<Dialog>,
}

/// Files, autosaves and recent sites.
#[derive(Debug)]
pub struct Storage {
    /// Autosaves that the start page shows, each with its slot.
    pub found: Vec<(Autosave, Found)>,
    /// Sites that were opened or saved recently, newest first.
    pub recent: Vec<Recent>,
    /// Thumbnail of the open site in lists.
    pub(crate) thumbnail: Thumbnail,
    /// Site storage of the browser; `None` on the desktop.
    pub shelf: Option<Box<dyn Shelf>>,
    /// Autosave slot of this window.
    pub(crate) autosave: Option<Autosave>,
    /// Hash of the site file when it was last read or written; `None` if the site has no file or the hash is unknown.
    pub(crate) held: Option<u64>,
    /// Content of the site file when it was last read or written.
    pub(crate) as_held: Option<Site>,
    /// Folder of the autosaves.
    pub(crate) folder: Option<PathBuf>,
    /// Locks of autosave folders that keep other windows from using them while this window is open.
    pub(crate) claims: Vec<(PathBuf, <Here as Platform>::Claim)>,
    /// Value of `Revision::generation` (number of gestures that changed the site) at the last autosave.
    pub(crate) kept: u64,
}

/// Work that runs in the background.
#[derive(Debug, Default)]
pub struct Jobs {
    /// Dropped files that are being read.
    pub(crate) arriving: Vec<Task<Vec<Chosen>>>,
    /// Channel through which a requested screenshot arrives.
    pub(crate) picture: Option<std::sync::mpsc::Receiver<std::sync::Arc<egui::ColorImage>>>,
    /// Screenshot as PNG that waits for its file name.
    pub(crate) pictured: Option<Vec<u8>>,
    /// Images of new cameras that are being read.
    pub(crate) adding: Vec<Task<Read>>,
    /// Sheet that takes an image from a video; `None` if it is closed.
    pub(crate) video: Option<Box<VideoSheet>>,
    /// Videos for which the sheet is opened next.
    pub(crate) videos: VecDeque<Chosen>,
    /// Files of other programs, which are imported once images and plans are read.
    pub(crate) importing: Vec<Chosen>,
    /// Whether a camera was already added for one of the images that were opened together. The cameras of the other
    /// images then join its undo step.
    pub(crate) has_added: bool,
    /// Camera period whose image is being replaced.
    pub(crate) replaced: Period,
    /// Image that is being read to replace the image of `replaced`.
    pub(crate) replacing: Option<Task<Read>>,
    /// Plan image that is being read.
    pub(crate) planning: Option<Planning>,
    /// Joint refinement that is running.
    pub(crate) refining: Option<Refining>,
    /// Automatic calibration that is running.
    pub(crate) proposing: Option<Proposing>,
    /// Automatic calibration and placement of all cameras that is running.
    pub(crate) automatic: Option<Automatic>,
    /// Comparisons that are waiting or running; only the first is running.
    pub(crate) comparing: VecDeque<Comparing>,
    /// Running recovery of a camera that moved, from its newer image; `None` if none is running.
    pub(crate) recovering: Option<Recovering>,
}

/// State that the views read: the document, its view, and running work.
#[derive(Debug)]
pub struct App {
    /// Document: the open site, its results and the tools.
    pub editor: Editor,
    /// Requests that panels have queued; they are carried out at the end of the frame.
    pub(crate) sent: Vec<Sent>,
    /// Decoded images.
    pub pictures: Pictures,
    /// Straight edges that were detected in the images.
    pub edges: Edges,
    /// Progress of the tour for newcomers.
    pub tour: Tour,
    /// Ids of the links or marks between which the next distance is measured.
    pub pair: [String; 2],
    /// Values of the measurements; `None` until they are first shown.
    pub(crate) measurements: Option<ShownMeasurements>,
    /// Coverage that the plan shows; `None` until it is first shown.
    pub coverage: Option<ShownCoverage>,
    /// Text of the field for the coordinates of a new ground point.
    pub typed_point: String,
    /// Clock in seconds since 1970, for the age of calibrations.
    pub clock: fn() -> u64,
    /// View of the document: mode, canvases, layers and switches.
    pub view: ViewState,
    /// Highlights that follow the pointer and the selection.
    pub hover: Hover,
    /// Sheets and dialogs above the window.
    pub dialogs: Dialogs,
    /// Files, autosaves and recent sites.
    pub storage: Storage,
    /// Work that runs in the background.
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
            coverage: false,
            magnified: false,
            above: true,
            show_before: true,
            orbit: None,
            compares_views: false,
            list: List::default(),
            glance: Glance::default(),
            requested_field: None,
            open_fields: Vec::new(),
        }
    }
}

impl App {
    /// Creates the app with an empty document. The start page shows the autosaves in `folder`.
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
            measurements: None,
            coverage: None,
            typed_point: String::new(),
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
                automatic: None,
                address: None,
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

    /// Applies an action at once. Canvases use it, because they show the effect in the same frame.
    pub fn act(&mut self, action: Action) {
        // Walls and areas of interest are shown with the coverage.
        let draws_survey = |index: &usize| TOOLS.get(*index).is_some_and(ToolRow::draws_survey);
        self.view.coverage |= matches!(&action, Action::SelectTool(index) if draws_survey(index));
        // A movement of the pointer without a pressed button adds no field.
        let draws = match &action {
            Action::Pointer(pointer) => pointer.phase != Phase::Hover,
            Action::Gesture(_) => true,
            _ => false,
        };
        if draws && self.editor.tool().is_idle() {
            self.view.open_fields = self.open_fields();
        }
        self.editor.apply(action);
        if draws && self.editor.tool().is_idle() {
            // A gesture adds at most one field. Panels show the fields of the current camera and of the plan.
            let is_new = |field: &OpenField| !self.view.open_fields.contains(field);
            let new: Vec<OpenField> = self.open_fields().into_iter().filter(is_new).collect();
            if let &[(camera, field)] = &new[..]
                && camera.is_none_or(|camera| camera == self.editor.session().camera)
            {
                self.view.requested_field = Some(field);
            }
        }
    }

    /// Returns the fields that wait for a value, of all cameras and of the plan.
    fn open_fields(&self) -> Vec<OpenField> {
        let session = self.editor.session();
        let waits = |annotation: &Annotation| {
            annotation.off && annotation.kind.row().has_length && annotation.like.is_none()
                || edit::waits_for_height(annotation)
        };
        let of_camera = |(camera, entry): (usize, &SiteCamera)| {
            let annotations =
                entry.annotations.iter().enumerate().filter(|(_, annotation)| waits(annotation));
            annotations.map(|(index, _)| (Some(camera), RequestedField::Size(index))).collect::<Vec<_>>()
        };
        let of_images = session.site.cameras.iter().enumerate().flat_map(of_camera);
        let of_plan = session.tool.measured.map(|_| (None, RequestedField::PlanLength));
        of_images.chain(of_plan).collect()
    }

    /// Queues an action for the end of the frame. Panels use it, because all panels of a frame show the same
    /// state of the site.
    pub fn send(&mut self, action: Action) {
        self.sent.push(Sent::Action(action));
    }

    /// Queues a command for the end of the frame.
    pub fn send_command(&mut self, command: Command) {
        self.sent.push(Sent::Command(command));
    }

    /// Queues opening a site file for the end of the frame.
    pub(crate) fn open_later(&mut self, path: PathBuf) {
        self.sent.push(Sent::OpenPath(path));
    }

    /// Queues the decision about an autosave: restore it if `goes_on` is set, otherwise discard it.
    pub(crate) fn decide(&mut self, index: usize, goes_on: bool) {
        self.sent.push(if goes_on { Sent::Recover(index) } else { Sent::Discard(index) });
    }

    /// Queues the decision about a file that would be overwritten.
    pub(crate) fn settle_conflict(&mut self, decision: Decision) {
        self.sent.push(Sent::Decide(decision));
    }

    /// Queues the decision about reading images outside the site's folder.
    pub(crate) fn decide_outside(&mut self, allows: bool) {
        self.sent.push(Sent::Outside(allows));
    }

    /// Queues a typed path; `None` closes the field.
    pub(crate) fn take_typed(&mut self, typed: Option<PathField>) {
        self.sent.push(Sent::Typed(typed));
    }

    /// Whether a command has an effect now.
    #[must_use]
    pub fn is_enabled(&self, command: Command) -> bool {
        is_offered(command) && self.editor.is_enabled(command, self.is_working())
    }

    /// Opens a file chooser for this purpose.
    pub fn open_dialog(&mut self, purpose: Purpose) {
        self.dialogs.dialog = Some((self.dialogs.chooser)(purpose));
    }

    /// Queues a change of the lens entry of the current camera, named `name` in the undo history.
    pub(crate) fn change_lens(&mut self, name: &str, change: impl FnOnce(&mut LensEntry)) {
        let Some(entry) = self.editor.session().entry() else { return };
        let mut lens = entry.lens.clone().unwrap_or_default();
        change(&mut lens);
        self.send(Action::Lens { lens: Box::new(lens), name: name.to_owned() });
    }

    /// Switches to another view.
    pub fn show(&mut self, mode: Mode) {
        // A control point that still needs its plan position is not cancelled.
        if !self.editor.is_settled() {
            self.act(Action::CancelGesture);
        }
        self.view.mode = mode;
        // Tools that annotate images have no use on the plan, where placement handles are needed.
        let drew =
            self.editor.tool_kind().is_some() || TOOLS[self.editor.tool_row()].title == "Field of view";
        if mode == Mode::Plan && drew {
            self.act(Action::SelectTool(0));
        }
    }

    /// Whether a sheet or a dialog is above the window.
    #[must_use]
    pub(crate) fn has_sheet(&self) -> bool {
        let dialogs = &self.dialogs;
        dialogs.export.is_open
            || dialogs.palette.is_open
            || dialogs.shortcuts
            || dialogs.about
            || dialogs.conflict.is_some()
            || dialogs.path_field.is_some()
            || dialogs.address.is_some()
            || self.jobs.video.is_some()
    }

    /// Closes all sheets and dialogs; returns whether one was open.
    pub fn close_sheets(&mut self) -> bool {
        let exported = self.dialogs.export.close();
        let was_asked = self.dialogs.conflict.take().is_some()
            | self.dialogs.path_field.take().is_some()
            | self.dialogs.address.take().is_some()
            | self.jobs.video.take().is_some()
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

    /// Returns the canvas to which the zoom keys apply.
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

    /// Zooms the image of the current camera to the points of `part`.
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

    /// Returns the edge at a pixel of a camera's image, while edges are shown and a tool for lines or uprights is
    /// active. It is a suggested edge within twice `radius`, otherwise a detected edge within `radius`. `radius` is in
    /// raw pixels.
    pub fn edge_under_pointer(
        &mut self,
        ctx: &Context,
        camera: usize,
        at: Pixel,
        radius: f64,
    ) -> Option<Edge> {
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
        // A tool for vertical lines ignores flat edges.
        let plumb = self.editor.tool_kind().is_some_and(|kind| kind.row().is_upright());
        let edge = edges::edge_at(self.edges.of(ctx, name, &picture.image), at, radius)?;
        let [a, b] = edge;
        (!plumb || (a.v - b.v).abs() > (a.u - b.u).abs()).then_some(edge)
    }
}

impl App {
    /// Returns lens, focal length in pixels and mount of a fisheye camera. While the pose is unknown, the
    /// mount is the ceiling.
    fn fisheye(&self, camera: usize) -> Option<(Lens, f64, Mount)> {
        let session = self.editor.session();
        let pose = session.solved.pose(camera);
        let lens = hit::lens_of(&session.site, camera, pose).filter(|lens| lens.distortion.is_wide())?;
        let mount = pose.map_or(Mount::Ceiling, |pose| Mount::from_pitch(pose.pitch));
        Some((lens, pose.map_or(lens.focal, |pose| pose.focal), mount))
    }

    /// Whether a camera has a fisheye lens, whose image can be shown through virtual views.
    #[must_use]
    pub fn is_fisheye(&self, camera: usize) -> bool {
        self.fisheye(camera).is_some()
    }

    /// Returns the virtual view through which a fisheye image is shown; `None` for other lenses and for the
    /// raw image.
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

    /// Shows the current fisheye image through another virtual view, zoomed to fit.
    pub(crate) fn look(&mut self, looking: Looking) {
        self.view.looking = looking;
        let own = Pane::Image(self.editor.session().camera);
        self.view.panes.views.remove(&(Place::Main, own));
    }

    /// Points the virtual view of the current fisheye image at a raw pixel.
    pub(crate) fn look_at(&mut self, pixel: Pixel) {
        let camera = self.editor.session().camera;
        let Some((lens, focal, _)) = self.fisheye(camera) else { return };
        if let Some([x, y, z]) = lens.bearing(pixel) {
            self.look(Looking::Toward([x / focal, y / focal, z]));
        }
    }
}

impl App {
    /// Returns the size of uncertainty ellipses in all views.
    #[must_use]
    pub const fn ellipse_size(&self) -> EllipseSize {
        EllipseSize { is_magnified: self.view.magnified }
    }

    /// Returns the annotation that is suggested next for the current camera. `None` without a suggestion, or if
    /// suggestions are hidden. If the floor error of the camera is already small, only a known size is suggested.
    #[must_use]
    pub fn proposal(&self) -> Option<&SuggestionEntry> {
        /// Relative floor error below which no more lines are suggested.
        const GOOD: f64 = 0.015;
        let solution = self.editor.session().solution()?;
        let next = self.editor.session().suggestion();
        let rel = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
        let is_needed = |next: &&SuggestionEntry| {
            rel.is_none_or(|rel| rel >= GOOD) || next.drawing == Some(SuggestedAnnotation::KnownSize)
        };
        next.filter(|next| self.view.layers.suggestion && is_needed(next))
    }

    /// Returns detected edges of the current image that match the suggestion; none during a gesture.
    #[must_use]
    pub fn suggested(&mut self, ctx: &Context) -> Vec<Edge> {
        let Some(next) = self.proposal().cloned() else { return Vec::new() };
        let session = self.editor.session();
        let (Some(entry), Some(&pose)) = (session.entry(), session.pose()) else { return Vec::new() };
        let (entry, name) = (entry.clone(), entry.image.clone().unwrap_or_default());
        let Some(picture) = self.pictures.ready(&name).filter(|_| self.editor.tool().is_idle()) else {
            return Vec::new();
        };
        suggest::edges_for_suggestion(&next, &pose, &entry, self.edges.of(ctx, &name, &picture.image))
    }

    /// Returns the suggested edge within `radius` raw pixels of a pixel, while the tool of the suggestion is
    /// active.
    pub(crate) fn suggested_under(&mut self, ctx: &Context, at: Pixel, radius: f64) -> Option<Edge> {
        let kind = self.proposal()?.kind;
        if kind.is_none() || self.editor.tool_kind() != kind {
            return None;
        }
        let edges = self.suggested(ctx);
        edges.into_iter().find(|&[a, b]| hit::distance_to_segment(a, b, at) <= radius)
    }
}

impl App {
    /// Returns the automatic calibration of the current image, if the mode shows the image.
    #[must_use]
    pub fn shown_proposal(&self) -> Option<&PendingCalibration> {
        self.editor.session().proposed().filter(|_| self.view.mode == Mode::Image)
    }

    /// Whether Enter and Escape apply to the automatic calibration: no gesture is active and no widget has the
    /// focus.
    pub(crate) fn decides_proposal(&self, ctx: &Context) -> bool {
        self.shown_proposal().is_some()
            && self.editor.tool().is_idle()
            && ctx.memory(|memory| memory.focused().is_none())
    }
}

/// Whether the system of this build supports a command.
#[must_use]
pub(crate) fn is_offered(command: Command) -> bool {
    Here::HAS_ADDRESSES || command != Command::AddFromAddress
}
