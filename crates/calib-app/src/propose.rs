//! What a still proposes, looked for off the frame's path: first its edges, then what they have in common.

use std::sync::Arc;

use calib_editor::Period;
use calib_image::{LineSegment, Proposal};
use calib_site::SiteCamera;
use egui::Context;
use image::RgbImage;

use crate::platform::{Here, Lost, Platform as _, Task};

#[derive(Debug)]
enum Step {
    /// The image is being read.
    Reading,
    Measuring(Task<Result<Vec<LineSegment>, String>>),
    Grouping(Task<Result<Proposal, String>>),
}

/// A proposal that is being looked for.
#[derive(Debug)]
pub struct Proposing {
    /// The camera with nothing drawn.
    camera: SiteCamera,
    image: String,
    step: Step,
}

impl Proposing {
    /// Begins to look, as soon as the image is there.
    #[must_use]
    pub const fn new(camera: SiteCamera, image: String) -> Self {
        Self { camera, image, step: Step::Reading }
    }

    /// The camera.
    #[must_use]
    pub fn of(&self) -> Period {
        Period::of(&self.camera)
    }

    /// The names by which it knows images.
    pub(crate) fn images_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.camera.image.iter_mut().chain([&mut self.image])
    }

    /// The name of its image.
    #[must_use]
    pub fn image(&self) -> &str {
        &self.image
    }

    /// How far it is.
    #[must_use]
    pub const fn doing(&self) -> &'static str {
        match self.step {
            Step::Reading => "proposing: reading the image",
            Step::Measuring(_) => "proposing: measuring edges, 1 of 2",
            Step::Grouping(_) => "proposing: finding directions, 2 of 2",
        }
    }

    /// The proposal, once; the image is looked at when it is there.
    pub fn poll(
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
