//! Comparison of newer images with calibrated images, and recovery of cameras that moved.

use std::sync::Arc;

use calib_core::Camera;
use calib_editor::{Action, NewImage, NewerAction, NewerImage, Period};
use calib_image::{Comparison, ComparisonError, SizeMismatchError};
use calib_site::{NewImage as RecoveredStill, Recovered, Site, SiteCamera};
use egui::Context;

use crate::platform::{Here, Lost, Platform as _, Recovery, Stills, Task};
use crate::state::{App, Read, ReadPicture};

/// Newer image with the camera period to which it belongs.
#[derive(Debug)]
pub(crate) struct OfCamera {
    /// Camera entry with its solution.
    pub(crate) entry: SiteCamera,
    /// Pose of the calibrated camera.
    pub(crate) pose: Camera,
    /// Newer image.
    pub(crate) still: NewImage,
    /// Time at which the newer image was taken (RFC 3339).
    pub(crate) taken: Option<String>,
}

#[derive(Debug)]
pub(crate) enum Step {
    /// Reading of the file of the newer image.
    Opening(Task<Read>),
    /// Decoding of the old and the newer image.
    Reading(Box<OfCamera>),
    /// Comparison of the two images.
    Comparing(Box<OfCamera>, Task<Result<Comparison, String>>),
}

/// Comparison that is waiting or running.
#[derive(Debug)]
pub(crate) struct Comparing {
    /// Id of the camera.
    pub(crate) camera: String,
    pub(crate) step: Step,
}

impl Comparing {
    /// Creates a comparison that begins with reading the file of the newer image.
    pub(crate) const fn new(camera: String, opening: Task<Read>) -> Self {
        Self { camera, step: Step::Opening(opening) }
    }

    /// Returns the image names in the comparison, to rename them after a save to another folder.
    pub(crate) fn images_mut(&mut self) -> impl Iterator<Item = &mut String> {
        let of = match &mut self.step {
            Step::Opening(_) => None,
            Step::Reading(of) | Step::Comparing(of, _) => Some(of),
        };
        of.into_iter().flat_map(|of| of.entry.image.iter_mut().chain([&mut of.still.image]))
    }
}

/// Recovery that is running.
#[derive(Debug)]
pub(crate) struct Recovering {
    /// Camera period that is recovered.
    pub(crate) of: Period,
    /// Site at the start of the recovery.
    pub(crate) from: Site,
    pub(crate) task: Task<Result<Recovered, String>>,
}

impl App {
    /// Whether a comparison or a recovery is running.
    #[must_use]
    pub fn is_comparing(&self) -> bool {
        !self.jobs.comparing.is_empty() || self.jobs.recovering.is_some()
    }

    /// Whether the current camera is being recovered; its images and annotations must not change meanwhile.
    pub(crate) fn is_recovering_in_hand(&self) -> bool {
        let entry = self.editor.session().entry();
        self.jobs.recovering.as_ref().zip(entry).is_some_and(|(own, entry)| own.of.matches(entry))
    }

    /// Returns the running comparison or recovery as a phrase for the status line.
    pub(crate) fn doing_newer(&self) -> Option<String> {
        if let Some(recovering) = &self.jobs.recovering {
            return Some(format!("recovering {}", recovering.of.camera));
        }
        let first = self.jobs.comparing.front()?;
        let others = match self.jobs.comparing.len() {
            1 => String::new(),
            count => format!(", {} more waiting", count - 1),
        };
        Some(format!("comparing a newer image of {}{others}", first.camera))
    }

    /// Cancels all comparisons and the recovery.
    pub(crate) fn stop_comparing(&mut self) {
        self.jobs.comparing.clear();
        self.jobs.recovering = None;
        Here::stop_comparing();
    }

    /// Advances the first comparison. Only one comparison runs at a time, because it needs the memory of two
    /// images.
    pub(crate) fn poll_comparing(&mut self, ctx: &Context) {
        let Some(Comparing { camera, step }) = self.jobs.comparing.pop_front() else { return };
        match self.advance(ctx, &camera, step) {
            Ok(Some(step)) => self.jobs.comparing.push_front(Comparing { camera, step }),
            // The next comparison begins with the next frame.
            Ok(None) => ctx.request_repaint(),
            Err(error) => {
                let error = error.trim_end_matches('.');
                let message = format!("The newer image of {camera} was not compared: {error}.");
                self.act(Action::AddError(message));
            }
        }
    }

    /// Advances a comparison; returns its next step, or `None` at the end.
    fn advance(&mut self, ctx: &Context, camera: &str, step: Step) -> Result<Option<Step>, String> {
        match step {
            Step::Opening(task) => match task.outcome() {
                None => Ok(Some(Step::Opening(task))),
                Some(read) => {
                    let read = read
                        .map_err(|Lost| "its file could not be read; choose it again".to_owned())
                        .flatten()?;
                    self.calibrated_period(camera, read).map(|asked| Some(Step::Reading(Box::new(asked))))
                }
            },
            Step::Reading(asked) => Ok(Some(match self.decoded_images(ctx, &asked)? {
                Some(stills) => {
                    let task = Here::compare(ctx, asked.entry.clone(), stills);
                    Step::Comparing(asked, task)
                }
                None => Step::Reading(asked),
            })),
            Step::Comparing(asked, task) => {
                let Some(found) = task.outcome() else { return Ok(Some(Step::Comparing(asked, task))) };
                let comparison =
                    found.map_err(|Lost| "internal error; please report this".to_owned()).flatten()?;
                let OfCamera { entry, pose, still, taken } = *asked;
                let names = [entry.image.as_deref().unwrap_or_default(), &still.image];
                let captured = names.map(|name| self.captured(name));
                self.act(Action::Newer(NewerAction::Compared(Box::new(NewerImage {
                    ids: [entry.id].into(),
                    period: [entry.valid_from, entry.valid_to],
                    old: entry.image,
                    image: still.image,
                    title: still.title,
                    since: taken.unwrap_or_default(),
                    captured,
                    pose,
                    comparison,
                }))));
                Ok(None)
            }
        }
    }

