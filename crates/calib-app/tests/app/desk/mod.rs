//! Simulated operator: pointer and keys on the app, and the resulting site.

use std::path::PathBuf;

use calib_app::App;
use calib_app::choice::Chosen;
use calib_app::command::{self, Command};
use calib_app::keys;
use calib_app::state::Place;
use calib_app::storage::dialog::Dialog;
use calib_app::storage::files::Images;
use calib_app::theme;
use calib_core::Pixel;
use calib_editor::{Action, Pane, TOOLS};
use calib_site::Site;
use calib_tests::Scratch;
use egui::{Context, Event, Key, Modifiers, PointerButton, Pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};

thread_local! {
    static ANSWER: std::cell::Cell<Option<PathBuf>> = const { std::cell::Cell::new(None) };
}

pub(crate) struct Desk {
    pub(crate) harness: Harness<'static, App>,
}

impl Desk {
    /// Opens a window of 1440 x 900 with a site whose images are missing.
    pub(crate) fn new(site: Site) -> Self {
        Self::with(site, Images::default())
    }

    /// Opens a window of 1440 x 900 with a site and its images, all of them permitted.
    pub(crate) fn with(site: Site, mut images: Images) -> Self {
        let names = calib_editor::image_names(&site);
        let files =
            names.iter().filter_map(|name| images.file(name)).filter_map(|file| file.canonicalize().ok());
        images.allowed = files.collect();
        let mut app = App::new(&Context::default(), None);
        app.dialogs.chooser = |purpose| Dialog::answered(purpose, Vec::new());
        app.open_site(site, images, None);
        let harness = Harness::builder()
            .with_size([1440.0, 900.0])
            .with_context_setup(theme::install)
            .build_ui_state(|ui, app: &mut App| app.show_ui(ui), app);
        let mut desk = Self { harness };
        desk.harness.run_steps(2);
        desk
    }

    /// Sets the answer of the next file chooser in this thread.
    pub(crate) fn answer(&mut self, path: Option<PathBuf>) {
        ANSWER.set(path);
        self.app().dialogs.chooser = |purpose| {
            let chosen = |path: PathBuf| Chosen {
                name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                path: Some(path),
                bytes: None,
            };
            Dialog::answered(purpose, ANSWER.take().map(chosen).into_iter().collect())
        };
    }

    pub(crate) fn app(&mut self) -> &mut App {
        self.harness.state_mut()
    }

    pub(crate) fn site(&self) -> &Site {
        self.harness.state().editor.site()
    }

    pub(crate) fn key(&mut self, key: Key) {
        self.keys(Modifiers::NONE, key);
    }

    pub(crate) fn keys(&mut self, modifiers: Modifiers, key: Key) {
        self.harness.key_press_modifiers(modifiers, key);
        self.harness.run_steps(2);
    }

    /// Runs a command of the app.
    pub(crate) fn tell(&mut self, command: Command) {
        let ctx = self.harness.ctx.clone();
        command::run(self.app(), &ctx, command, Modifiers::NONE);
        self.harness.run_steps(3);
    }

    /// Runs frames until a condition holds.
    pub(crate) fn wait(&mut self, is_done: impl Fn(&App) -> bool) {
        // The limit is generous, because other checks run on the same processors.
        const MAX_SECONDS: u64 = 300;
        let start = std::time::Instant::now();
        while !is_done(self.harness.state()) {
            self.harness.step();
            // Frames in a row would take the time that the work needs.
            std::thread::sleep(std::time::Duration::from_millis(5));
            assert!(start.elapsed().as_secs() < MAX_SECONDS, "{:?}", self.harness.state().editor.error());
        }
    }

    /// Refines all cameras jointly and waits for the result.
    pub(crate) fn refine(&mut self) {
        self.key(Key::F9);
        self.wait(|app| !app.is_working());
        self.harness.step();
    }

    pub(crate) fn undo(&mut self) {
        self.keys(Modifiers::COMMAND, Key::Z);
    }

    pub(crate) fn redo(&mut self) {
        self.keys(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    }

    /// Selects the tool with a title by its key.
    pub(crate) fn take(&mut self, title: &str) {
        let index = TOOLS.iter().position(|tool| tool.title == title).expect("a tool of this title");
        self.take_tool(index);
    }

    /// Selects a tool by its key, or by its command if it has no key.
    pub(crate) fn take_tool(&mut self, index: usize) {
        match TOOLS[index].key {
            Some(key) => self.key(keys::key(key)),
            None => self.tell(Command::Tool(index)),
        }
    }

    /// Returns the screen position of a point in a pane.
    pub(crate) fn screen(&self, pane: Pane, at: [f64; 2]) -> Pos2 {
        let panes = &self.harness.state().view.panes;
        let places = [Place::Main, Place::Half, Place::Tile];
        let shown = places.into_iter().find_map(|place| panes.mapping(place, pane));
        shown.expect("a pane that is shown").screen(at)
    }

    fn button(&mut self, pos: Pos2, pressed: bool, modifiers: Modifiers) {
        self.harness.event_modifiers(
            Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers },
            modifiers,
        );
    }

