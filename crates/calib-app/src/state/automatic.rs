//! Automatic calibration and placement of all cameras of a site.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use calib_editor::{Action, AutomaticResult, Images, Period};
use calib_image::{AutomaticCalibration, Confidence, PlacementSearch, SitePlacement, shrunk};
use calib_site::{Site, SiteCamera, counted};
use egui::Context;
use image::RgbImage;

use crate::edges::{Proposing, finished_result};
use crate::platform::{Here, PlacementRequest, Platform as _, Progress, Task};
use crate::state::App;

/// Result of the automatic calibration and placement of all cameras, for the operator.
#[derive(Clone, Debug, Default)]
pub(crate) struct AutomaticReport {
    /// Result of each camera.
    pub(crate) rows: Vec<AutomaticRow>,
    /// Summary of the placement, or the reason why no camera is placed.
    pub(crate) summary: String,
}

/// Result of one camera.
#[derive(Clone, Debug)]
pub(crate) struct AutomaticRow {
    /// Camera and its calibration period.
    pub(crate) of: Period,
    /// Confidence of the automatic calibration and its reason; `None` if this run did not try to calibrate the camera.
    pub(crate) calibration: Option<(Confidence, String)>,
    /// Result of the placement and its reason; `None` if this run did not search for the position.
    pub(crate) placement: Option<(RowPlacement, String)>,
}

/// Result of the placement of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RowPlacement {
    /// The camera was placed by this run.
    Placed,
    /// The camera was already placed.
    Kept,
    /// The position is unknown.
    Unknown,
}

/// Automatic calibration and placement that is running.
#[derive(Debug)]
pub(crate) struct Automatic {
    report: AutomaticReport,
    step: Step,
}

#[derive(Debug)]
enum Step {
    /// Calibration of the images, one after the other.
    Calibrating(Box<Calibrating>),
    /// End of the calibrations. The site is solved before the next step.
    Calibrated,
    /// Decoding of the images of the cameras that are placed.
    Reading(Box<Reading>),
    /// Search for the placements.
    Placing(Box<Placing>),
}

#[derive(Debug)]
struct Calibrating {
    /// Camera entries without annotations, and their images, that are calibrated next.
    waiting: VecDeque<(SiteCamera, String)>,
    running: Option<Proposing>,
    found: Vec<Found>,
    /// Number of images to calibrate, including those already calibrated.
    count: usize,
}

/// Automatic calibration of an image.
#[derive(Debug)]
struct Found {
    of: Period,
    image: String,
    calibration: AutomaticCalibration,
}

#[derive(Debug)]
struct Reading {
    /// Site at the start.
    from: Site,
    /// Site with its solutions.
    solved: Site,
    cameras: Vec<usize>,
    images: Vec<RgbImage>,
}

#[derive(Debug)]
struct Placing {
    /// Site at the start.
    from: Site,
    task: Task<Result<SitePlacement, String>>,
    progress: Arc<Progress>,
    /// Number of cameras.
    count: usize,
}

impl Drop for Placing {
    fn drop(&mut self) {
        self.progress.cancel();
        Here::stop_placing();
    }
}

impl Automatic {
    /// Returns the running step as a phrase for the status line.
    pub(crate) fn doing(&self) -> String {
        match &self.step {
            Step::Calibrating(own) => {
                format!("calibrating image {} of {}", (own.count - own.waiting.len()).max(1), own.count)
            }
            Step::Calibrated => "calibrating".into(),
            Step::Reading(own) => {
                format!("reading {}", counted(own.cameras.len(), "image", "images"))
            }
            Step::Placing(own) => format!(
                "placing {}: {:.0} %",
                counted(own.count, "camera", "cameras"),
                100.0 * own.progress.share()
            ),
        }
    }

    /// Renames the images after a save of the site to another folder.
    pub(crate) fn rebase(&mut self, images: &Images, folder: &Path) {
        let rename = |name: &mut String| *name = images.rebased_name(name, folder);
        match &mut self.step {
            Step::Calibrating(own) => {
                let waiting = own.waiting.iter_mut();
                waiting.flat_map(|(camera, image)| camera.image.iter_mut().chain([image])).for_each(rename);
                own.running.iter_mut().flat_map(Proposing::images_mut).for_each(rename);
                own.found.iter_mut().map(|found| &mut found.image).for_each(rename);
            }
            Step::Calibrated => {}
            Step::Reading(own) => {
                own.from = images.rebased(&own.from, folder);
                own.solved = images.rebased(&own.solved, folder);
            }
            Step::Placing(own) => own.from = images.rebased(&own.from, folder),
        }
    }
}

