//! Automatic calibration and placement of all cameras of a site.

use std::collections::VecDeque;
use std::sync::Arc;

use calib_editor::{Action, Period};
use calib_image::{AutomaticCalibration, Confidence, PlacementSearch, SitePlacement};
use calib_site::{Site, SiteCamera, counted};
use egui::Context;
use image::RgbImage;

use crate::edges::Proposing;
use crate::platform::{Here, Lost, PlacementRequest, Platform as _, Progress, Task, shrunk};
use crate::state::{App, Mode};

/// Longer side of the images from which cameras are placed, in pixels.
const PLACED_SIDE_PX: u32 = 960;

/// Result of the automatic calibration and placement of all cameras, for the operator.
#[derive(Clone, Debug, Default)]
pub(crate) struct AutomaticReport {
    /// Result of each camera.
    pub(crate) rows: Vec<AutomaticRow>,
    /// What is known of the placement of all cameras.
    pub(crate) summary: String,
}

/// Result of one camera.
#[derive(Clone, Debug)]
pub(crate) struct AutomaticRow {
    /// Camera and its calibration period.
    pub(crate) of: Period,
    /// Confidence of the automatic calibration and its reason; `None` if the camera was not calibrated now.
    pub(crate) calibration: Option<(Confidence, String)>,
    /// Whether the camera was placed now, and the reason; `None` if its place was not searched.
    pub(crate) placement: Option<(bool, String)>,
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
    /// Decoding of the images of the cameras that are placed.
    Reading(Box<Reading>),
    /// Search of the placements.
    Placing(Box<Placing>),
}

#[derive(Debug)]
struct Calibrating {
    /// Camera entries without annotations, and their images, that are calibrated next.
    waiting: VecDeque<(SiteCamera, String)>,
    running: Option<Proposing>,
    found: Vec<(Period, AutomaticCalibration)>,
    /// Number of images.
    count: usize,
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

    /// Returns the image names in the running work, to rename them after a save to another folder.
    pub(crate) fn images_mut(&mut self) -> impl Iterator<Item = &mut String> {
        let own = match &mut self.step {
            Step::Calibrating(own) => Some(own),
            _ => None,
        };
        own.into_iter().flat_map(|own| {
            let waiting = own.waiting.iter_mut();
            let waiting = waiting.flat_map(|(camera, image)| camera.image.iter_mut().chain([image]));
            waiting.chain(own.running.iter_mut().flat_map(Proposing::images_mut))
        })
    }
}

