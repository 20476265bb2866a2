//! Storage of sites in the browser's database (`web/store.js`), and of the chosen theme in its local storage.
//!
//! egui's own persistence would also store panel widths, but its code is 2.5 % of the page.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::PathBuf;
use std::rc::Rc;

use calib_editor::Images;
use calib_site::Site;
use egui::{Context, ThemePreference};
use js_sys::{Array, Reflect, Uint8Array};
use serde::{Deserialize, Serialize};
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::{JsFuture, spawn_local};

use crate::platform::web::page;
use crate::storage::autosave::Found;
use crate::storage::autosave::ago;
use crate::storage::autosave::{Entry, News, Shelf, Work};
use crate::storage::demo;

/// Key of the theme in the local storage.
const THEME_KEY: &str = "calib.theme";

/// Returns the local storage; `None` if the browser does not have one, as in a private window.
fn storage() -> Option<web_sys::Storage> {
    web_sys::window()?.local_storage().ok()?
}

/// Returns the current theme.
fn chosen(ctx: &Context) -> ThemePreference {
    ctx.options(|options| options.theme_preference)
}

/// Restores the theme of an earlier visit, and returns it.
pub(super) fn restore(ctx: &Context) -> ThemePreference {
    match storage().and_then(|storage| storage.get_item(THEME_KEY).ok().flatten()).as_deref() {
        Some("dark") => ctx.set_theme(ThemePreference::Dark),
        Some("light") => ctx.set_theme(ThemePreference::Light),
        _ => {}
    }
    chosen(ctx)
}

/// Stores the current theme in the local storage if the theme differs from `kept`.
pub(super) fn keep(ctx: &Context, kept: &mut ThemePreference) {
    let now = chosen(ctx);
    if now == *kept {
        return;
    }
    *kept = now;
    let name = match now {
        ThemePreference::Dark => "dark",
        ThemePreference::Light => "light",
        ThemePreference::System => "system",
    };
    if let Some(storage) = storage() {
        // A failure only loses the theme.
        let _ = storage.set_item(THEME_KEY, name);
    }
}

/// Stored site, as a record of the database.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
struct Record {
    id: String,
    /// Number of writes of the record. A tab with an outdated number cannot overwrite the record.
    revision: u32,
    name: String,
    cameras: usize,
    last: String,
    thumbnail: Option<String>,
    path: Option<PathBuf>,
    /// Whether the site is the demonstration, whose images are rendered instead of stored.
    demonstration: bool,
    site: String,
    images: Vec<StoredImage>,
    /// Size with all images, in bytes; written by the page.
    #[serde(skip_serializing)]
    bytes: u64,
    /// Time of the last write, in milliseconds since 1970; written by the page.
    #[serde(skip_serializing)]
    kept: f64,
}

/// Image of a stored site; the database contains its bytes under its id.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredImage {
    id: String,
    mime: String,
    name: Option<String>,
}

/// State that the running requests to the database share.
#[derive(Debug, Default)]
struct State {
    entries: Vec<Entry>,
    news: VecDeque<News>,
    /// Id of the open site in the database; `None` until the site is first stored.
    own: Option<String>,
    /// Last known number of writes of every stored site, by its id.
    revisions: BTreeMap<String, u32>,
    /// Ids of the images of the open site that were already sent to the database.
    sent: BTreeSet<String>,
    /// Records that wait for a running write, at most one per site.
    waiting: VecDeque<(Record, Array)>,
    writing: bool,
    /// Whether the last write failed.
    failed: bool,
    /// Whether the app has already asked the browser for persistent storage.
    has_asked_to_persist: bool,
}

/// Storage of sites in the database of the browser.
#[derive(Clone, Debug)]
pub(crate) struct Database {
    state: Rc<RefCell<State>>,
    ctx: Context,
}

impl Database {
    /// Opens the database and lists its sites.
    pub(crate) fn open(ctx: &Context) -> Self {
        let database = Self { state: Rc::default(), ctx: ctx.clone() };
        database.list();
        database
    }

    /// Queues a message for the app.
    fn add_message(&self, news: News) {
        self.state.borrow_mut().news.push_back(news);
        self.ctx.request_repaint();
    }