impl App {
    /// Starts the calibration of all images without annotations, and then the placement of the cameras.
    pub(crate) fn calibrate_all(&mut self) {
        if self.jobs.automatic.is_some() {
            return;
        }
        if self.jobs.proposing.is_some() {
            let note = "An image is being calibrated. Wait for the result, or cancel the calibration first.";
            return self.act(Action::Note(note.into()));
        }
        self.act(Action::CancelGesture);
        self.dialogs.automatic = None;
        let session = self.editor.session();
        let blank = |index: usize| {
            let image = session.site.cameras[index].image.clone()?;
            Some((session.without_annotations(index)?, image))
        };
        let waiting: VecDeque<_> = self.blank_cameras().filter_map(blank).collect();
        let count = waiting.len();
        let row = |entry| AutomaticRow { of: Period::from_camera(entry), calibration: None, placement: None };
        let rows = session.site.cameras.iter().map(row).collect();
        let report = AutomaticReport { rows, summary: String::new() };
        let calibrating = Calibrating { waiting, running: None, found: Vec::new(), count };
        self.jobs.automatic = Some(Automatic { report, step: Step::Calibrating(Box::new(calibrating)) });
    }

    /// Cancels the automatic calibration and placement. The calibrations that are finished remain.
    pub(crate) fn stop_automatic(&mut self) {
        let Some(Automatic { mut report, step }) = self.jobs.automatic.take() else { return };
        if let Step::Calibrating(own) = step {
            self.keep_calibrations(&mut report, own.found);
        }
        let calibrated = report.rows.iter().filter(|row| row.is_calibrated()).count();
        report.summary = "the search was cancelled".into();
        self.dialogs.automatic = Some(report);
        let images = counted(calibrated, "image was", "images were");
        self.act(Action::Note(format!("Cancelled. {images} calibrated, and no camera was placed.")));
    }

    /// Advances the automatic calibration and placement.
    pub(crate) fn poll_automatic(&mut self, ctx: &Context) {
        let Some(Automatic { mut report, step }) = self.jobs.automatic.take() else { return };
        let next = match step {
            Step::Calibrating(own) => Ok(Some(self.advance_calibrating(ctx, &mut report, own))),
            Step::Calibrated => self.begin_placing().map(|reading| Some(Step::Reading(Box::new(reading)))),
            Step::Reading(own) => self.advance_reading(ctx, &mut report, own).map(Some),
            Step::Placing(own) => self.advance_placing(ctx, &mut report, own),
        };
        match next {
            Ok(Some(step)) => self.jobs.automatic = Some(Automatic { report, step }),
            Ok(None) => self.dialogs.automatic = Some(report),
            Err(reason) => {
                report.summary = reason;
                self.dialogs.automatic = Some(report);
            }
        }
    }

    fn advance_calibrating(
        &mut self,
        ctx: &Context,
        report: &mut AutomaticReport,
        mut own: Box<Calibrating>,
    ) -> Step {
        let Some(running) = own.running.as_mut() else {
            ctx.request_repaint();
            let Some((camera, image)) = own.waiting.pop_front() else {
                self.keep_calibrations(report, own.found);
                return Step::Calibrated;
            };
            own.running = Some(Proposing::new(camera, image));
            return Step::Calibrating(own);
        };
        let image = running.image().to_owned();
        let images = &self.editor.session().images;
        let picture = self.pictures.get(ctx, &image, || images.reader(&image));
        let picture = picture.map(|picture| Arc::clone(&picture.image));
        let result = match self.pictures.error(&image) {
            Some(error) => Some(Err(unreadable(error))),
            None => running.poll(ctx, picture.as_ref()),
        };
        let of = running.of();
        match result {
            None => return Step::Calibrating(own),
            Some(Ok(calibration)) => own.found.push(Found { of, image, calibration }),
            Some(Err(error)) => report.set_calibration(&of, Confidence::None, error),
        }
        own.running = None;
        ctx.request_repaint();
        Step::Calibrating(own)
    }

    /// Writes the finished calibrations into the site and the report. Cameras that were removed or annotated,
    /// or whose image was replaced, are unchanged.
    fn keep_calibrations(&mut self, report: &mut AutomaticReport, found: Vec<Found>) {
        let mut usable = Vec::new();
        for Found { of, image, calibration } in found {
            let site = self.editor.site();
            let entry = of.index(site).map(|index| &site.cameras[index]);
            let is_same =
                |entry: &&SiteCamera| entry.image.as_ref() == Some(&image) && entry.annotations.is_empty();
            if entry.filter(is_same).is_some() {
                let reasons: Vec<String> = calibration.reasons.iter().map(ToString::to_string).collect();
                report.set_calibration(&of, calibration.confidence, reasons.join("; "));
                usable.push((of, calibration));
            } else {
                let why = "its image or lines were changed during the calibration; calibrate it again".into();
                report.set_calibration(&of, Confidence::None, why);
            }
        }
        if !usable.is_empty() {
            self.act(Action::Automatic(AutomaticResult::Calibrations(usable)));
        }
    }