    /// Returns the calibrated camera period in which a newer image was taken.
    fn calibrated_period(&self, camera: &str, read: ReadPicture) -> Result<OfCamera, String> {
        let session = self.editor.session();
        let ReadPicture { still, taken, .. } = read;
        let none = || "no calibration of this camera is valid at the time of this image".to_owned();
        let index = session.site.entry_index_at(camera, taken.as_deref()).ok_or_else(none)?;
        let pose = session.solved.pose(index).copied();
        let pose = pose.ok_or_else(|| ComparisonError::NotCalibrated.to_string())?;
        let entry = session.solved.write_into(&session.site).cameras.swap_remove(index);
        if entry.image.is_none() {
            return Err("this camera has no image to compare with".into());
        }
        if entry.size_px != still.size {
            return Err(SizeMismatchError { old: entry.size_px, new: still.size }.to_string());
        }
        Ok(OfCamera { entry, pose, still, taken })
    }

    /// Returns the capture time in the EXIF data of an image (RFC 3339).
    fn captured(&self, name: &str) -> Option<String> {
        let source = self.editor.session().images.reader(name);
        let bytes = source.name_to_render().is_none().then(|| source.read(Here::read_within))?;
        calib_input::capture_time(&bytes.ok()?)
    }

    /// Returns the old and the newer image once both are decoded.
    fn decoded_images(&mut self, ctx: &Context, asked: &OfCamera) -> Result<Option<Stills>, String> {
        let names = [asked.entry.image.as_deref().unwrap_or_default(), &asked.still.image];
        let images = &self.editor.session().images;
        let found = names.map(|name| {
            let picture = self.pictures.get(ctx, name, || images.reader(name));
            picture.map(|picture| Arc::clone(&picture.image))
        });
        if let Some(error) = names.into_iter().find_map(|name| self.pictures.error(name)) {
            return Err(format!("an image for the comparison could not be read: {error}"));
        }
        let [old, new] = found;
        Ok(old.zip(new).map(|(old, new)| [old, new]))
    }

    /// Starts the recovery of the current camera from its newer image.
    pub(crate) fn recover_newer(&mut self, ctx: &Context) {
        let session = self.editor.session();
        let newer = self.editor.selected_newer().filter(|newer| newer.has_moved());
        let (Some(newer), Some(entry), None) = (newer.cloned(), session.entry(), &self.jobs.recovering)
        else {
            return;
        };
        let of = Period::from_camera(entry);
        let why_not = match entry.is_valid_at(newer.since.trim()) {
            Err(_) => Some("enter the time when the new pose becomes valid, such as 2026-05-01T08:00:00Z"),
            Ok(false) => Some("this time is outside the calibration period; enter a time inside the period"),
            // The measured change refers to the pose at the time of the comparison.
            Ok(true) if session.solved.pose(session.camera) != Some(&newer.pose) => {
                Some("the camera was solved again after the comparison; compare it again")
            }
            Ok(true) => None,
        };
        if let Some(why) = why_not {
            return self.act(Action::Note(format!("{}: {why}.", of.camera)));
        }
        let name = entry.image.clone().unwrap_or_default();
        let names = [&name, &newer.image];
        let failed = names.into_iter().find_map(|name| Some((name, self.pictures.error(name)?)));
        if let Some((name, error)) = failed {
            let image = self.editor.session().images.shown_name(name);
            return self.act(Action::AddError(format!("{}: {image} cannot be used: {error}", of.camera)));
        }
        let stills = names.map(|name| self.pictures.ready(name).map(|own| Arc::clone(&own.image)));
        let [Some(old), Some(new)] = stills else {
            return self
                .act(Action::Note("The images are still loading. Press Recover again in a moment.".into()));
        };
        self.act(Action::CancelGesture);
        let session = self.editor.session();
        let from = session.site.clone();
        let asked = Recovery {
            site: session.solved.write_into(&from),
            index: session.camera,
            comparison: newer.comparison,
            still: RecoveredStill { image: newer.image, since: newer.since.trim().to_owned() },
        };
        self.jobs.recovering = Some(Recovering { of, from, task: Here::recover(ctx, asked, [old, new]) });
    }

    pub(crate) fn poll_recovering(&mut self) {
        let Some(recovering) = self.jobs.recovering.take() else { return };
        let Some(found) = recovering.task.outcome() else {
            self.jobs.recovering = Some(recovering);
            return;
        };
        let Recovering { of, from, .. } = recovering;
        let camera = of.camera;
        match found.map_err(|Lost| "internal error; please report this".to_owned()).flatten() {
            Ok(found) => self.act(Action::Newer(NewerAction::Recovered(camera, Box::new((from, found))))),
            Err(why) => {
                let why = why.trim_end_matches('.');
                self.act(Action::AddError(format!("{camera} was not recovered: {why}.")));
            }
        }
    }
}
