//! Background tasks: detection of straight edges, joint refinement of a site, automatic calibration of an image.

use std::collections::BTreeMap;
use std::sync::Arc;

use calib_editor::{Edge, Period};
use calib_image::{AutomaticCalibration, ImageEdges};
use calib_site::{Site, SiteCamera};
use egui::Context;
use image::RgbImage;

use crate::platform::{Here, Lost, Platform as _, Task};

#[derive(Debug)]
enum State {
    Looking(Task<Vec<Edge>>),
    Found(Vec<Edge>),
}

/// Detected edges of all images.
#[derive(Debug, Default)]
pub struct Edges {
    stills: BTreeMap<String, State>,
    stopped: bool,
}

impl Edges {
    /// Returns the edges of an image; empty until they are detected. The first call starts the detection, unless `stop`
    /// was called.
    pub fn of(&mut self, ctx: &Context, name: &str, image: &Arc<RgbImage>) -> &[Edge] {
        if self.stopped && !self.stills.contains_key(name) {
            return &[];
        }
        let look = || State::Looking(Here::find_edges(ctx, image));
        match self.stills.entry(name.to_owned()).or_insert_with(look) {
            State::Found(edges) => edges,
            State::Looking(_) => &[],
        }
    }

    /// Collects finished detections at the beginning of a frame.
    pub fn begin_frame(&mut self) {
        for state in self.stills.values_mut() {
            if let State::Looking(task) = state
                && let Some(edges) = task.poll()
            {
                *state = State::Found(edges);
            }
        }
    }

    /// Returns the number of running detections.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.stills.values().filter(|state| matches!(state, State::Looking(_))).count()
    }

    /// Cancels running detections; no detection starts until `resume` is called.
    pub fn stop(&mut self) {
        self.stopped = true;
        self.stills.retain(|_, state| matches!(state, State::Found(_)));
    }

    /// Allows edge detections again after `stop`.
    pub const fn resume(&mut self) {
        self.stopped = false;
    }

    /// Removes the edges of all images, and allows detections.
    pub fn clear(&mut self) {
        self.stills.clear();
        self.stopped = false;
    }
}

/// Joint refinement that is running.
#[derive(Debug)]
pub(crate) struct Refining {
    /// Site at the start of the refinement.
    pub from: Site,
    task: Task<Result<Site, String>>,
}

impl Refining {
    /// Starts the refinement of a site.
    #[must_use]
    pub(crate) fn begin(ctx: &Context, site: &Site) -> Self {
        Self { from: site.clone(), task: Here::refine(ctx, site.clone()) }
    }

    /// Returns the refined site when the refinement has ended. The method must not be called again after that.
    #[must_use]
    pub(crate) fn poll(&self) -> Option<Result<Site, String>> {
        let lost = |_| "internal error; please report this".to_owned();
        Some(self.task.outcome()?.map_err(lost).flatten())
    }
}

impl Drop for Refining {
    fn drop(&mut self) {
        Here::stop_refining();
    }
}

#[derive(Debug)]
enum Step {
    /// Reading and decoding of the image.
    Reading,
    /// Measurement of the edges.
    Measuring(Task<Result<ImageEdges, String>>),
    /// Grouping of the edges by direction, and calibration.
    Grouping(Task<Result<AutomaticCalibration, String>>),
}

/// Automatic calibration that is running.
#[derive(Debug)]
pub(crate) struct Proposing {
    /// Camera entry without annotations.
    camera: SiteCamera,
    image: String,
    step: Step,
}

impl Proposing {
    /// Creates a calibration that starts as soon as the image is decoded.
    #[must_use]
    pub(crate) const fn new(camera: SiteCamera, image: String) -> Self {
        Self { camera, image, step: Step::Reading }
    }

    /// Returns the camera period that is being calibrated.
    #[must_use]
    pub(crate) fn of(&self) -> Period {
        Period::from_camera(&self.camera)
    }

    /// Returns the image names in the running calibration, to rename them after a save to another folder.
    pub(crate) fn images_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.camera.image.iter_mut().chain([&mut self.image])
    }

    /// Returns the name of the image that is being calibrated.
    #[must_use]
    pub(crate) fn image(&self) -> &str {
        &self.image
    }

    /// Returns the running step as a phrase for the status line.
    #[must_use]
    pub(crate) const fn doing(&self) -> &'static str {
        match self.step {
            Step::Reading => "calibrating: reading the image",
            Step::Measuring(_) => "calibrating: measuring edges (step 1 of 2)",
            Step::Grouping(_) => "calibrating: finding directions (step 2 of 2)",
        }
    }

    /// Advances the calibration; returns its result when it has ended. `picture` is the image once it is
    /// decoded.
    pub(crate) fn poll(
        &mut self,
        ctx: &Context,
        picture: Option<&Arc<RgbImage>>,
    ) -> Option<Result<AutomaticCalibration, String>> {
        match &self.step {
            Step::Reading => self.step = Step::Measuring(Here::measure_edges(ctx, picture?)),
            Step::Measuring(task) => match finished_result(task)? {
                Ok(edges) => self.step = Step::Grouping(Here::propose(ctx, self.camera.clone(), edges)),
                Err(error) => return Some(Err(error)),
            },
            Step::Grouping(task) => return finished_result(task),
        }
        None
    }
}

impl Drop for Proposing {
    fn drop(&mut self) {
        Here::stop_proposing();
    }
}

/// Returns the result of a task that has ended; a panic becomes an error.
pub(crate) fn finished_result<T: Send + 'static>(
    task: &Task<Result<T, String>>,
) -> Option<Result<T, String>> {
    Some(task.outcome()?.map_err(|Lost| "internal error; please report this".to_owned()).flatten())
}
