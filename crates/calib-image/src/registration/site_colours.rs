//! Prepared colours of all cameras of a site.

use calib_core::Camera;

use crate::registration::class_volume::{ClassVolume, UNIT};
use crate::registration::colour_classes::{ClassShares, ColourClasses};
use crate::registration::colour_items::ItemCandidates;
use crate::registration::direction_map::DirectionMap;
use crate::registration::lab_image::{LabImage, WIDTH_PX};
use crate::registration::local_view::{LocalView, View};

/// Width of the blurred rim of a fisheye image, in pixels of the small image.
const RIM_PX: f64 = 2.0;

/// Prepared colours of all cameras of a site: the input of [`register_pair`](crate::register_pair) and
/// [`join`](crate::join). It can be shared between threads.
#[derive(Clone, Debug)]
pub struct SiteColours {
    /// Given cameras.
    pub(crate) cameras: Vec<Camera>,
    /// Prepared colours; `None` for a camera that cannot be registered.
    pub(crate) colours: Vec<Option<CameraColours>>,
}

/// Resolution of a stage of the search.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Level {
    /// Half resolution, large blocks.
    Medium,
    /// Full resolution of the small image, small blocks.
    Fine,
}

/// Prepared colours of one camera.
#[derive(Clone, Debug)]
pub(crate) struct CameraColours {
    /// Height of the camera, in metres.
    pub(crate) height: f64,
    /// Standard deviation of the log of the height.
    pub(crate) height_sigma: f64,
    /// Rows right, down and forward of the camera, in the local frame.
    pub(crate) rotation: [[f64; 3]; 3],
    /// Mean share of each colour class in the visible surroundings of the camera, 0 to 1.
    pub(crate) background: Vec<f32>,
    /// Classes around the camera, for the coarse search.
    pub(crate) volume: ClassVolume,
    /// Items of large and small blocks, in the order of [`Level`].
    items: [ItemCandidates; 2],
    /// Classes by direction, in the order of [`Level`].
    maps: [DirectionMap; 2],
}

/// Small image of a view with its local frame; `None` for a camera that cannot be registered.
pub(crate) type SmallImage = Option<(LabImage, LocalView)>;

/// Creates the small image of a view.
pub(crate) fn small_image(view: &View) -> SmallImage {
    let margin = RIM_PX * f64::from(view.size_px[0]) / WIDTH_PX as f64;
    let local = LocalView::new(view, margin)?;
    Some((LabImage::new(view, &local), local))
}

impl SiteColours {
    /// Prepares the images of a site: the colour classes of the site, and the classes in each image.
    #[must_use]
    pub fn new(views: &[View]) -> Self {
        Self::from_small_images(views, &views.iter().map(small_image).collect::<Vec<_>>())
    }

    /// Prepares the small images of the views.
    pub(crate) fn from_small_images(views: &[View], images: &[SmallImage]) -> Self {
        let classes = ColourClasses::new(images.iter().flatten().map(|(image, _)| image));
        let colours = |(view, image): (&View, &SmallImage)| {
            let (image, local) = image.as_ref().filter(|_| classes.len() > 0)?;
            Some(CameraColours::new(view, image, local, &classes))
        };
        let colours = views.iter().zip(images).map(colours).collect();
        Self { cameras: views.iter().map(|view| *view.camera).collect(), colours }
    }

    /// Returns all pairs of cameras, as indices of the views.
    #[must_use]
    pub fn pairs(&self) -> Vec<[usize; 2]> {
        let count = self.cameras.len();
        (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b])).collect()
    }

    /// Returns the prepared colours of a pair; `None` if a camera cannot be registered.
    pub(crate) fn pair(&self, [a, b]: [usize; 2]) -> Option<[&CameraColours; 2]> {
        let colours = |index: usize| self.colours.get(index)?.as_ref();
        (a != b).then_some(())?;
        Some([colours(a)?, colours(b)?])
    }
}

impl CameraColours {
    fn new(view: &View, image: &LabImage, local: &LocalView, classes: &ColourClasses) -> Self {
        /// Standard deviations of the log of a measured and of an assumed height.
        const HEIGHT_SIGMAS: [f64; 2] = [0.02, 0.1];
        let shares = classes.shares(image);
        let items = [8, 6].map(|step| ItemCandidates::new(&shares, image, local, step));
        let medium = shares.block_means(2).blurred(1.5);
        let volume = ClassVolume::new(&medium, local, 0.5 * image.scale);
        let size = view.size_px.map(f64::from);
        let map = |shares: &ClassShares, scale: f64| {
            DirectionMap::new(shares, local, size, &volume.background, scale * image.scale)
        };
        let maps = [map(&medium, 0.5), map(&shares.blurred(1.0), 1.0)];
        Self {
            height: view.camera.position.z,
            height_sigma: HEIGHT_SIGMAS[usize::from(!view.is_height_known)],
            rotation: local.rotation,
            background: volume.background.iter().map(|&share| f32::from(share) / UNIT).collect(),
            volume,
            items,
            maps,
        }
    }

    /// Returns the items of a level.
    pub(crate) fn items(&self, level: Level) -> &ItemCandidates {
        &self.items[level as usize]
    }

    /// Returns the direction map of a level.
    pub(crate) fn map(&self, level: Level) -> &DirectionMap {
        &self.maps[level as usize]
    }
}