    /// Reads the list of stored sites.
    fn list(&self) {
        let own = self.clone();
        spawn_local(async move {
            match JsFuture::from(page::list()).await {
                Ok(records) => {
                    let entries =
                        Array::from(&records).iter().filter_map(|record| list_entry(&record)).collect();
                    own.state.borrow_mut().entries = entries;
                    own.ctx.request_repaint();
                }
                Err(error) => own.add_message(News::Trouble(format!(
                    "This browser cannot store sites ({}). Save the site as a file before you close the page.",
                    exception_name(&error)
                ))),
            }
        });
    }

    /// Writes the waiting records one after the other.
    fn write(&self) {
        let mut state = self.state.borrow_mut();
        if state.writing {
            return;
        }
        let Some((mut record, images)) = state.waiting.pop_front() else { return };
        record.revision = state.revisions.get(&record.id).copied().unwrap_or_default();
        state.writing = true;
        drop(state);
        let own = self.clone();
        spawn_local(async move {
            let text = serde_json::to_string(&record).unwrap_or_default();
            let result = JsFuture::from(page::keep(&text, &images)).await;
            own.finish_write(record, images, result);
        });
    }

    /// Handles the result of a write, and starts the next one.
    fn finish_write(&self, record: Record, images: Array, result: Result<JsValue, JsValue>) {
        let mut state = self.state.borrow_mut();
        state.writing = false;
        let is_own = state.own.as_ref() == Some(&record.id);
        match result {
            Ok(revision) => {
                state.failed = false;
                if let Some(revision) = revision.as_f64() {
                    state.revisions.insert(record.id, revision as u32);
                }
                drop(state);
                self.list();
            }
            Err(error) if exception_name(&error) == "VersionError" && is_own => {
                // Another tab wrote this site; the open site continues as a new entry with all its images.
                state.own = None;
                state.sent.clear();
                state.waiting.retain(|(waiting, _)| waiting.id != record.id);
                let name = if record.name.is_empty() { "This site".to_owned() } else { record.name };
                state.news.push_back(News::Again);
                state.news.push_back(News::Note(format!(
                    "{name} was changed in another tab. Your changes here are stored as a separate site."
                )));
                drop(state);
            }
            Err(error) => {
                let was_known = std::mem::replace(&mut state.failed, true);
                // Images that were not stored are added to the waiting record of the site, or to its next
                // record.
                let waits = state.waiting.iter().find(|(waiting, _)| waiting.id == record.id);
                let waits = waits.map(|(_, waiting)| waiting.clone());
                for image in images.iter() {
                    match (&waits, Array::from(&image).get(0).as_string()) {
                        (Some(waiting), _) => drop(waiting.push(&image)),
                        (None, Some(id)) if is_own => drop(state.sent.remove(&id)),
                        (None, _) => {}
                    }
                }
                drop(state);
                if !was_known {
                    self.add_message(News::Trouble(store_error_text(&exception_name(&error))));
                }
            }
        }
        self.write();
        self.ctx.request_repaint();
    }
}

impl Shelf for Database {
    fn entries(&self) -> Vec<Entry> {
        self.state.borrow().entries.clone()
    }

    fn keep(&mut self, work: Work<'_>) {
        let mut state = self.state.borrow_mut();
        let images = Array::new();
        for (id, mime, name, bytes) in work.images.stored() {
            if state.sent.insert(id.to_owned()) {
                let name = name.map_or(JsValue::NULL, JsValue::from);
                images.push(
                    &Array::of4(&id.into(), &mime.into(), &name, &Uint8Array::from(bytes).into()).into(),
                );
            }
        }
        let id = state.own.get_or_insert_with(fresh_id).clone();
        if let Some(at) = state.waiting.iter().position(|(waiting, _)| waiting.id == id)
            && let Some((_, waiting)) = state.waiting.remove(at)
        {
            for image in waiting.iter() {
                images.push(&image);
            }
        }
        let stored = work.images.stored().map(|(id, mime, name, _)| StoredImage {
            id: id.to_owned(),
            mime: mime.to_owned(),
            name: name.map(str::to_owned),
        });
        let stem = work.path.as_deref().and_then(std::path::Path::file_stem);
        let name = work.site.name.clone().or_else(|| stem.map(|stem| stem.to_string_lossy().into_owned()));
        let record = Record {
            id,
            name: name.unwrap_or_default(),
            cameras: work.site.cameras.len(),
            last: work.last.to_owned(),
            thumbnail: work.thumbnail.map(str::to_owned),
            path: work.path,
            demonstration: work.images.missing.is_some(),
            site: work.site.to_json(),
            images: stored.collect(),
            ..Record::default()
        };
        state.waiting.push_back((record, images));
        let asks = !std::mem::replace(&mut state.has_asked_to_persist, true);
        drop(state);
        if asks && let Some(window) = web_sys::window() {
            // The answer of the browser is not needed, because failed writes are reported.
            let _ = window.navigator().storage().persist();
        }
        self.write();
    }

