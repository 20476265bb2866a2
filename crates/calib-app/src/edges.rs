//! The straight edges of every still, found once and off the frame's path.
//!
//! The joint solve of a whole site, off the frame's path.
//!
//! What a still proposes, looked for off the frame's path: first its edges, then what they have in common.

use std::collections::BTreeMap;
use std::sync::Arc;

use calib_editor::{Edge, Period};
use calib_image::{LineSegment, Proposal};
use calib_site::{Site, SiteCamera};
use egui::Context;
use image::RgbImage;

use crate::platform::{Here, Lost, Platform as _, Task};

#[derive(Debug)]
enum State {
    Looking(Task<Vec<Edge>>),
    Found(Vec<Edge>),
}

/// The edges of every still that was asked for.
#[derive(Debug, Default)]
pub struct Edges {
    stills: BTreeMap<String, State>,
    stopped: bool,
}

impl Edges {
    /// The edges of a still; the first question starts the search.
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

    /// Begins a frame: finished work arrives, whether anybody asks for it or not.
    pub fn begin_frame(&mut self) {
        for state in self.stills.values_mut() {
            if let State::Looking(task) = state
                && let Some(edges) = task.poll()
            {
                *state = State::Found(edges);
            }
        }
    }

    /// How many stills are being searched.
    #[must_use]
    pub fn looking(&self) -> usize {
        self.stills.values().filter(|state| matches!(state, State::Looking(_))).count()
    }

    /// Looks no further, until it is told to.
    pub fn stop(&mut self) {
        self.stopped = true;
        self.stills.retain(|_, state| matches!(state, State::Found(_)));
    }

    /// Looks on.
    pub const fn resume(&mut self) {
        self.stopped = false;
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.stills.clear();
        self.stopped = false;
    }
}

/// A joint solve that is under way.
#[derive(Debug)]
pub(crate) struct Refining {
    /// What is refined.
    pub from: Site,
    task: Task<Result<Site, String>>,
}

impl Refining {
    /// Begins to refine a site.
    #[must_use]
    pub(crate) fn begin(ctx: &Context, site: &Site) -> Self {
        Self { from: site.clone(), task: Here::refine(ctx, site.clone()) }
    }

    /// The refined site, once.
    #[must_use]
    pub(crate) fn poll(&self) -> Option<Result<Site, String>> {
        let lost = |_| "the solve ended without a result".to_owned();
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
    Grouping(Task<Result<Proposal, String>>),
}

/// A proposal that is being looked for.
#[derive(Debug)]
pub(crate) struct Proposing {
    /// The camera with nothing drawn.
    camera: SiteCamera,
    image: String,
    step: Step,
}

impl Proposing {
    /// Begins to look, as soon as the image is there.
    #[must_use]
    pub(crate) const fn new(camera: SiteCamera, image: String) -> Self {
        Self { camera, image, step: Step::Reading }
    }

    /// The camera.
    #[must_use]
    pub(crate) fn of(&self) -> Period {
        Period::of(&self.camera)
    }

    /// The names by which it knows images.
    pub(crate) fn images_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.camera.image.iter_mut().chain([&mut self.image])
    }

    /// The name of its image.
    #[must_use]
    pub(crate) fn image(&self) -> &str {
        &self.image
    }

    /// How far it is.
    #[must_use]
    pub(crate) const fn doing(&self) -> &'static str {
        match self.step {
            Step::Reading => "proposing: reading the image",
            Step::Measuring(_) => "proposing: measuring edges, 1 of 2",
            Step::Grouping(_) => "proposing: finding directions, 2 of 2",
        }
    }

    /// The proposal, once; the image is looked at when it is there.
    pub(crate) fn poll(
        &mut self,
        ctx: &Context,
        picture: Option<&Arc<RgbImage>>,
    ) -> Option<Result<Proposal, String>> {
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
    Some(task.outcome()?.map_err(|Lost| "it ended without a result".to_owned()).flatten())
}
