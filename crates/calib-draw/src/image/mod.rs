//! Overlays of a camera's image, in raw pixels.
//!
//! Geometry outside the image is not clipped, because a canvas may be larger than the image. Geometry outside
//! the camera's view or its lens model is omitted. The files: `annotation` for lines and control points, `floor`
//! for grid, planes and fields of view, `horizon` for horizon and lens grid, `mark` for marks and links.

mod floor;
mod horizon;
mod mark;
mod annotation;

use calib_core::{Camera, Lens, Pixel, Plane, WorldPoint};

use calib_core::floor::annotated_line_curve;

use calib_site::{Site, SiteCamera, Solution};

pub use annotation::{Signs, extension};
pub use floor::grid_step;
pub use horizon::horizon;
pub use mark::guide;

use crate::item::Item;
use crate::item::Meaning;
use crate::scene::Scene;

/// Layer of an image overlay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImageLayer {
    /// Grid of lines that are straight in the scene, curved by the distortion.
    LensGrid,
    /// Metre grid on the plane of the EFOV, which is usually the floor. The value is the distance of grid
    /// lines in metres.
    Grid(f64),
    /// Regions of the planes other than the floor, with their names.
    Planes,
    /// Effective field of view (EFOV) as annotated by the operator.
    AnnotatedEfov,
    /// Prism over the annotated EFOV.
    AnnotatedPrism,
    /// Solved EFOV, annotated or automatic, and the prism over it.
    SolvedEfov,
    /// EFOVs of other placed cameras.
    OtherEfovs,
    /// Horizon, curved by the distortion.
    Horizon,
    /// Marks: virtual elements on the floor.
    Marks,
    /// Corners of marks at the pixels to which the operator pinned them.
    Pins,
    /// Annotated lines; the value selects their signs.
    Annotations(Signs),
    /// Control points, including those that are switched off.
    ControlPoints,
    /// Links as annotated by the operator.
    Links {
        /// Index of a link that needs an observation in another view, if any.
        incomplete: Option<usize>,
    },
    /// Solved links and marks: observed and reprojected points.
    Observations,
}

/// Image of a camera with the results that its overlays show.
#[derive(Clone, Copy, Debug)]
pub struct ImageView<'a> {
    pub(crate) scene: &'a dyn Scene,
    pub(crate) camera: usize,
    pub(crate) pose: Option<Camera>,
    pub(crate) label_scale: Option<f64>,
}

impl<'a> ImageView<'a> {
    /// Creates the view of the camera with this index, without labels.
    #[must_use]
    pub fn new(scene: &'a dyn Scene, camera: usize) -> Self {
        Self { scene, camera, pose: scene.pose(camera), label_scale: None }
    }

    /// Adds labels to the overlays: names of lines, metres of the grid, and the word "horizon". `scale` is
    /// the size of letters relative to the screen.
    #[must_use]
    pub fn with_labels(self, scale: f64) -> Self {
        Self { label_scale: Some(scale), ..self }
    }

    fn site(&self) -> &'a Site {
        self.scene.site()
    }

    fn entry(&self) -> Option<&'a SiteCamera> {
        self.site().cameras.get(self.camera)
    }

    /// Returns the lens for drawing lines: the solved lens, otherwise the most likely one. A lens may be
    /// known without the pose.
    fn lens(&self) -> Option<Lens> {
        let found = self.scene.solution(self.camera).map(Solution::lens);
        found.or_else(|| self.entry().map(SiteCamera::likely_lens))
    }

    /// Returns the curve of an annotated line in raw pixels, as distorted by the lens.
    fn image_curve(&self, points: Vec<Pixel>) -> Vec<Pixel> {
        match self.lens() {
            Some(lens) => annotated_line_curve(&lens, &points),
            None => points,
        }
    }

    /// Returns the plane of a camera's EFOV; the floor if the EFOV is not annotated.
    fn efov_plane(&self, camera: usize) -> Plane {
        let entry = self.site().cameras.get(camera).filter(|entry| entry.efov_px.is_some());
        self.scene.plane(entry.and_then(|entry| entry.efov_plane.as_deref()))
    }

    /// Returns the pose and lens of the camera, with its solution.
    fn solved(&self) -> Option<(Camera, &'a Solution)> {
        self.pose.zip(self.scene.solution(self.camera))
    }
}

impl ImageLayer {
    fn items(self, view: &ImageView) -> Vec<Item<Pixel>> {
        match self {
            Self::LensGrid => horizon::lens_grid(view),
            Self::Grid(step) => floor::grid(view, step),
            Self::Planes => floor::planes(view),
            Self::AnnotatedEfov => floor::annotated_efov(view),
            Self::AnnotatedPrism => floor::annotated_prism(view),
            Self::SolvedEfov => floor::solved_efov(view),
            Self::OtherEfovs => floor::other_efovs(view),
            Self::Horizon => horizon::horizon_items(view),
            Self::Marks => mark::marks(view),
            Self::Pins => mark::pins(view),
            Self::Annotations(signs) => annotation::annotations(view, signs),
            Self::ControlPoints => annotation::control_points(view),
            Self::Links { incomplete: begun } => mark::links(view, begun),
            Self::Observations => mark::sightings(view),
        }
    }
}

/// Returns the items of some layers on an image, in drawing order: the first layer is the lowest.
#[must_use]
pub fn on_image(view: &ImageView, layers: &[ImageLayer]) -> Vec<Item<Pixel>> {
    layers.iter().flat_map(|layer| layer.items(view)).collect()
}

/// Projects a polyline from world metres into raw pixels; parts that the camera does not show are omitted.
#[must_use]
pub fn project(camera: &Camera, meaning: Meaning, polyline: &[WorldPoint]) -> Vec<Item<Pixel>> {
    let pieces = calib_core::on_image(camera, polyline).into_iter();
    pieces.map(|piece| Item::polyline(meaning, piece)).collect()
}
