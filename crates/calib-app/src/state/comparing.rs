//! Newer stills that are being compared, and a camera that is being recovered.

use calib_core::Camera;

use calib_editor::{NewStill, Period};
use calib_image::Comparison;
use calib_site::{Recovered, Site, SiteCamera};

use super::Read;
use crate::platform::Task;

/// A newer still of which it is known whose it is.
#[derive(Debug)]
pub(crate) struct OfCamera {
    /// The camera with its solution.
    pub(crate) entry: SiteCamera,
    pub(crate) pose: Camera,
    pub(crate) still: NewStill,
    pub(crate) taken: Option<String>,
}

#[derive(Debug)]
pub(crate) enum Step {
    /// The file is being read.
    Opening(Task<Read>),
    /// Both images are being decoded.
    Reading(Box<OfCamera>),
    Comparing(Box<OfCamera>, Task<Result<Comparison, String>>),
}

/// A newer still that is being compared.
#[derive(Debug)]
pub(crate) struct Comparing {
    /// The id of its camera.
    pub(crate) camera: String,
    pub(crate) step: Step,
}

impl Comparing {
    /// Begins with reading its file.
    pub(crate) const fn new(camera: String, opening: Task<Read>) -> Self {
        Self { camera, step: Step::Opening(opening) }
    }

    /// The names by which it knows images.
    pub(crate) fn images_mut(&mut self) -> impl Iterator<Item = &mut String> {
        let of = match &mut self.step {
            Step::Opening(_) => None,
            Step::Reading(of) | Step::Comparing(of, _) => Some(of),
        };
        of.into_iter().flat_map(|of| of.entry.image.iter_mut().chain([&mut of.still.image]))
    }
}

/// A camera that is being recovered.
#[derive(Debug)]
pub(crate) struct Recovering {
    pub(crate) of: Period,
    /// The site when it was asked for.
    pub(crate) from: Site,
    pub(crate) task: Task<Result<Recovered, String>>,
}
