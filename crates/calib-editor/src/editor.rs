//! Open document with the state that is not part of it: tool, selection, copied annotations, error message.

use std::path::PathBuf;
use std::sync::Arc;

use calib_core::{Annotation, Camera, Code, Kind};

use calib_site::{Site, SiteCamera};

use crate::command::{self, Command, Needs};
use crate::family::Family;
use crate::images::Images;
use crate::newer::NewerImage;
use crate::period::Period;
use crate::proposed::Preview;
use crate::session::Session;
use crate::tools::{Icon, TOOLS, Tool};

/// Image that a camera had before its current image, shown over the current image.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplacedImage {
    /// Calibration period of the camera whose image was replaced.
    pub of: Period,
    /// Name of the image in the site.
    pub image: String,
    /// Opacity, 0 to 1.
    pub opacity: f32,
    /// Width and height of the replaced image in pixels. `None` if the new image has the same size, or if the
    /// annotations were scaled to it.
    pub size: Option<[u32; 2]>,
}

/// Editor of the document. Views read it; only [`Editor::apply`] changes the document.
#[derive(Debug)]
pub struct Editor {
    pub(crate) session: Session,
    pub(crate) tool: Box<dyn Tool>,
    /// Tool that moves the handles of cameras on the plan if the current tool does not act on the plan.
    pub(crate) plan_tool: Box<dyn Tool>,
    /// Index of the current tool in the list of tools.
    pub(crate) tool_row: usize,
    /// Copied annotations, with the width and height of their image in pixels.
    pub(crate) copied_annotations: Option<(Vec<Annotation>, [u32; 2])>,
    pub(crate) replaced_image: Option<ReplacedImage>,
    /// Newer images, at most one per camera.
    pub(crate) newer: Vec<NewerImage>,
    /// Saved version of the site to compare with.
    pub(crate) compared_site: Option<Site>,
    /// Alternative solutions of a camera that fit equally well, with the index of the camera in the site.
    pub(crate) family: Option<(usize, Family)>,
    /// Preview: the selected camera with its whole automatic calibration accepted.
    pub(crate) preview: Option<Preview>,
    /// Error message that the operator has not closed yet.
    pub(crate) error: Option<String>,
}

impl Default for Editor {
    fn default() -> Self {
        Self {
            session: Session::new(Site::new(), Images::default(), None),
            tool: (TOOLS[0].make)(),
            plan_tool: (TOOLS[0].make)(),
            tool_row: 0,
            copied_annotations: None,
            replaced_image: None,
            newer: Vec::new(),
            compared_site: None,
            family: None,
            preview: None,
            error: None,
        }
    }
}

impl Editor {
    /// Returns the open site with its results and selection.
    #[must_use]
    pub const fn session(&self) -> &Session {
        &self.session
    }

    /// Returns the open site, including the unfinished gesture.
    #[must_use]
    pub const fn site(&self) -> &Site {
        &self.session.site
    }

    /// Returns the current tool. While a handle of a camera on the plan is dragged, returns the tool that
    /// moves the handle.
    #[must_use]
    pub fn tool(&self) -> &dyn Tool {
        if self.plan_tool.is_idle() { &*self.tool } else { &*self.plan_tool }
    }

    /// Returns the index of the current tool.
    #[must_use]
    pub const fn tool_row(&self) -> usize {
        self.tool_row
    }

    /// Whether the current tool has this icon.
    #[must_use]
    pub fn has_tool(&self, icon: Icon) -> bool {
        TOOLS.get(self.tool_row).is_some_and(|tool| tool.icon == icon)
    }

    /// Returns the kind of annotation that the current tool draws; `None` for tools that draw no annotation.
    #[must_use]
    pub fn tool_kind(&self) -> Option<Kind> {
        TOOLS.get(self.tool_row)?.kind
    }

    /// Returns the replaced image, unless it is hidden.
    #[must_use]
    pub const fn replaced_image(&self) -> Option<&ReplacedImage> {
        self.replaced_image.as_ref()
    }

    /// Returns the newer image of the camera with this index.
    #[must_use]
    pub fn newer(&self, camera: usize) -> Option<&NewerImage> {
        let entry = self.session.site.cameras.get(camera)?;
        self.newer.iter().find(|newer| newer.is_of(entry))
    }

    /// Returns the newer image of the selected camera.
    #[must_use]
    pub fn selected_newer(&self) -> Option<&NewerImage> {
        self.newer(self.session.camera)
    }

    /// Returns the saved version of the site to compare with.
    #[must_use]
    pub const fn compared_site(&self) -> Option<&Site> {
        self.compared_site.as_ref()
    }

    /// Returns the error message that the operator has not closed yet.
    #[must_use]
    pub fn error(&self) -> Option<&str> {
        self.error.as_deref()
    }

