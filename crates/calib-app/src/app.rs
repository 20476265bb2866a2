//! The app's state, and the order of a frame.

use std::path::{Path, PathBuf};

use calib_core::{Annotation, Camera, LensEntry, Plan, PlanPixel, Site, SiteCamera};
use egui::{Color32, Context, Painter, Rect, Ui};

use crate::canvas::Mapping;
use crate::command;
use crate::dialog::{Chosen, Dialog, Purpose};
use crate::edges::{self, Edge, Edges};
use crate::files::{self, Autosave, Found, Images};
use crate::overlay::Layers;
use crate::pane::{Panes, Place};
use crate::panels;
use crate::picture::Pictures;
use crate::scene3d::Orbit;
use crate::session::Session;
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

/// A still that was read to become a camera: its name in the site, what to call it, its size.
type NewStill = Result<(String, String, [u32; 2]), String>;

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
    /// Opacity of images on the plan.
    pub opacity: f32,
    /// Images of all cameras lie on the plan.
    pub blend: bool,
    /// Fields are filled on the plan.
    pub coverage: bool,
    /// Lengths are shown in feet.
    pub feet: bool,
    /// Poses before the joint solve are shown beside the new ones.
    pub show_before: bool,
    /// From where the scene is looked at.
    pub orbit: Option<Orbit>,
    /// The line whose row is under the cursor.
    pub lit: Option<(usize, usize)>,
    /// When the suspect changed, for its blinking, in seconds.
    pub suspect_since: f64,
    suspect: Option<(usize, usize, usize)>,
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
    /// Work of a crashed session, offered.
    pub found: Option<Found>,
    /// The still that was replaced: its camera, its name, how much of it shows.
    pub old_still: Option<(usize, String, f32)>,
    /// A saved version to compare with.
    pub compared: Option<Site>,
    /// How files are asked for.
    pub chooser: fn(Purpose) -> Dialog,
    autosave: Option<Autosave>,
    kept: u64,
    dialog: Option<Dialog>,
    picture: Option<std::sync::mpsc::Receiver<std::sync::Arc<egui::ColorImage>>>,
    adding: Vec<Task<NewStill>>,
    replacing: Option<(usize, Task<NewStill>)>,
    planning: Option<Task<NewStill>>,
}

impl App {
    /// The app with nothing open; what a crashed session left in `folder` is offered.
    #[must_use]
    pub fn new(ctx: &Context, folder: Option<PathBuf>) -> Self {
        theme::install(ctx);
        let autosave = folder.map(|folder| Autosave::new(folder.join("autosave")));
        let found = autosave.as_ref().and_then(Autosave::find);
        Self {
            session: Session::new(Site::new(), Images::default(), None),
            tool: (TOOLS[0].make)(),
            tool_row: 0,
            mode: Mode::Image,
            panes: Panes::default(),
            pictures: Pictures::default(),
            edges: Edges::default(),
            layers: Layers::default(),
            opacity: 0.8,
            blend: false,
            coverage: true,
            feet: false,
            show_before: true,
            orbit: None,
            lit: None,
            suspect_since: 0.0,
            suspect: None,
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
            autosave,
            kept: 0,
            dialog: None,
            picture: None,
            adding: Vec::new(),
            replacing: None,
            planning: None,
        }
    }

    /// Opens a site in place of the one that is open.
    pub fn open_site(&mut self, site: Site, images: Images, path: Option<PathBuf>) {
        self.session = Session::new(site, images, path);
        self.pictures.clear();
        self.edges.clear();
        self.panes = Panes::default();
        self.orbit = None;
        self.kept = 0;
        (self.compared, self.error) = (None, None);
        self.take_tool(0);
    }

    /// Opens a site file; what is wrong with it is shown.
    pub fn open_path(&mut self, path: &Path) {
        match files::open(path) {
            Ok((site, images)) => self.open_site(site, images, Some(path.to_path_buf())),
            Err(error) => self.error = Some(error),
        }
    }

    /// Goes on with what a crashed session left.
    pub fn recover(&mut self) {
        if let Some(found) = self.found.take() {
            self.open_site(found.site, found.images, found.path);
            // It differs from its file.
            self.session.generation = 1;
            self.kept = 1;
        }
    }

    /// Forgets what a crashed session left.
    pub fn discard_found(&mut self) {
        self.found = None;
        if let Some(autosave) = &self.autosave {
            autosave.forget();
        }
    }

