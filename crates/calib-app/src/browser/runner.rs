//! Runs the app on its canvas: start, requests of the page, and a new canvas after a lost graphics context.

use std::cell::RefCell;
use std::rc::Rc;

use calib_site::Options;
use egui::accesskit::{Action, ActionRequest, NodeId, TreeId};
use egui::{Context, RawInput, Ui};
use js_sys::{Array, Reflect};
use serde_json::{Value, json};
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::spawn_local;

use crate::browser::mirror::Mirror;
use crate::browser::shelf;
use crate::browser::shelf::Database;
use crate::command::{self, Command};
use crate::platform::Task;
use crate::platform::web::{breath, page, read_all};
use crate::state::{App, Automatic};
use crate::theme;

/// Request that the web page sends to the app.
enum PageRequest {
    /// Command by its name.
    Command(String),
    /// Files to open.
    Files(Array),
    /// Press on the widget with this node id in the accessibility tree.
    Press(u64),
}

/// App, and the state that remains when the canvas is lost.
#[derive(Clone)]
struct Stage {
    app: Rc<RefCell<Option<App>>>,
    ctx: Rc<RefCell<Context>>,
    runner: eframe::WebRunner,
    /// Whether the page reports coordinates and accepts commands from tests.
    tested: bool,
}

/// Starts the app on the page's canvas.
pub(super) fn start() {
    // The page reports the panic and offers the site for download. Unwinding is not possible in the browser.
    std::panic::set_hook(Box::new(|info| page::panicked(&info.to_string())));
    let query = web_sys::window().and_then(|window| window.location().search().ok()).unwrap_or_default();
    let stage = Stage {
        app: Rc::default(),
        ctx: Rc::default(),
        runner: eframe::WebRunner::new(),
        tested: query.trim_start_matches('?').split('&').any(|part| part == "test=1"),
    };
    stage.register_callbacks();
    spawn_local(async move {
        if let Err(error) = stage.show(&page::fresh_canvas()).await {
            page::panicked(&format!("{error:?}"));
        }
    });
}

impl Stage {
    /// Registers the functions that the page calls.
    fn register_callbacks(&self) {
        let ctx = Rc::clone(&self.ctx);
        let wake = Closure::<dyn Fn()>::new(move || ctx.borrow().request_repaint());
        page::PAGE.with(|page| page.set_wake(wake.as_ref().unchecked_ref()));
        wake.forget();
        let stage = self.clone();
        let restart = Closure::<dyn Fn()>::new(move || stage.restart());
        page::PAGE.with(|page| page.set_restart(restart.as_ref().unchecked_ref()));
        restart.forget();
        if self.tested {
            let app = Rc::clone(&self.app);
            let state = Closure::<dyn Fn() -> String>::new(move || {
                app.try_borrow()
                    .ok()
                    .and_then(|app| app.as_ref().map(|app| report(app).to_string()))
                    .unwrap_or_default()
            });
            // Only tests read the state.
            let _ = Reflect::set(&js_sys::global(), &"calibState".into(), state.as_ref());
            state.forget();
            let app = Rc::clone(&self.app);
            let solve = Closure::<dyn Fn(u32) -> f64>::new(move |runs| {
                app.try_borrow().ok().and_then(|app| Some(solve(app.as_ref()?, runs))).unwrap_or(f64::NAN)
            });
            let _ = Reflect::set(&js_sys::global(), &"calibSolve".into(), solve.as_ref());
            solve.forget();
        }
    }

    /// Shows the app on a canvas; the first call creates the app.
    async fn show(&self, canvas: &web_sys::HtmlCanvasElement) -> Result<(), JsValue> {
        let lost = Closure::<dyn Fn(web_sys::Event)>::new({
            let stage = self.clone();
            move |event: web_sys::Event| {
                event.prevent_default();
                stage.restore_later();
            }
        });
        canvas.add_event_listener_with_callback("webglcontextlost", lost.as_ref().unchecked_ref())?;
        lost.forget();
        let stage = self.clone();
        let made = self.runner.start(
            canvas.clone(),
            eframe::WebOptions::default(),
            Box::new(move |creation| {
                let ctx = &creation.egui_ctx;
                *stage.ctx.borrow_mut() = ctx.clone();
                ctx.add_plugin(Mirror::new(stage.tested));
                let mut app = stage.app.borrow_mut();
                match app.as_mut() {
                    Some(app) => app.forget_textures(ctx),
                    None => {
                        let mut made = App::new(ctx, None);
                        made.storage.shelf = Some(Box::new(Database::open(ctx)));
                        *app = Some(made);
                    }
                }
                drop(app);
                let theme = shelf::restore(ctx);
                Ok(Box::new(Shown { stage, frames: 0, theme }))
            }),
        );
        made.await
    }

    /// Reports a lost graphics context, and tries once to restore it.
    fn restore_later(&self) {
        page::context_lost();
        let stage = self.clone();
        spawn_local(async move {
            for _ in 0..60 {
                breath().await;
            }
            stage.restart();
        });
    }

    /// Shows the app on a new canvas, which replaces the lost one.
    fn restart(&self) {
        let stage = self.clone();
        spawn_local(async move {
            stage.runner.destroy();
            match stage.show(&page::fresh_canvas()).await {
                Ok(()) => page::context_back(),
                // The page shows a button for another attempt.
                Err(_) => page::context_lost(),
            }
        });
    }
}

