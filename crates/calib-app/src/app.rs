//! The app's state, and the order of a frame.

use std::path::PathBuf;

use calib_core::{Annotation, Camera, PlanPixel, Site, SiteCamera};
use egui::{Color32, Context, Painter, Rect, Ui};

use crate::canvas::{Mapping, View};
use crate::claim::Claim;
use crate::command;
use crate::dialog::{Chosen, Dialog, Purpose};
use crate::document::Slots;
use crate::edges::{self, Edge, Edges};
use crate::files::{Autosave, Found, Images};
use crate::hit::Part;
use crate::overlay::Layers;
use crate::pane::{Panes, Place};
use crate::panels;
use crate::picture::{Pictures, Piece};
use crate::plan::Planning;
use crate::refine::Refining;
use crate::scene3d::Orbit;
use crate::session::Session;
use crate::shelf::{Shelf, Work};
use crate::stills::{NewStill, OldStill};
use crate::task::Task;
use crate::theme;
use crate::tools::{Pane, TOOLS, Tool};

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

/// The whole app.
#[derive(Debug)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch on screen")]
pub struct App {
    /// The open site.
    pub session: Session,
    /// The tool in hand.
    pub tool: Box<dyn Tool>,
    /// Its row in the list.
    pub tool_row: usize,
    /// What the middle shows.
    pub mode: Mode,
    /// How canvases are looked at.
    pub panes: Panes,
    /// Decoded stills.
    pub pictures: Pictures,
    /// Straight edges of the stills.
    pub edges: Edges,
    /// What lies on images.
    pub layers: Layers,
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
    /// What other programs take.
    pub export: panels::export::Sheet,
    /// Poses before the joint solve are shown beside the new ones.
    pub show_before: bool,
    /// From where the scene is looked at.
    pub orbit: Option<Orbit>,
    /// The line whose row is under the cursor.
    pub lit: Option<(usize, usize)>,
    /// When the suspect changed, for its blinking, in seconds.
    pub suspect_since: f64,
    suspect: Option<(usize, usize, usize)>,
    /// What else fits the camera of this index as well.
    pub family: Option<(usize, crate::family::Family)>,
    /// The two are shown side by side.
    pub compares_views: bool,
    /// A field for text had the focus when the last frame ended.
    was_typing: bool,
    /// The command palette.
    pub palette: panels::palette::Palette,
    /// How far a newcomer has come.
    pub tour: panels::tour::Tour,
    /// The shortcut sheet is open.
    pub shortcuts: bool,
    /// The about sheet is open.
    pub about: bool,
    /// Between which links or marks the next distance is measured.
    pub pair: [String; 2],
    /// How the list of cameras is filtered and sorted.
    pub list: panels::cameras::List,
    /// Annotations that were copied, with the size of their image.
    pub copied: Option<(Vec<Annotation>, [u32; 2])>,
    /// An error that concerns the document, until it is closed.
    pub error: Option<String>,
    /// Work of crashed sessions, offered, each with where it is kept.
    pub found: Vec<(Autosave, Found)>,
    /// The still that was replaced.
    pub old_still: Option<OldStill>,
    /// A saved version to compare with.
    pub compared: Option<Site>,
    /// How files are asked for.
    pub chooser: fn(Purpose) -> Dialog,
    /// Where a browser keeps sites.
    pub shelf: Option<Box<dyn Shelf>>,
    pub(crate) arriving: Vec<Task<Vec<Chosen>>>,
    pub(crate) autosave: Option<Autosave>,
    /// Where autosaves are.
    pub(crate) folder: Option<PathBuf>,
    /// The autosaves that no other window touches while this one lives.
    pub(crate) claims: Vec<(PathBuf, Claim)>,
    pub(crate) kept: u64,
    pub(crate) dialog: Option<Dialog>,
    pub(crate) picture: Option<std::sync::mpsc::Receiver<std::sync::Arc<egui::ColorImage>>>,
    pub(crate) pictured: Option<Vec<u8>>,
    pub(crate) adding: Vec<Task<NewStill>>,
    /// The id of the camera whose still is asked for, or read.
    pub(crate) replaced: String,
    pub(crate) replacing: Option<Task<NewStill>>,
    pub(crate) planning: Option<Planning>,
    pub(crate) refining: Option<Refining>,
}