    /// Returns all text on screen, as screen readers get it.
    pub(crate) fn words(&self) -> Vec<String> {
        let nodes = self.harness.query_all_by(|_| true);
        let said = nodes.flat_map(|node| {
            let node = node.accesskit_node();
            [node.label(), node.value()]
        });
        said.flatten().collect()
    }

    /// Presses the primary button and keeps it down.
    pub(crate) fn press(&mut self, pos: Pos2, modifiers: Modifiers) {
        self.button(pos, true, modifiers);
    }

    /// Releases the primary button.
    pub(crate) fn release(&mut self, pos: Pos2, modifiers: Modifiers) {
        self.button(pos, false, modifiers);
    }

    /// Presses at the first point, passes through the others, and releases at the last.
    pub(crate) fn drag_screen(&mut self, points: &[Pos2], modifiers: Modifiers) {
        let (first, last) = (points[0], points[points.len() - 1]);
        self.harness.event_modifiers(Event::PointerMoved(first), modifiers);
        self.button(first, true, modifiers);
        for &point in &points[1..] {
            self.harness.event_modifiers(Event::PointerMoved(point), modifiers);
        }
        self.button(last, false, modifiers);
        self.harness.step();
    }

    pub(crate) fn drag(&mut self, pane: Pane, from: [f64; 2], to: [f64; 2]) {
        let points = [self.screen(pane, from), self.screen(pane, to)];
        self.drag_screen(&points, Modifiers::NONE);
    }

    pub(crate) fn click(&mut self, pane: Pane, at: [f64; 2]) {
        let point = self.screen(pane, at);
        self.drag_screen(&[point], Modifiers::NONE);
        // Otherwise the next click would be a double click.
        self.harness.run_steps(3);
    }

    /// Draws a line on the image of a camera.
    pub(crate) fn line(&mut self, camera: usize, from: Pixel, to: Pixel) {
        self.drag(Pane::Image(camera), from.into(), to.into());
    }
}

/// Opens a site whose first camera shows one vertical edge; `edge` returns u of the edge at a v, in pixels.
pub(crate) fn with_edge(mut site: Site, edge: impl Fn(f64) -> f64) -> Desk {
    let picture = image::RgbImage::from_fn(1920, 1080, |x, y| {
        let off = f64::from(x) + 0.5 - edge(f64::from(y) + 0.5);
        image::Rgb([(60.0 + 120.0 / (1.0 + (-1.7 * off).exp())) as u8; 3])
    });
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let mut images = Images::default();
    site.cameras[0].image = Some(images.store(png.into_inner().into(), "image/png", None));
    let mut desk = Desk::with(site, images);
    desk.wait(|app| app.pictures.loading() == 0);
    desk
}

/// Returns the last segment of the last vertical of the first camera.
pub(crate) fn last_vertical(desk: &Desk) -> Vec<Pixel> {
    let annotations = &desk.site().cameras[0].annotations;
    let last = annotations.iter().rfind(|drawn| drawn.kind == calib_core::Kind::Vertical).unwrap();
    last.segments.as_ref().unwrap().last().unwrap().clone()
}

/// Changes the site as one gesture.
pub(crate) fn change(app: &mut App, name: &str, change: impl FnOnce(&mut Site)) {
    let mut site = app.editor.site().clone();
    change(&mut site);
    app.act(Action::Change { site: Box::new(site), name: name.into() });
}

/// Writes an image of one colour to a file.
pub(crate) fn still(scratch: &Scratch, name: &str, [w, h]: [u32; 2]) {
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(w, h).write_to(&mut png, image::ImageFormat::Png).expect("an image in memory");
    scratch.write(name, png.get_ref());
}

/// Returns the demonstration site without images, so that tests need not wait for them.
pub(crate) fn demo() -> Site {
    let mut site = calib_demo::demo_site().site;
    for camera in &mut site.cameras {
        camera.image = None;
    }
    if let Some(plan) = &mut site.plan {
        plan.image = None;
    }
    site
}