/// App on one canvas. A lost graphics context needs a new canvas.
struct Shown {
    stage: Stage,
    /// Number of frames on this canvas.
    frames: u32,
    /// Theme in the local storage of the browser.
    theme: egui::ThemePreference,
}

impl Shown {
    /// Carries out a request of the page.
    fn apply_request(&self, app: &mut App, ctx: &Context, request: PageRequest) {
        match request {
            PageRequest::Command(name) if name == "demonstration" => {
                command::run(app, ctx, Command::Demo, egui::Modifiers::NONE);
            }
            PageRequest::Command(name) if name == "tour" => {
                command::run(app, ctx, Command::Tour, egui::Modifiers::NONE);
            }
            // Tests check the page's report of a panic.
            PageRequest::Command(name) if name == "panic" && self.stage.tested => panic!("as a test asked"),
            PageRequest::Files(files) => {
                app.jobs.arriving.push(Task::wait(ctx, async move { read_all(&files).await }));
            }
            PageRequest::Command(_) | PageRequest::Press(_) => {}
        }
    }
}

impl eframe::App for Shown {
    fn raw_input_hook(&mut self, ctx: &Context, input: &mut RawInput) {
        for request in take_requests() {
            if let PageRequest::Press(node) = request {
                input.events.push(egui::Event::AccessKitActionRequest(ActionRequest {
                    action: Action::Click,
                    target_tree: TreeId::ROOT,
                    target_node: NodeId(node),
                    data: None,
                }));
            } else if let Some(app) = self.stage.app.borrow_mut().as_mut() {
                self.apply_request(app, ctx, request);
            }
        }
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        let mut app = self.stage.app.borrow_mut();
        let Some(app) = app.as_mut() else { return };
        app.show_ui(ui);
        shelf::keep(ui.ctx(), &mut self.theme);
        let unkept = app.storage.shelf.as_ref().is_some_and(|shelf| shelf.is_behind());
        page::PAGE.with(|page| page.set_unkept(unkept && !app.editor.session().is_saved()));
        self.frames += 1;
        // The first frame computes the layout, the second is complete.
        match self.frames {
            1 => ui.ctx().request_repaint(),
            2 => page::shown(),
            _ => {}
        }
    }
}

/// Takes the requests of the page since the last frame from its queue.
fn take_requests() -> Vec<PageRequest> {
    let queue = page::PAGE.with(page::Page::queue);
    let taken: Vec<JsValue> = queue.iter().collect();
    queue.set_length(0);
    let field = |request: &JsValue, name: &str| {
        Reflect::get(request, &name.into()).ok().filter(|value| !value.is_undefined())
    };
    let one = |request: JsValue| {
        if let Some(name) = field(&request, "command").and_then(|name| name.as_string()) {
            return Some(PageRequest::Command(name));
        }
        if let Some(files) = field(&request, "files") {
            return Some(PageRequest::Files(Array::from(&files)));
        }
        field(&request, "click")
            .and_then(|id| id.as_string())
            .and_then(|id| id.parse().ok())
            .map(PageRequest::Press)
    };
    taken.into_iter().filter_map(one).collect()
}

/// Measures the median duration of `runs` solves of the first camera, in milliseconds.
fn solve(app: &App, runs: u32) -> f64 {
    let site = &app.editor.session().site;
    let options = Options {
        refine: false,
        cameras: site.cameras.first().map(|camera| vec![camera.id.clone()]),
        ..Options::default()
    };
    let mut took: Vec<f64> = (0..runs)
        .map(|_| {
            let start = web_time::Instant::now();
            std::hint::black_box(std::hint::black_box(site).calibrate(&options));
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    took.sort_by(f64::total_cmp);
    took.get(took.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Returns the state of the app as JSON for tests: canvases, the site with its results, and running work.
fn report(app: &App) -> Value {
    let panes: Vec<Value> = app
        .view
        .panes
        .rects
        .iter()
        .map(|(key, rect)| {
            let view = app.view.panes.views.get(key);
            json!({
                "place": format!("{:?}", key.0),
                "pane": format!("{:?}", key.1),
                "rect": [rect.min.x, rect.min.y, rect.max.x, rect.max.y],
                "centre": view.map(|view| view.centre),
                "zoom": view.map(|view| view.zoom),
                "y_up": view.is_some_and(|view| view.y_up),
            })
        })
        .collect();
    let session = app.editor.session();
    let solved = session.solved.write_into(&session.site);
    json!({
        "panes": panes,
        "site": serde_json::from_str::<Value>(&solved.to_json()).unwrap_or(Value::Null),
        "generation": session.revision.generation,
        "behind": app.storage.shelf.as_ref().is_some_and(|shelf| shelf.is_behind()),
        "reading": app.pictures.loading() + app.edges.pending() + app.jobs.arriving.len(),
        "refining": app.jobs.refining.is_some(),
        "proposing": app.jobs.proposing.is_some(),
        "automatic": app.jobs.automatic.as_ref().map(Automatic::doing),
        "proposed": session.proposed().map(|own| json!({"verdict": own.confidence.name(), "lines": own.count()})),
        "comparing": app.is_comparing(),
        "newer": app.editor.selected_newer().map(|own| own.comparison.change.name()),
        "error": app.editor.error(),
        "note": session.note,
        "milliseconds": session.solved.milliseconds,
    })
}

impl App {
    /// Drops all textures after a lost graphics context; each texture is created again when it is needed.
    pub(crate) fn forget_textures(&mut self, ctx: &Context) {
        theme::install(ctx);
        self.pictures.clear();
        self.view.panes.forget_pointer();
    }
}