impl App {
    /// The app with nothing open; what a crashed session left in `folder` is offered.
    #[must_use]
    pub fn new(ctx: &Context, folder: Option<PathBuf>) -> Self {
        theme::install(ctx);
        let Slots { found, autosave, claims } = Slots::of(folder.as_deref());
        Self {
            session: Session::new(Site::new(), Images::default(), None),
            tool: (TOOLS[0].make)(),
            tool_row: 0,
            mode: Mode::Image,
            panes: Panes::default(),
            pictures: Pictures::default(),
            edges: Edges::default(),
            layers: Layers::default(),
            beside_plan: true,
            beside_scene: false,
            blend: false,
            coverage: true,
            above: true,
            export: panels::export::Sheet::default(),
            show_before: true,
            orbit: None,
            lit: None,
            suspect_since: 0.0,
            suspect: None,
            family: None,
            compares_views: false,
            was_typing: false,
            palette: panels::palette::Palette::default(),
            tour: panels::tour::Tour::default(),
            shortcuts: false,
            about: false,
            pair: Default::default(),
            list: panels::cameras::List::default(),
            copied: None,
            error: None,
            found,
            old_still: None,
            compared: None,
            chooser: Dialog::open,
            shelf: None,
            arriving: Vec::new(),
            autosave,
            folder,
            claims,
            kept: 0,
            dialog: None,
            picture: None,
            pictured: None,
            adding: Vec::new(),
            replaced: String::new(),
            replacing: None,
            planning: None,
            refining: None,
        }
    }

    /// Whether something was asked for that changes the site when it comes.
    fn awaits(&self) -> bool {
        self.waiting() > 0 || self.dialog.is_some() || self.refining.is_some() || !self.arriving.is_empty()
    }

    /// Opens a site in place of the one that is open.
    pub fn open_site(&mut self, site: Site, images: Images, path: Option<PathBuf>) {
        self.put_aside();
        let (units, snap) = (self.session.units, self.session.snap);
        self.session = Session::new(site, images, path);
        (self.session.units, self.session.snap) = (units, snap);
        if let Some(shelf) = &mut self.shelf {
            shelf.begin();
        }
        self.pictures.clear();
        self.edges.clear();
        self.panes = Panes::default();
        self.orbit = None;
        self.kept = 0;
        (self.compared, self.error, self.family) = (None, None, None);
        // Nothing that was asked for the old site lands in the new one.
        self.adding.clear();
        (self.replacing, self.planning, self.refining, self.dialog) = (None, None, None, None);
        (self.picture, self.pictured, self.old_still) = (None, None, None);
        (self.export, self.tour) = (panels::export::Sheet::default(), panels::tour::Tour::default());
        self.compares_views = false;
        self.take_tool(0);
    }

    /// Asks for files.
    pub fn ask(&mut self, purpose: Purpose) {
        self.dialog = Some((self.chooser)(purpose));
    }

    /// Puts a tool in the hand.
    pub fn take_tool(&mut self, index: usize) {
        self.cancel();
        if let Some(row) = TOOLS.get(index) {
            (self.tool, self.tool_row) = ((row.make)(), index);
        }
    }

    /// The kind of annotation that the tool in hand draws.
    #[must_use]
    pub fn tool_kind(&self) -> Option<calib_core::Kind> {
        TOOLS.get(self.tool_row)?.kind
    }

    /// Looks at a part of the image in hand so that it fills a good deal of the canvas.
    pub fn reveal(&mut self, part: Part) {
        let camera = self.session.camera;
        let key = (Place::Main, Pane::Image(camera));
        let parts = crate::edit::points_of(&self.session.site, camera, &[part].into());
        let site = &mut self.session.site;
        let points: Vec<[f64; 2]> = parts
            .into_iter()
            .filter_map(|part| crate::edit::pixel_mut(site, camera, part).map(|pixel| (*pixel).into()))
            .collect();
        let Some(mapping) = self.panes.mapping(key.0, key.1).filter(|_| !points.is_empty()) else { return };
        let points: Vec<[f64; 2]> = points.into_iter().map(|at| mapping.flat(at)).collect();
        let low = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let margin = 0.5 * (high(0) - low(0)).max(high(1) - low(1)).max(20.0);
        let (low, high) = ([low(0) - margin, low(1) - margin], [high(0) + margin, high(1) + margin]);
        self.panes.views.insert(key, View::of(low, high, mapping.rect, false, false));
    }