    fn begin(&mut self) {
        // A waiting record of the previous site is still written.
        let mut state = self.state.borrow_mut();
        (state.own, state.failed) = (None, false);
        state.sent.clear();
    }

    fn open(&mut self, id: &str) {
        let (own, id) = (self.clone(), id.to_owned());
        spawn_local(async move {
            match JsFuture::from(page::open(&id))
                .await
                .map_err(|error| exception_name(&error))
                .and_then(|kept| site_from_record(&kept))
            {
                Ok((record, found)) => {
                    let mut state = own.state.borrow_mut();
                    state.revisions.insert(record.id.clone(), record.revision);
                    state.own = Some(record.id);
                    state.sent = found.images.stored().map(|(id, ..)| id.to_owned()).collect();
                    drop(state);
                    own.add_message(News::Opened(Box::new(found)));
                }
                Err(error) => own.add_message(News::Trouble(format!(
                    "The stored site cannot be opened ({error}). Reload the page, or open the site from a \
                     saved file."
                ))),
            }
        });
    }

    fn remove(&mut self, id: &str) {
        let (own, id) = (self.clone(), id.to_owned());
        spawn_local(async move {
            if let Err(error) = JsFuture::from(page::remove(&id)).await {
                own.add_message(News::Trouble(format!(
                    "The stored site cannot be removed ({}). Reload the page and try again.",
                    exception_name(&error)
                )));
            }
            own.list();
        });
    }

    fn news(&mut self) -> Option<News> {
        self.state.borrow_mut().news.pop_front()
    }

    fn is_behind(&self) -> bool {
        let state = self.state.borrow();
        state.writing || state.failed || !state.waiting.is_empty()
    }
}

/// Returns the message for a failed write with this exception name.
fn store_error_text(name: &str) -> String {
    match name {
        "QuotaExceededError" => {
            "The browser has no space left to store this site. Save the site as a file now. \
            To free space, remove stored sites from the start page."
                .into()
        }
        other => format!("The browser could not store this site ({other}). Save the site as a file now."),
    }
}

/// Returns the name of a JavaScript exception, such as `QuotaExceededError`.
fn exception_name(error: &JsValue) -> String {
    let name = Reflect::get(error, &"name".into()).ok().and_then(|name| name.as_string());
    name.unwrap_or_else(|| format!("{error:?}"))
}

/// Returns the list entry of a stored site; `None` for an invalid record.
fn list_entry(record: &JsValue) -> Option<Entry> {
    let text = js_sys::JSON::stringify(record).ok()?.as_string()?;
    let record: Record = serde_json::from_str(&text).ok()?;
    let seconds = |milliseconds: f64| (milliseconds / 1e3) as u64;
    let when = ago(seconds(record.kept), seconds(js_sys::Date::now()));
    Some(Entry {
        id: record.id,
        name: record.name,
        cameras: record.cameras,
        bytes: record.bytes,
        when,
        last: record.last,
        thumbnail: record.thumbnail,
    })
}

/// Parses a stored site with its images.
fn site_from_record(kept: &JsValue) -> Result<(Record, Found), String> {
    let kept = Array::from(kept);
    let text = kept.get(0).as_string().ok_or("its record is missing")?;
    let record: Record = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    let site = Site::from_json(&record.site).map_err(|error| error.to_string())?;
    let mut images =
        Images::in_folder(None, record.demonstration.then_some(demo::render as calib_editor::RenderImage));
    for pair in Array::from(&kept.get(1)).iter() {
        let pair = Array::from(&pair);
        let Some(id) = pair.get(0).as_string() else { continue };
        let Some(known) = record.images.iter().find(|image| image.id == id) else { continue };
        let bytes = Uint8Array::new(&pair.get(1)).to_vec();
        images.restore(&id, bytes.into(), &known.mime, known.name.as_deref());
    }
    let path = record.path.clone();
    Ok((record, Found { site, images, path, held: None, at: None }))
}

/// Creates a new id for a stored site.
fn fresh_id() -> String {
    format!("{:x}-{:x}", js_sys::Date::now() as u64, (js_sys::Math::random() * 2f64.powi(48)) as u64)
}
