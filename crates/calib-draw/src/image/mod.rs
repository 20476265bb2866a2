//! What is drawn on a camera's image, in raw pixels.
//!
//! What lies off the image is kept, so that a canvas larger than the image shows it; what the camera or its
//! lens cannot show is left out.

mod floor;
mod horizon;
mod mark;
mod annotation;

use calib_core::{Camera, Lens, Pixel, Plane, WorldPoint};

use calib_core::floor::drawn_line;

use calib_site::{Site, SiteCamera, Solution};

pub use annotation::{Signs, extension};
pub use floor::{metres, reach};
pub use horizon::horizon;
pub use mark::guide;

use crate::item::Item;
use crate::item::Meaning;
use crate::scene::Scene;

/// What can be drawn on an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImageLayer {
    /// What is straight in the scene, as the lens bends it.
    LensGrid,
    /// The metre grid of the floor, or of the plane that the EFOV lies on, with lines so many metres apart.
    Grid(f64),
    /// The regions of the planes besides the floor, with their names.
    Planes,
    /// The EFOV as the operator drew it.
    DrawnEfov,
    /// The prism over it.
    DrawnPrism,
    /// The EFOV as it was solved, drawn or not, and the prism over it.
    SolvedEfov,
    /// The EFOVs of other cameras that stand in the site.
    OtherEfovs,
    /// The horizon.
    Horizon,
    /// Virtual elements.
    Marks,
    /// Their corners where the operator saw them.
    Pins,
    /// Drawn lines with these signs.
    Annotations(Signs),
    /// Control points, used or not.
    ControlPoints,
    /// Links as they are drawn; `begun` is to be shown in a further view.
    Links {
        /// Index of that link.
        begun: Option<usize>,
    },
    /// Links and marks that were solved: where they were drawn, and where they are.
    Sightings,
}

/// The image of a camera to be drawn on.
#[derive(Clone, Copy, Debug)]
pub struct ImageView<'a> {
    pub(crate) scene: &'a dyn Scene,
    pub(crate) camera: usize,
    pub(crate) pose: Option<Camera>,
    pub(crate) letters: Option<f64>,
}

impl<'a> ImageView<'a> {
    /// The image of the camera of this index.
    #[must_use]
    pub fn new(scene: &'a dyn Scene, camera: usize) -> Self {
        Self { scene, camera, pose: scene.pose(camera), letters: None }
    }

    /// With the names of lines, the metres of the grid and the word on the horizon, as a picture needs them
    /// whose letters are so many times as large as those of a screen.
    #[must_use]
    pub fn with_letters(self, scale: f64) -> Self {
        Self { letters: Some(scale), ..self }
    }

    fn site(&self) -> &'a Site {
        self.scene.site()
    }

    fn entry(&self) -> Option<&'a SiteCamera> {
        self.site().cameras.get(self.camera)
    }

    /// The lens that lines are drawn under: the one that was found, else the likely one. It may be known where the pose
    /// is not.
    fn lens(&self) -> Option<Lens> {
        let found = self.scene.solution(self.camera).map(Solution::lens);
        found.or_else(|| self.entry().map(SiteCamera::likely_lens))
    }

    /// The way across the image of a line that was drawn by its points.
    fn drawn(&self, points: Vec<Pixel>) -> Vec<Pixel> {
        match self.lens() {
            Some(lens) => drawn_line(&lens, &points),
            None => points,
        }
    }

    /// The plane that the EFOV of a camera lies on; one that nobody drew lies on the floor.
    fn efov_plane(&self, camera: usize) -> Plane {
        let entry = self.site().cameras.get(camera).filter(|entry| entry.efov_px.is_some());
        self.scene.plane(entry.and_then(|entry| entry.efov_plane.as_deref()))
    }

    /// The camera with what was solved of it.
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
            Self::DrawnEfov => floor::drawn_efov(view),
            Self::DrawnPrism => floor::drawn_prism(view),
            Self::SolvedEfov => floor::solved_efov(view),
            Self::OtherEfovs => floor::other_efovs(view),
            Self::Horizon => horizon::of_view(view),
            Self::Marks => mark::marks(view),
            Self::Pins => mark::pins(view),
            Self::Annotations(signs) => annotation::annotations(view, signs),
            Self::ControlPoints => annotation::control_points(view),
            Self::Links { begun } => mark::links(view, begun),
            Self::Sightings => mark::sightings(view),
        }
    }
}

/// What is drawn on an image, layer by layer from the lowest.
#[must_use]
pub fn on_image(view: &ImageView, layers: &[ImageLayer]) -> Vec<Item<Pixel>> {
    layers.iter().flat_map(|layer| layer.items(view)).collect()
}

/// A polyline of the scene as a camera shows it.
#[must_use]
pub fn seen(camera: &Camera, meaning: Meaning, polyline: &[WorldPoint]) -> Vec<Item<Pixel>> {
    let pieces = calib_core::on_image(camera, polyline).into_iter();
    pieces.map(|piece| Item::polyline(meaning, piece)).collect()
}