    /// Whether the site is unchanged since the last finished gesture.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.session.history.is_unchanged(&self.session.site)
    }

    /// Stores the bytes of an image and returns the name by which the site can refer to it. The document does
    /// not change.
    pub fn store_image(&mut self, bytes: Arc<[u8]>, mime: &str, name: Option<&str>) -> String {
        self.session.images.store(bytes, mime, name)
    }

    /// Allows files outside the site's folder to be read as images. The paths must be canonical. The document
    /// does not change.
    pub fn allow_images(&mut self, files: impl IntoIterator<Item = PathBuf>) {
        self.session.images.allowed.extend(files);
    }

    /// Solves the cameras whose inputs changed, and postponed solves. Returns whether any camera was solved.
    pub fn solve(&mut self) -> bool {
        self.session.solve_postponed();
        self.session.solve()
    }

    /// Begins a frame of the display. A slow solve then runs at most once in this frame.
    pub fn begin_frame(&mut self) {
        self.session.begin_frame();
    }

    /// Searches for other solutions that fit the selected camera's annotations equally well. Returns whether
    /// any exist.
    pub fn find_family(&mut self) -> bool {
        let session = &self.session;
        let camera = session.camera;
        let Some(entry) = session.entry() else { return false };
        // During a gesture the last result is kept, because the search would be too slow.
        if !self.tool().is_idle() || session.solved.paused {
            return self.family.as_ref().is_some_and(|(of, _)| *of == camera);
        }
        let is_known =
            self.family.as_ref().is_some_and(|(of, family)| *of == camera && family.is_current(entry));
        let Some(solution) = session.solution() else {
            self.family = None;
            return false;
        };
        let has_more = !solution.alternatives.is_empty() || solution.has_warning(Code::FocalUnobservable);
        if !has_more {
            self.family = None;
        } else if !is_known {
            let lenses = session.solved.lenses(camera);
            let family = Family::find(&session.site, camera, solution, &lenses);
            self.family = family.map(|family| (camera, family));
        }
        self.family.is_some()
    }

    /// Returns the alternative solutions of a camera that fit equally well, with its index in the site.
    #[must_use]
    pub fn family(&self) -> Option<(usize, &Family)> {
        self.family.as_ref().map(|(camera, family)| (*camera, family))
    }

    /// Computes the preview, unless it is current: the selected camera with its whole automatic calibration
    /// accepted.
    pub fn find_preview(&mut self) -> Option<&Preview> {
        let session = &self.session;
        let (Some(entry), Some(proposed)) = (session.entry(), session.proposed()) else {
            self.preview = None;
            return None;
        };
        // During a gesture the last preview is kept, because computing a new one would be too slow.
        let is_known = |preview: &Preview| preview.is_current(entry, proposed) || !self.tool().is_idle();
        if !self.preview.as_ref().is_some_and(is_known) {
            self.preview = Some(Preview::new(entry, session.pose(), proposed));
        }
        self.preview.as_ref()
    }

    /// Returns the last computed preview, if the selected camera has an undecided automatic calibration.
    #[must_use]
    pub fn preview(&self) -> Option<&Preview> {
        self.preview.as_ref().filter(|_| self.session.proposed().is_some())
    }

    /// Returns earlier poses of all cameras, to be shown as ghosts. During a gesture they are the poses
    /// before the gesture. Otherwise, if `wanted` is set, they are the poses of the compared version, or the
    /// poses before the joint solve.
    #[must_use]
    pub fn ghost_poses(&self, wanted: bool) -> Vec<Option<Camera>> {
        if !self.tool().is_idle() {
            return self.session.settled().to_vec();
        }
        if let Some(compared) = self.compared_site.as_ref().filter(|_| wanted) {
            let pose = |camera: &SiteCamera| compared.camera(&camera.id).and_then(SiteCamera::camera);
            return self.session.site.cameras.iter().map(pose).collect();
        }
        self.session.live.before_refine.clone().filter(|_| wanted).unwrap_or_default()
    }

    /// Whether a command is enabled. The caller passes whether a background task is running.
    #[must_use]
    pub fn is_enabled(&self, command: Command, is_working: bool) -> bool {
        let session = &self.session;
        match command::row(command).map_or(Needs::Nothing, |row| row.needs) {
            Needs::Nothing => true,
            Needs::Cameras => !session.site.cameras.is_empty(),
            Needs::Camera => session.entry().is_some(),
            Needs::Selection => !session.selection.is_empty(),
            Needs::Chosen => !session.selection.is_empty() || session.pending.picked_line.is_some(),
            Needs::Proposed => session.proposed().is_some(),
            Needs::Newer => self.selected_newer().is_some(),
            Needs::Moved => self.selected_newer().is_some_and(NewerImage::has_moved),
            Needs::Undo => session.history.undo_name().is_some() || !self.tool().is_idle(),
            Needs::Redo => session.history.redo_name().is_some() && self.tool().is_idle(),
            Needs::Suggestion => session.suggestion().is_some(),
            Needs::SecondSolution => {
                session.solution().is_some_and(|solution| !solution.alternatives.is_empty())
            }
            Needs::Copied => self.copied_annotations.is_some() && session.entry().is_some(),
            Needs::Before => session.live.before_refine.is_some() || self.compared_site.is_some(),
            Needs::Work => is_working,
        }
    }

    /// Returns the current text of a command. The texts of undo and redo include the name of the step.
    #[must_use]
    pub fn command_text(&self, command: Command) -> String {
        let history = &self.session.history;
        match command {
            Command::Undo => format!("Undo {}", history.undo_name().unwrap_or_default()),
            Command::Redo => format!("Redo {}", history.redo_name().unwrap_or_default()),
            _ => command::row(command).map_or_else(String::new, |row| row.text.to_owned()),
        }
    }
}