    /// Saves to the site's own file.
    pub fn save(&mut self) {
        let Some(path) = self.session.path.clone() else { return };
        let solved = self.session.solved.write_into(&self.session.site);
        match files::save(&path, &solved, &self.session.images) {
            Ok(()) => {
                // From now on images are looked for beside the file.
                let folder = path.parent().map(Path::to_path_buf);
                if let Some(folder) = folder.filter(|f| self.session.images.folder.as_ref() != Some(f)) {
                    self.session.rebase(&folder);
                    self.pictures.clear();
                }
                self.session.saved = self.session.generation;
                self.session.note = Some(format!("Saved {}.", path.display()));
                if let Some(autosave) = &self.autosave {
                    autosave.forget();
                }
                self.kept = self.session.generation;
            }
            Err(error) => self.error = Some(error),
        }
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

    /// The edge of a camera's image under a pixel, while a tool that draws lines is in the hand.
    pub fn offer(
        &mut self,
        ctx: &Context,
        camera: usize,
        at: calib_core::Pixel,
        radius: f64,
    ) -> Option<Edge> {
        let draws = self.tool_kind().is_some_and(|kind| kind != calib_core::Kind::Straight);
        if !draws || !self.layers.edges {
            return None;
        }
        let name = self.session.site.cameras.get(camera)?.image.as_deref()?;
        let picture = self.pictures.ready(name)?;
        // What stands upright is not offered what lies flat.
        let plumb = self
            .tool_kind()
            .is_some_and(|kind| matches!(kind, calib_core::Kind::Vertical | calib_core::Kind::Upright));
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
        let was_open = self.palette.is_open() || self.shortcuts || self.about || self.error.is_some();
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

    /// Changes what is known of the lens of the camera in hand.
    pub fn with_lens(&mut self, name: &str, change: impl FnOnce(&mut LensEntry)) {
        let empty = LensEntry {
            focal_px: None,
            roll_deg: None,
            pitch_deg: None,
            principal_point_px: None,
            distortion: None,
            like: None,
        };
        if let Some(entry) = self.session.entry_mut() {
            change(entry.lens.get_or_insert_with(|| empty.clone()));
            entry.lens.take_if(|lens| *lens == empty);
            self.session.commit(name);
        }
    }

    /// Adds the copied annotations to the camera in hand, scaled to its image.
    pub fn paste_lines(&mut self) {
        let Some((copied, from)) = self.copied.clone() else { return };
        let Some(entry) = self.session.entry_mut() else { return };
        let ratio = [0, 1].map(|axis| f64::from(entry.size_px[axis]) / f64::from(from[axis].max(1)));
        let id = entry.id.clone();
        for mut annotation in copied {
            scale(&mut annotation, ratio);
            annotation.id.take_if(|id| entry.annotations.iter().any(|known| known.id.as_ref() == Some(id)));
            entry.annotations.push(annotation);
        }
        self.session.commit(format!("paste annotations onto {id}"));
    }

    /// Gives the camera in hand another id, everywhere.
    pub fn rename_camera(&mut self, id: &str) {
        let session = &mut self.session;
        if id.is_empty() || session.site.cameras.iter().any(|camera| camera.id == id) {
            session.note = Some("Every camera needs an id of its own.".into());
            return;
        }
        let Some(entry) = session.entry_mut() else { return };
        let old = std::mem::replace(&mut entry.id, id.to_owned());
        let links =
            session.site.links.iter_mut().flat_map(|link| &mut link.seen).map(|seen| &mut seen.camera);
        let marks =
            session.site.marks.iter_mut().flat_map(|mark| &mut mark.seen).map(|seen| &mut seen.camera);
        let like = session.site.cameras.iter_mut().filter_map(|camera| camera.lens.as_mut()?.like.as_mut());
        for name in links.chain(marks).chain(like).filter(|name| **name == old) {
            id.clone_into(name);
        }
        session.commit(format!("rename {old}"));
    }

    /// Removes the camera in hand and what refers to it.
    pub fn remove_camera(&mut self) {
        let session = &mut self.session;
        if session.camera >= session.site.cameras.len() {
            return;
        }
        let id = session.site.cameras.remove(session.camera).id;
        for link in &mut session.site.links {
            link.seen.retain(|seen| seen.camera != id);
        }
        session.site.links.retain(|link| !link.seen.is_empty());
        for mark in &mut session.site.marks {
            mark.seen.retain(|seen| seen.camera != id);
        }
        for camera in &mut session.site.cameras {
            if let Some(lens) = &mut camera.lens {
                lens.like.take_if(|like| *like == id);
            }
        }
        session.selection.clear();
        session.camera = session.camera.min(session.site.cameras.len().saturating_sub(1));
        session.commit(format!("remove {id}"));
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
        self.poll_dialog(ctx);
        self.poll_stills();
        self.take_dropped(ctx);
        self.poll_picture();
        for (command, modifiers) in command::pressed(ctx) {
            command::run(self, ctx, command, modifiers);
        }
    }

    /// One frame.
    pub fn show_ui(&mut self, ui: &mut Ui) {
        self.logic(&ui.ctx().clone());
        self.session.solve();
        self.watch_suspect(ui);
        self.panes.rects.clear();
        panels::show(self, ui);
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
        let Some(autosave) = &self.autosave else { return };
        // Undo to what is saved leaves nothing to lose, but the file tells no tale of it: keep it all the same.
        let site = self.session.history.site();
        if let Err(error) = autosave.keep(&site, &self.session.images, self.session.path.as_deref()) {
            self.error = Some(format!("Autosave: {error}"));
        }
    }

    fn poll_dialog(&mut self, ctx: &Context) {
        let Some(dialog) = &mut self.dialog else { return };
        let Some(chosen) = dialog.poll() else {
            ctx.request_repaint_after(std::time::Duration::from_millis(100));
            return;
        };
        let purpose = dialog.purpose;
        self.dialog = None;
        for file in chosen {
            self.take_file(ctx, purpose, file);
        }
    }

    fn take_file(&mut self, ctx: &Context, purpose: Purpose, file: Chosen) {
        match (purpose, file.path.clone()) {
            (Purpose::OpenSite, Some(path)) => self.open_path(&path),
            (Purpose::OpenSite, None) => {
                let text = file.bytes.and_then(|bytes| String::from_utf8(bytes).ok()).unwrap_or_default();
                match files::parse(&text, None) {
                    Ok((site, images)) => self.open_site(site, images, None),
                    Err(error) => self.error = Some(format!("{}: {error}", file.name)),
                }
            }
            (Purpose::SaveSite, Some(path)) => {
                self.session.path = Some(path);
                self.save();
            }
            (Purpose::Compare, Some(path)) => match files::open(&path) {
                Ok((site, _)) => self.compared = Some(site),
                Err(error) => self.error = Some(error),
            },
            (Purpose::AddImages, _) => self.add_still(ctx, file),
            (Purpose::LoadPlan, _) => self.planning = Some(self.read_still(ctx, file)),
            (Purpose::ReplaceStill, _) => {
                self.replacing = Some((self.session.camera, self.read_still(ctx, file)));
            }
            (Purpose::SaveSite | Purpose::Compare, None) => {}
        }
    }

    /// Begins to read a still that becomes a camera.
    pub fn add_still(&mut self, ctx: &Context, file: Chosen) {
        let task = self.read_still(ctx, file);
        self.adding.push(task);
    }

    fn read_still(&mut self, ctx: &Context, file: Chosen) -> Task<NewStill> {
        let title = Path::new(&file.name)
            .file_stem()
            .map_or_else(|| file.name.clone(), |stem| stem.to_string_lossy().into_owned());
        let name = match (&file.path, file.bytes) {
            (Some(path), _) => path.to_string_lossy().into_owned(),
            (None, Some(bytes)) => {
                let mime =
                    if file.name.to_lowercase().ends_with(".png") { "image/png" } else { "image/jpeg" };
                self.session.images.store(bytes.into(), mime)
            }
            (None, None) => file.name.clone(),
        };
        let read = self.session.images.reader(&name);
        Task::spawn(ctx, move || {
            let size = crate::picture::decode(&read()?)?.dimensions().into();
            Ok((name, title, size))
        })
    }

    fn poll_stills(&mut self) {
        let mut done = Vec::new();
        self.adding.retain(|task| task.poll().map(|result| done.push(result)).is_none());
        let was_empty = self.session.site.cameras.is_empty();
        // Threads finish in any order; names come in theirs.
        done.sort_by(|a, b| a.as_ref().map(|s| &s.1).ok().cmp(&b.as_ref().map(|s| &s.1).ok()));
        for still in done {
            match still {
                Ok((image, title, size)) => self.add_camera(image, &title, size),
                Err(error) => self.error = Some(error),
            }
        }
        if was_empty && !self.session.site.cameras.is_empty() {
            self.session.camera = 0;
        }
        if let Some((camera, task)) = self.replacing.take() {
            match task.poll() {
                None => self.replacing = Some((camera, task)),
                Some(Ok((image, _, size))) => self.replace_still(camera, image, size),
                Some(Err(error)) => self.error = Some(error),
            }
        }
        if let Some(task) = self.planning.take() {
            match task.poll() {
                None => self.planning = Some(task),
                Some(Ok((image, _, size))) => self.set_plan(image, size),
                Some(Err(error)) => self.error = Some(error),
            }
        }
    }

    fn add_camera(&mut self, image: String, title: &str, size: [u32; 2]) {
        let site = &mut self.session.site;
        let taken = |id: &str| site.cameras.iter().any(|camera| camera.id == id);
        let id = std::iter::once(title.to_owned())
            .chain((2..).map(|number| format!("{title}-{number}")))
            .find(|id| !taken(id))
            .unwrap_or_default();
        site.cameras.push(SiteCamera { image: Some(image), ..SiteCamera::new(id.clone(), size) });
        self.session.commit(format!("add {id}"));
    }

    /// Another still of one camera: annotations stay; on an image of another size they are rescaled.
    fn replace_still(&mut self, camera: usize, image: String, size: [u32; 2]) {
        let Some(entry) = self.session.site.cameras.get_mut(camera) else { return };
        if entry.size_px != size {
            let ratio = [0, 1].map(|axis| f64::from(size[axis]) / f64::from(entry.size_px[axis].max(1)));
            for annotation in &mut entry.annotations {
                scale(annotation, ratio);
            }
            let points = entry.efov_px.iter_mut().flatten();
            for pixel in points.chain(entry.control_points.iter_mut().map(|point| &mut point.px)) {
                (pixel.u, pixel.v) = (pixel.u * ratio[0], pixel.v * ratio[1]);
            }
            self.session.note = Some("Annotations were rescaled to the new size.".into());
        }
        let Some(entry) = self.session.site.cameras.get_mut(camera) else { return };
        let old = entry.image.replace(image);
        entry.size_px = size;
        let id = entry.id.clone();
        self.old_still = old.map(|old| (camera, old, 0.5));
        self.session.commit(format!("replace the still of {id}"));
    }

    fn set_plan(&mut self, image: String, size: [u32; 2]) {
        let plan = Plan {
            image: Some(image),
            metres_per_px: self.session.site.plan.as_ref().map_or(0.02, |plan| plan.metres_per_px),
            origin_px: PlanPixel::new(0.0, f64::from(size[1])),
            x_axis_deg: 0.0,
            georeference: None,
        };
        self.session.site.plan = Some(plan);
        self.session.commit("load a plan");
        self.show(Mode::Plan);
        self.panes.views.clear();
        let measure = TOOLS.iter().position(|tool| tool.title == "Measure plan").unwrap_or(0);
        self.take_tool(measure);
    }

    fn take_dropped(&mut self, ctx: &Context) {
        let dropped = ctx.input(|i| i.raw.dropped_files.clone());
        for file in dropped {
            self.take_path(ctx, file.path().to_path_buf());
        }
    }

    /// Takes what was dropped or named: a site, an image, or a folder of images.
    pub fn take_path(&mut self, ctx: &Context, path: PathBuf) {
        let is_site = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
        if is_site {
            self.open_path(&path);
            return;
        }
        let images = if files::is_image(&path) { vec![path] } else { files::images_in(&path) };
        for path in images {
            let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            self.add_still(ctx, Chosen { name, path: Some(path), bytes: None });
        }
    }

    /// Asks for a picture of the window.
    pub fn take_picture(&mut self, ctx: &Context) {
        let (sender, picture) = std::sync::mpsc::channel();
        let again = ctx.clone();
        ctx.request_screenshot(move |image| {
            // Nobody waits any more when the receiver is gone.
            let _ = sender.send(image);
            again.request_repaint();
        });
        self.picture = Some(picture);
    }

    fn poll_picture(&mut self) {
        let Some(image) = self.picture.as_ref().and_then(|picture| picture.try_recv().ok()) else { return };
        self.picture = None;
        let [w, h] = image.size.map(|side| side as u32);
        let rgba: Vec<u8> = image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
        let mut png = std::io::Cursor::new(Vec::new());
        let written = image::RgbaImage::from_raw(w, h, rgba)
            .ok_or_else(|| "the window has no size".to_owned())
            .and_then(|image| {
                image.write_to(&mut png, image::ImageFormat::Png).map_err(|error| error.to_string())
            });
        let folder = self.session.path.as_deref().and_then(Path::parent).map(Path::to_path_buf);
        let path = folder.or_else(files::data_dir).unwrap_or_default().join("calib-view.png");
        match written.and_then(|()| files::write(&path, png.get_ref())) {
            Ok(()) => self.session.note = Some(format!("Saved {}.", path.display())),
            Err(error) => self.error = Some(error),
        }
    }
}

fn scale(annotation: &mut Annotation, ratio: [f64; 2]) {
    let segments = annotation.segments.iter_mut().flatten().flatten();
    let points = annotation.points.iter_mut().flatten();
    for pixel in segments.chain(points).chain(&mut annotation.foot).chain(&mut annotation.head) {
        (pixel.u, pixel.v) = (pixel.u * ratio[0], pixel.v * ratio[1]);
    }
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        self.show_ui(ui);
    }
}
