//! The open document with all that is held beside it: tool, selection, what was copied, what went wrong.

use std::path::PathBuf;
use std::sync::Arc;

use calib_core::{Annotation, Camera, Code, Kind};

use calib_site::{Site, SiteCamera};

use crate::command::{self, Command, Needs};
use crate::family::Family;
use crate::images::Images;
use crate::newer::Newer;
use crate::period::Period;
use crate::proposed::Preview;
use crate::session::Session;
use crate::tools::{TOOLS, Tool};

/// The still that a camera had before the one it has.
#[derive(Clone, Debug, PartialEq)]
pub struct OldStill {
    /// The camera.
    pub of: Period,
    /// What the site called it.
    pub image: String,
    /// How much of it shows.
    pub share: f32,
    /// Its size, where that is another and nothing was rescaled yet.
    pub size: Option<[u32; 2]>,
}

/// The document, to be read by everyone and changed by [`Editor::apply`] alone.
#[derive(Debug)]
pub struct Editor {
    pub(crate) session: Session,
    pub(crate) tool: Box<dyn Tool>,
    /// What moves the handles of the plan while a tool is in the hand that does nothing there.
    pub(crate) on_plan: Box<dyn Tool>,
    /// The row of the tool in the list.
    pub(crate) tool_row: usize,
    /// Annotations that were copied, with the size of their image.
    pub(crate) copied: Option<(Vec<Annotation>, [u32; 2])>,
    pub(crate) old_still: Option<OldStill>,
    /// Newer stills, one a camera.
    pub(crate) newer: Vec<Newer>,
    /// A saved version to compare with.
    pub(crate) compared: Option<Site>,
    /// What else fits the camera of this index as well.
    pub(crate) family: Option<(usize, Family)>,
    /// The camera in hand with all that is proposed.
    pub(crate) preview: Option<Preview>,
    /// What went wrong, until it is closed.
    pub(crate) error: Option<String>,
}

impl Default for Editor {
    fn default() -> Self {
        Self {
            session: Session::new(Site::new(), Images::default(), None),
            tool: (TOOLS[0].make)(),
            on_plan: (TOOLS[0].make)(),
            tool_row: 0,
            copied: None,
            old_still: None,
            newer: Vec::new(),
            compared: None,
            family: None,
            preview: None,
            error: None,
        }
    }
}

impl Editor {
    /// The open site, with what follows from it and what is selected.
    #[must_use]
    pub const fn session(&self) -> &Session {
        &self.session
    }

    /// The open site as drawn so far, the gesture under way included.
    #[must_use]
    pub const fn site(&self) -> &Site {
        &self.session.site
    }

    /// The tool in hand; while a handle of the plan is held, what holds it.
    #[must_use]
    pub fn tool(&self) -> &dyn Tool {
        if self.on_plan.is_idle() { &*self.tool } else { &*self.on_plan }
    }

    /// The row of the tool in hand.
    #[must_use]
    pub const fn tool_row(&self) -> usize {
        self.tool_row
    }

    /// The kind of annotation that the tool in hand draws.
    #[must_use]
    pub fn tool_kind(&self) -> Option<Kind> {
        TOOLS.get(self.tool_row)?.kind
    }

    /// The still that was replaced, while it is of interest.
    #[must_use]
    pub const fn old_still(&self) -> Option<&OldStill> {
        self.old_still.as_ref()
    }

    /// The newer still of a camera, by its index.
    #[must_use]
    pub fn newer(&self, camera: usize) -> Option<&Newer> {
        let entry = self.session.site.cameras.get(camera)?;
        self.newer.iter().find(|newer| newer.is_of(entry))
    }

    /// The newer still of the camera in hand.
    #[must_use]
    pub fn newer_in_hand(&self) -> Option<&Newer> {
        self.newer(self.session.camera)
    }

    /// The saved version that is compared with.
    #[must_use]
    pub const fn compared(&self) -> Option<&Site> {
        self.compared.as_ref()
    }

    /// What went wrong and was not closed yet.
    #[must_use]
    pub fn error(&self) -> Option<&str> {
        self.error.as_deref()
    }