impl App {
    /// Starts the calibration of all images without annotations, and then the placement of the cameras.
    pub(crate) fn calibrate_all(&mut self) {
        if self.jobs.automatic.is_some() {
            return;
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
        let note = match step {
            Step::Calibrating(own) => {
                let (done, count) = (own.found.len(), own.count);
                self.keep_calibrations(&mut report, own.found);
                format!("Cancelled. {done} of {count} images were calibrated.")
            }
            _ => "Cancelled. No camera was placed.".into(),
        };
        self.act(Action::Note(note));
    }

    /// Advances the automatic calibration and placement.
    pub(crate) fn poll_automatic(&mut self, ctx: &Context) {
        let Some(Automatic { mut report, step }) = self.jobs.automatic.take() else { return };
        let next = match step {
            Step::Calibrating(own) => self.advance_calibrating(ctx, &mut report, own),
            Step::Reading(own) => self.advance_reading(ctx, own),
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
    ) -> Result<Option<Step>, String> {
        let Some(running) = own.running.as_mut() else {
            let Some((camera, image)) = own.waiting.pop_front() else {
                self.keep_calibrations(report, own.found);
                return self.begin_placing().map(|reading| Some(Step::Reading(Box::new(reading))));
            };
            own.running = Some(Proposing::new(camera, image));
            ctx.request_repaint();
            return Ok(Some(Step::Calibrating(own)));
        };
        let name = running.image().to_owned();
        let images = &self.editor.session().images;
        let picture = self.pictures.get(ctx, &name, || images.reader(&name));
        let picture = picture.map(|picture| Arc::clone(&picture.image));
        let result = match self.pictures.error(&name) {
            Some(error) => Some(Err(format!("the image could not be read: {error}"))),
            None => running.poll(ctx, picture.as_ref()),
        };
        let of = running.of();
        match result {
            None => return Ok(Some(Step::Calibrating(own))),
            Some(Ok(calibration)) => own.found.push((of, calibration)),
            Some(Err(error)) => {
                if let Some(row) = report.row(&of) {
                    row.calibration = Some((Confidence::None, error));
                }
            }
        }
        own.running = None;
        ctx.request_repaint();
        Ok(Some(Step::Calibrating(own)))
    }

    /// Writes the finished calibrations into the site and the report.
    fn keep_calibrations(
        &mut self,
        report: &mut AutomaticReport,
        found: Vec<(Period, AutomaticCalibration)>,
    ) {
        for (of, calibration) in &found {
            if let Some(row) = report.row(of) {
                let reasons: Vec<String> = calibration.reasons.iter().map(ToString::to_string).collect();
                row.calibration = Some((calibration.confidence, reasons.join("; ")));
            }
        }
        if !found.is_empty() {
            self.act(Action::SetAutomaticCalibrations(found));
        }
    }

    /// Returns the cameras to place, or the reason why no camera can be placed.
    fn begin_placing(&self) -> Result<Reading, String> {
        let session = self.editor.session();
        let solved = session.solved.write_into(&session.site);
        let cameras = PlacementSearch::cameras(&solved)?;
        Ok(Reading { from: session.site.clone(), solved, cameras, images: Vec::new() })
    }

    fn advance_reading(&mut self, ctx: &Context, mut own: Box<Reading>) -> Result<Option<Step>, String> {
        while let Some(&camera) = own.cameras.get(own.images.len()) {
            let entry = &own.solved.cameras[camera];
            let name = entry.image.as_deref().unwrap_or_default();
            let images = &self.editor.session().images;
            let picture = self.pictures.get(ctx, name, || images.reader(name));
            let image = picture.map(|picture| {
                shrunk(&picture.image, PLACED_SIDE_PX).unwrap_or_else(|| (*picture.image).clone())
            });
            if let Some(error) = self.pictures.error(name) {
                return Err(format!("the image of {} could not be read: {error}", entry.id));
            }
            let Some(image) = image else { return Ok(Some(Step::Reading(own))) };
            own.images.push(image);
        }
        let progress = Arc::new(Progress::default());
        let count = own.cameras.len();
        let asked = PlacementRequest { site: own.solved, cameras: own.cameras, images: own.images };
        let task = Here::place(ctx, asked, &progress);
        Ok(Some(Step::Placing(Box::new(Placing { from: own.from, task, progress, count }))))
    }

    fn advance_placing(
        &mut self,
        ctx: &Context,
        report: &mut AutomaticReport,
        own: Box<Placing>,
    ) -> Result<Option<Step>, String> {
        /// Interval in which the status line shows the progress, in seconds.
        const INTERVAL_S: f32 = 0.25;
        let Some(found) = own.task.outcome() else {
            ctx.request_repaint_after_secs(INTERVAL_S);
            return Ok(Some(Step::Placing(own)));
        };
        let found = found.map_err(|Lost| "internal error; please report this".to_owned()).flatten()?;
        for (entry, camera) in own.from.cameras.iter().zip(&found.cameras) {
            if let Some(row) = report.row(&Period::from_camera(entry)) {
                row.placement = Some((camera.placement.is_some(), camera.reason.clone()));
            }
        }
        report.summary.clone_from(&found.reason);
        // The plan shows where the cameras are; the operator checks them there.
        if found.cameras.iter().any(|camera| camera.placement.is_some()) {
            self.view.mode = Mode::Plan;
        }
        self.act(Action::PlaceByColours(Box::new((own.from.clone(), found))));
        Ok(None)
    }
}

impl AutomaticReport {
    fn row(&mut self, of: &Period) -> Option<&mut AutomaticRow> {
        self.rows.iter_mut().find(|row| row.of == *of)
    }
}
