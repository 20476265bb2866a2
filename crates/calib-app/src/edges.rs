//! Background searches: straight edges of images, joint refinement of a site, automatic calibration of an
//! image.

use std::collections::BTreeMap;
use std::sync::Arc;

use calib_editor::{Edge, Period};
use calib_image::{AutomaticCalibration, LineSegment};
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
    /// Returns the edges of an image; the first call starts the detection.
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
    pub fn looking(&self) -> usize {
        self.stills.values().filter(|state| matches!(state, State::Looking(_))).count()
    }

    /// Starts no more detections until `resume`.
    pub fn stop(&mut self) {
        self.stopped = true;
        self.stills.retain(|_, state| matches!(state, State::Found(_)));
    }

    /// Allows detections again.
    pub const fn resume(&mut self) {
        self.stopped = false;
    }

    /// Removes all edges.
    pub fn clear(&mut self) {
        self.stills.clear();
        self.stopped = false;
    }
}

/// Joint refinement that is running.
#[derive(Debug)]
pub(crate) struct Refining {
    /// The site at its start.
    pub from: Site,
    task: Task<Result<Site, String>>,
}

impl Refining {
    /// Starts the refinement of a site.
    #[must_use]
    pub(crate) fn begin(ctx: &Context, site: &Site) -> Self {
        Self { from: site.clone(), task: Here::refine(ctx, site.clone()) }
    }

    /// Returns the refined site once.
    #[must_use]
    pub(crate) fn poll(&self) -> Option<Result<Site, String>> {
        let lost = |_| "The refinement failed. Please report this.".to_owned();
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
    /// The image is being read.
    Reading,
    Measuring(Task<Result<Vec<LineSegment>, String>>),
    Grouping(Task<Result<AutomaticCalibration, String>>),
}

/// Automatic calibration that is running.
#[derive(Debug)]
pub(crate) struct Proposing {
    /// The camera without annotations.
    camera: SiteCamera,
    image: String,
    step: Step,
}

impl Proposing {
    /// Starts the calibration as soon as the image is decoded.
    #[must_use]
    pub(crate) const fn new(camera: SiteCamera, image: String) -> Self {
        Self { camera, image, step: Step::Reading }
    }

    /// Returns the camera period.
    #[must_use]
    pub(crate) fn of(&self) -> Period {
        Period::from_camera(&self.camera)
    }

    /// Returns the image names that it contains, to rename them.
    pub(crate) fn images_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.camera.image.iter_mut().chain([&mut self.image])
    }

    /// Returns the name of its image.
    #[must_use]
    pub(crate) fn image(&self) -> &str {
        &self.image
    }

    /// Returns the running step as a phrase.
    #[must_use]
    pub(crate) const fn doing(&self) -> &'static str {
        match self.step {
            Step::Reading => "calibrating: reading the image",
            Step::Measuring(_) => "calibrating: measuring edges, 1 of 2",
            Step::Grouping(_) => "calibrating: finding directions, 2 of 2",
        }
    }

    /// Advances the calibration, and returns its result once.
    pub(crate) fn poll(
        &mut self,
        ctx: &Context,
        picture: Option<&Arc<RgbImage>>,
    ) -> Option<Result<AutomaticCalibration, String>> {
        match &self.step {
            Step::Reading => self.step = Step::Measuring(Here::measure_edges(ctx, picture?)),
            Step::Measuring(task) => match ended(task)? {
                Ok(edges) => self.step = Step::Grouping(Here::propose(ctx, self.camera.clone(), edges)),
                Err(error) => return Some(Err(error)),
            },
            Step::Grouping(task) => return ended(task),
        }
        None
    }
}

impl Drop for Proposing {
    fn drop(&mut self) {
        Here::stop_proposing();
    }
}

fn ended<T: Send + 'static>(task: &Task<Result<T, String>>) -> Option<Result<T, String>> {
    Some(task.outcome()?.map_err(|Lost| "it failed without a result".to_owned()).flatten())
}