    /// Whether the site is as the last finished gesture left it.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.session.history.is_at(&self.session.site)
    }

    /// Keeps the bytes of an image and returns the name by which the site can refer to it. Until it does, the
    /// document is the same.
    pub fn store_image(&mut self, bytes: Arc<[u8]>, mime: &str, name: Option<&str>) -> String {
        self.session.images.store(bytes, mime, name)
    }

    /// Has files be read as images though they are outside the site's folder; links in their paths are followed
    /// already. The document is the same.
    pub fn allow_images(&mut self, files: impl IntoIterator<Item = PathBuf>) {
        self.session.images.allowed.extend(files);
    }

    /// Solves what differs from what was solved before, and whatever was put off. Whether anything did.
    pub fn solve(&mut self) -> bool {
        self.session.catch_up();
        self.session.solve()
    }

    /// A frame begins: whatever comes in, what takes long is solved once in it.
    pub fn begin_frame(&mut self) {
        self.session.begin_frame();
    }

    /// Finds out what else fits the camera in hand, for whoever shows it. Whether anything does.
    pub fn find_family(&mut self) -> bool {
        let session = &self.session;
        let camera = session.camera;
        let Some(entry) = session.entry() else { return false };
        // While a line is in the hand the last answer stands.
        if !self.tool().is_idle() || session.solved.paused {
            return self.family.as_ref().is_some_and(|(of, _)| *of == camera);
        }
        let is_known = self.family.as_ref().is_some_and(|(of, family)| *of == camera && family.is_of(entry));
        let Some(solution) = session.solution() else {
            self.family = None;
            return false;
        };
        let has_more = !solution.alternatives.is_empty() || solution.warns_of(Code::FocalUnobservable);
        if !has_more {
            self.family = None;
        } else if !is_known {
            let lenses = session.solved.lenses(camera);
            let family = Family::of(&session.site, camera, solution, &lenses);
            self.family = family.map(|family| (camera, family));
        }
        self.family.is_some()
    }

    /// What else fits as well, with the index of its camera.
    #[must_use]
    pub fn family(&self) -> Option<(usize, &Family)> {
        self.family.as_ref().map(|(camera, family)| (*camera, family))
    }

    /// Finds out what the camera in hand would be with all that is proposed, for whoever shows it.
    pub fn find_preview(&mut self) -> Option<&Preview> {
        let session = &self.session;
        let (Some(entry), Some(proposed)) = (session.entry(), session.proposed()) else {
            self.preview = None;
            return None;
        };
        // While a line is in the hand the last answer stands.
        let is_known = |preview: &Preview| preview.is_of(entry, proposed) || !self.tool().is_idle();
        if !self.preview.as_ref().is_some_and(is_known) {
            self.preview = Some(Preview::new(entry, session.pose(), proposed));
        }
        self.preview.as_ref()
    }

    /// What was found out of it.
    #[must_use]
    pub fn preview(&self) -> Option<&Preview> {
        self.preview.as_ref().filter(|_| self.session.proposed().is_some())
    }

    /// Poses to be shown as ghosts: those before the gesture under way; else, where `wanted`, those of a
    /// compared version or before refining.
    #[must_use]
    pub fn poses_before(&self, wanted: bool) -> Vec<Option<Camera>> {
        if !self.tool().is_idle() {
            return self.session.settled().to_vec();
        }
        if let Some(compared) = self.compared.as_ref().filter(|_| wanted) {
            let pose = |camera: &SiteCamera| compared.camera(&camera.id).and_then(SiteCamera::camera);
            return self.session.site.cameras.iter().map(pose).collect();
        }
        self.session.before_refine.clone().filter(|_| wanted).unwrap_or_default()
    }

    /// Whether a command would do something now; whether work is under way, the editor is told.
    #[must_use]
    pub fn is_enabled(&self, command: Command, is_working: bool) -> bool {
        let session = &self.session;
        match command::row(command).map_or(Needs::Nothing, |row| row.needs) {
            Needs::Nothing => true,
            Needs::Cameras => !session.site.cameras.is_empty(),
            Needs::Camera => session.entry().is_some(),
            Needs::Selection => !session.selection.is_empty(),
            Needs::Chosen => !session.selection.is_empty() || session.picked.is_some(),
            Needs::Proposed => session.proposed().is_some(),
            Needs::Newer => self.newer_in_hand().is_some(),
            Needs::Moved => self.newer_in_hand().is_some_and(Newer::has_moved),
            Needs::Undo => session.history.undo_name().is_some() || !self.tool().is_idle(),
            Needs::Redo => session.history.redo_name().is_some() && self.tool().is_idle(),
            Needs::Suggestion => session.proposal().is_some(),
            Needs::SecondSolution => {
                session.solution().is_some_and(|solution| !solution.alternatives.is_empty())
            }
            Needs::Copied => self.copied.is_some() && session.entry().is_some(),
            Needs::Before => session.before_refine.is_some() || self.compared.is_some(),
            Needs::Work => is_working,
        }
    }

    /// The words of a command now: undo says what it takes back.
    #[must_use]
    pub fn words(&self, command: Command) -> String {
        let history = &self.session.history;
        match command {
            Command::Undo => format!("Undo {}", history.undo_name().unwrap_or_default()),
            Command::Redo => format!("Redo {}", history.redo_name().unwrap_or_default()),
            _ => command::row(command).map_or_else(String::new, |row| row.text.to_owned()),
        }
    }
}