    /// The edge of a camera's image under a pixel, while a tool that draws lines is in the hand.
    pub fn offer(
        &mut self,
        ctx: &Context,
        camera: usize,
        at: calib_core::Pixel,
        radius: f64,
    ) -> Option<Edge> {
        let draws = self.tool_kind().is_some_and(|kind| kind.row().shape != calib_core::Shape::Polyline);
        if !draws || !self.layers.edges {
            return None;
        }
        let name = self.session.site.cameras.get(camera)?.image.as_deref()?;
        let picture = self.pictures.ready(name)?;
        // What stands upright is not offered what lies flat.
        let plumb = self.tool_kind().is_some_and(|kind| kind.row().is_upright());
        let edge = edges::under(self.edges.of(ctx, name, &picture.image), at, radius)?;
        let [a, b] = edge;
        (!plumb || (a.v - b.v).abs() > (a.u - b.u).abs()).then_some(edge)
    }

    /// Ends a gesture that is under way; the site is as it was before it.
    pub fn cancel(&mut self) {
        self.tool.cancel();
        self.session.revert();
        self.session.solve();
    }

    /// Begins to improve all cameras together.
    pub(crate) fn refine(&mut self, ctx: &Context) {
        if self.refining.is_none() {
            self.refining = Some(Refining::begin(ctx, &self.session.site));
        }
    }

    fn poll_refining(&mut self) {
        let Some(refining) = self.refining.take() else { return };
        match refining.poll() {
            Some(Ok(refined)) => self.session.take_refined(&refining.from, &refined),
            Some(Err(error)) => self.complain(format!("Refining stopped: {error}")),
            None => self.refining = Some(refining),
        }
    }

    /// Shows another view.
    pub fn show(&mut self, mode: Mode) {
        // A control point that waits for the plan waits through this.
        if !self.session.history.is_at(&self.session.site) {
            self.cancel();
        }
        self.mode = mode;
    }

    /// Closes what is open above the window. Whether anything was.
    pub fn close_sheets(&mut self) -> bool {
        let exported = self.export.close();
        let was_open =
            exported || self.palette.is_open() || self.shortcuts || self.about || self.error.is_some();
        self.palette.close();
        (self.shortcuts, self.about, self.error) = (false, false, None);
        was_open
    }

    /// The canvas that zoom keys mean.
    #[must_use]
    pub fn zoom_key(&self) -> (Place, Pane) {
        let own = Pane::Image(self.session.camera);
        match (self.mode, self.panes.active) {
            (Mode::Image, _) => (Place::Main, own),
            (Mode::Plan, None) => (Place::Half, own),
            (_, None) => (Place::Tile, own),
            (_, Some(active)) => active,
        }
    }

    /// The floor that is worth looking at, in metres.
    #[must_use]
    pub fn floor_bounds(&self) -> [[f64; 2]; 2] {
        let session = &self.session;
        let count = session.site.cameras.len();
        let fields = (0..count).filter_map(|i| session.solved.solution(i)).flat_map(|s| &s.efov_m);
        let feet = (0..count).filter_map(|i| session.solved.pose(i)).map(|pose| pose.position.on_floor());
        let points: Vec<[f64; 2]> =
            fields.copied().chain(feet).chain(self.plan_corners()).map(Into::into).collect();
        if points.is_empty() {
            return [[-5.0, -2.0], [5.0, 10.0]];
        }
        let low = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let margin = 0.06 * (high(0) - low(0)).hypot(high(1) - low(1));
        [[low(0) - margin, low(1) - margin], [high(0) + margin, high(1) + margin]]
    }