    /// Returns the cameras to place, or the reason why no camera can be placed.
    fn begin_placing(&self) -> Result<Reading, String> {
        let session = self.editor.session();
        let solved = session.solved.write_into(&session.site);
        let cameras = PlacementSearch::cameras(&solved)?;
        Ok(Reading { from: session.site.clone(), solved, cameras, images: Vec::new() })
    }

    /// Reads the next image, and starts the search after the last one.
    fn advance_reading(
        &mut self,
        ctx: &Context,
        report: &mut AutomaticReport,
        mut own: Box<Reading>,
    ) -> Result<Step, String> {
        if let Some(&camera) = own.cameras.get(own.images.len()) {
            let entry = &own.solved.cameras[camera];
            let name = entry.image.as_deref().unwrap_or_default();
            let images = &self.editor.session().images;
            let picture = self.pictures.get(ctx, name, || images.reader(name));
            let image = picture.map(|picture| Arc::clone(&picture.image));
            if let Some(error) = self.pictures.error(name) {
                report.set_placement(&Period::from_camera(entry), RowPlacement::Unknown, unreadable(error));
                own.cameras.retain(|&other| other != camera);
                if own.cameras.is_empty() || own.cameras.len() < 2 && own.solved.plan.is_none() {
                    return Err("too few images could be read".into());
                }
                ctx.request_repaint();
            } else if let Some(image) = image {
                let small = shrunk(&image, PlacementSearch::SIDE_PX);
                own.images.push(small.unwrap_or_else(|| (*image).clone()));
                ctx.request_repaint();
            }
            return Ok(Step::Reading(own));
        }
        let has_plan = own.solved.plan.as_ref().is_some_and(|plan| plan.image.is_some());
        let plan = if has_plan && self.plan_error().is_none() {
            let plan = self.loaded_plan(ctx).map(|picture| Arc::clone(&picture.image));
            if plan.is_none() {
                ctx.request_repaint();
                return Ok(Step::Reading(own));
            }
            plan
        } else {
            None
        };
        let progress = Arc::new(Progress::default());
        let count = own.cameras.len();
        let asked = PlacementRequest { site: own.solved, cameras: own.cameras, images: own.images, plan };
        let task = Here::place(ctx, asked, &progress);
        Ok(Step::Placing(Box::new(Placing { from: own.from, task, progress, count })))
    }

    fn advance_placing(
        &mut self,
        ctx: &Context,
        report: &mut AutomaticReport,
        own: Box<Placing>,
    ) -> Result<Option<Step>, String> {
        /// Interval at which the status line updates the progress, in seconds.
        const INTERVAL_S: f32 = 0.25;
        let Some(found) = finished_result(&own.task) else {
            ctx.request_repaint_after_secs(INTERVAL_S);
            return Ok(Some(Step::Placing(own)));
        };
        let found = found?;
        if *self.editor.site() != own.from {
            return Err("the site was changed during the search, so no camera was placed; press Shift+A \
                        to search again"
                .into());
        }
        for (entry, camera) in own.from.cameras.iter().zip(&found.cameras) {
            let of = Period::from_camera(entry);
            let is_unreadable = report.row(&of).is_some_and(|row| row.placement.is_some());
            if is_unreadable {
                continue;
            }
            let placement = match (&camera.placement, camera.is_kept) {
                (Some(_), _) => RowPlacement::Placed,
                (None, true) => RowPlacement::Kept,
                (None, false) => RowPlacement::Unknown,
            };
            report.set_placement(&of, placement, camera.reason.clone());
        }
        report.summary.clone_from(&found.reason);
        self.act(Action::Automatic(AutomaticResult::Placement(Box::new(found))));
        Ok(None)
    }
}

/// Returns the message about an image that could not be read.
fn unreadable(error: &str) -> String {
    format!("the image could not be read: {}", error.trim_end_matches('.'))
}

impl AutomaticReport {
    fn row(&mut self, of: &Period) -> Option<&mut AutomaticRow> {
        self.rows.iter_mut().find(|row| row.of == *of)
    }

    fn set_calibration(&mut self, of: &Period, confidence: Confidence, reason: String) {
        if let Some(row) = self.row(of) {
            row.calibration = Some((confidence, reason));
        }
    }

    fn set_placement(&mut self, of: &Period, placement: RowPlacement, reason: String) {
        if let Some(row) = self.row(of) {
            row.placement = Some((placement, reason));
        }
    }
}

impl AutomaticRow {
    /// Whether this run calibrated the image.
    pub(crate) fn is_calibrated(&self) -> bool {
        self.calibration.as_ref().is_some_and(|(confidence, _)| *confidence != Confidence::None)
    }
}