    /// Where the corners of the plan's picture lie on the floor.
    fn plan_corners(&self) -> Vec<calib_core::FloorPoint> {
        let name = self.session.site.plan.as_ref().and_then(|plan| plan.image.as_ref());
        let Some(picture) = name.and_then(|name| self.pictures.ready(name)) else { return Vec::new() };
        let [w, h] = picture.size().map(f64::from);
        let scale = crate::tools::plan_scale(&self.session.site);
        let corner = |[x, y]: [f64; 2]| scale.floor_from_plan(PlanPixel::new(x, y));
        [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(corner).to_vec()
    }

    /// Poses to be shown as ghosts: those before the gesture under way, of a compared version, or before Refine.
    #[must_use]
    pub fn poses_before(&self) -> Vec<Option<Camera>> {
        if !self.tool.is_idle() {
            return self.session.settled().to_vec();
        }
        if let Some(compared) = self.compared.as_ref().filter(|_| self.show_before) {
            let pose = |camera: &SiteCamera| compared.camera(&camera.id).and_then(SiteCamera::camera);
            return self.session.site.cameras.iter().map(pose).collect();
        }
        self.session.before_refine.clone().filter(|_| self.show_before).unwrap_or_default()
    }

    /// Starts decoding of the plan.
    pub fn ask_for_plan(&mut self, ctx: &Context) {
        let name = self.session.site.plan.as_ref().and_then(|plan| plan.image.clone());
        if let Some(name) = name {
            let images = &self.session.images;
            self.pictures.get(ctx, &name, || images.reader(&name));
        }
    }

    /// The plan's picture, in pieces, as sharp as it is.
    pub fn plan_pieces(&mut self, ctx: &Context) -> Vec<Piece> {
        let name = self.session.site.plan.as_ref().and_then(|plan| plan.image.clone());
        let Some(name) = name else { return Vec::new() };
        let images = &self.session.images;
        let picture = self.pictures.get(ctx, &name, || images.reader(&name));
        picture.map(|picture| picture.pieces(ctx)).unwrap_or_default()
    }

    /// Paints a still, or says why it is not there.
    pub fn paint_still(&mut self, painter: &Painter, name: Option<&str>, mapping: &Mapping, rect: Rect) {
        let Some(name) = name else { return };
        let images = &self.session.images;
        if let Some(picture) = self.pictures.get(painter.ctx(), name, || images.reader(name)) {
            picture.paint(painter, mapping, Color32::WHITE);
            return;
        }
        let (text, colour) = match self.pictures.error(name) {
            Some(error) => (error.to_owned(), theme::palette(painter.ctx()).bad),
            None => ("Loading the image\u{2026}".to_owned(), theme::palette(painter.ctx()).text3),
        };
        painter.text(rect.center(), egui::Align2::CENTER_CENTER, text, theme::regular(12.0), colour);
    }

    /// What is done before anything is shown: finished work, dropped files, keys.
    pub fn logic(&mut self, ctx: &Context) {
        self.pictures.begin_frame(ctx);
        // What comes in waits until the hand is empty: it would end the gesture that is under way.
        if self.tool.is_idle() && (!self.awaits() || self.session.history.is_at(&self.session.site)) {
            self.poll_dialog(ctx);
            self.poll_stills();
            self.poll_refining();
            self.poll_arrivals(ctx);
            self.poll_shelf();
        }
        self.poll_picture(ctx);
        for (command, modifiers) in command::pressed(ctx, self.was_typing) {
            command::run(self, ctx, command, modifiers);
        }
    }

    /// One frame.
    pub fn show_ui(&mut self, ui: &mut Ui) {
        self.logic(&ui.ctx().clone());
        self.session.solve();
        self.watch_suspect(ui);
        self.panes.begin_frame();
        panels::show(self, ui);
        self.was_typing = ui.ctx().text_edit_focused();
        self.remember();
    }

    /// A new suspect begins to blink.
    fn watch_suspect(&mut self, ui: &Ui) {
        let camera = self.session.camera;
        let suspect = self.session.solution().and_then(|solution| {
            let residual = solution.residuals.iter().find(|residual| residual.outlier)?;
            Some((camera, residual.annotation?, residual.segment?))
        });
        if suspect != self.suspect {
            self.suspect = suspect;
            self.suspect_since = ui.input(|i| i.time);
        }
    }

    /// Keeps every finished gesture where a crash does not reach it.
    fn remember(&mut self) {
        if self.kept == self.session.generation {
            return;
        }
        self.kept = self.session.generation;
        if self.autosave.is_none() && self.folder.is_some() && self.session.generation == 1 {
            self.session.note =
                Some("Not kept against a crash: nine unsaved sites wait already. Save it as a file.".into());
        }
        if let Some(shelf) = &mut self.shelf {
            let (site, session) = (self.session.history.site(), &self.session);
            let last = session.history.undo_name().unwrap_or_default();
            shelf.keep(Work { site: &site, images: &session.images, path: session.path.clone(), last });
        }
        let Some(autosave) = &self.autosave else { return };
        // Undo to what is saved leaves nothing to lose, but the file tells no tale of it: keep it all the same.
        let site = self.session.history.site();
        if let Err(error) = autosave.keep(&site, &self.session.images, self.session.path.as_deref()) {
            self.error = Some(format!("Autosave: {error}"));
        }
    }
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        self.show_ui(ui);
    }
}
