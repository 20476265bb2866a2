//! Placements of the cameras of a site from the colours of their images.

use calib_core::{Camera, FloorPoint};
use calib_site::{FixedEntry, PlacementEntry, Site, Stage, counted};
use image::RgbImage;

use crate::registration::local_view::View;
use crate::registration::pair_search::{PairDecision, PairRegistration, register_pair};
use crate::registration::relative_pose::wrapped;
use crate::registration::site_colours::SiteColours;
use crate::registration::site_registration::{SiteRegistration, join};

/// Largest number of cameras of a search. The work grows with the number of pairs.
const MAX_CAMERAS: usize = 16;

/// Search for the placements of the cameras of a site, in steps: the pairs can be registered on several
/// threads.
#[derive(Clone, Debug)]
pub struct PlacementSearch {
    /// Indices of the cameras in the site, in the order of the views.
    cameras: Vec<usize>,
    colours: SiteColours,
}

/// Result of a search for the placements of the cameras of a site.
///
/// The placements are start values for the joint refinement: they can be wrong by half a metre, and in a
/// scene that repeats itself by more.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SitePlacement {
    /// Result of each camera of the site.
    pub cameras: Vec<CameraPlacement>,
    /// Groups of at least two cameras whose relative poses were found, as indices in the site. The relative
    /// pose of two groups is unknown.
    pub groups: Vec<Vec<usize>>,
    /// Decision about each pair of cameras.
    pub pairs: Vec<PairPlacement>,
    /// Whether all cameras are placed together, and no pair contradicts.
    pub is_complete: bool,
    /// Summary of the result, or the reason why cameras are not placed.
    pub reason: String,
}

/// Placement of one camera, from the colours of its image.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CameraPlacement {
    /// Placement in the frame of the site; `None` if it is unknown.
    pub placement: Option<PlacementEntry>,
    /// Index of the group of the camera.
    pub group: Option<usize>,
    /// Why the camera is not placed, or how accurate its placement is.
    pub reason: String,
}

/// Decision about a pair of cameras.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PairPlacement {
    /// Indices of the cameras in the site.
    pub cameras: [usize; 2],
    /// Whether the relative pose was found.
    pub decision: PairDecision,
    /// Score of the best relative pose, in bits.
    pub score: f64,
    /// Score of the best relative pose divided by the score of the best different pose.
    pub ratio: f64,
}

impl SitePlacement {
    /// Creates the result of a search that did not start, with the reason.
    #[must_use]
    pub fn refused(site: &Site, reason: String) -> Self {
        let camera = CameraPlacement { placement: None, group: None, reason: reason.clone() };
        let cameras = vec![camera; site.cameras.len()];
        Self { cameras, groups: Vec::new(), pairs: Vec::new(), is_complete: false, reason }
    }

    /// Returns the site with the found placements.
    #[must_use]
    pub fn write_into(&self, mut site: Site) -> Site {
        for (entry, found) in site.cameras.iter_mut().zip(&self.cameras) {
            if found.placement.is_some() {
                entry.placement.clone_from(&found.placement);
            }
        }
        site
    }
}

impl PlacementSearch {
    /// Returns the indices of the cameras of a solved site that can be placed: those with a
    /// calibration and an image. Of several calibration periods of a camera, only the first entry counts.
    ///
    /// # Errors
    /// When fewer than two or more than 16 cameras can be placed, or all are placed; the error is the
    /// reason.
    pub fn cameras(site: &Site) -> Result<Vec<usize>, String> {
        let is_usable = |&index: &usize| {
            let entry = &site.cameras[index];
            let stage = entry.solution.as_ref().map(|solution| solution.stage);
            stage >= Some(Stage::Partial)
                && entry.camera().is_some()
                && entry.image.is_some()
                && site.owns_links(index)
        };
        let cameras: Vec<usize> = (0..site.cameras.len()).filter(is_usable).collect();
        match cameras.len() {
            0 | 1 => Err("fewer than two images have an accepted calibration".into()),
            count if count > MAX_CAMERAS => Err(format!(
                "{count} cameras are too many; place at most {MAX_CAMERAS} cameras that show the same place"
            )),
            _ if cameras.iter().all(|&camera| is_placed_by_hand(site, camera)) => {
                Err("every calibrated camera is already placed".into())
            }
            _ => Ok(cameras),
        }
    }

    /// Prepares the images of the cameras with these indices. An image may be smaller than the calibrated
    /// size.
    #[must_use]
    pub fn new(site: &Site, cameras: &[usize], images: &[RgbImage]) -> Self {
        let known: Vec<(usize, &RgbImage, Camera)> = cameras
            .iter()
            .zip(images)
            .filter_map(|(&index, image)| Some((index, image, site.cameras.get(index)?.camera()?)))
            .collect();
        let entry = |index: usize| &site.cameras[index];
        let views: Vec<View> = known
            .iter()
            .map(|(index, image, camera)| View {
                camera,
                image,
                size_px: entry(*index).size_px,
                is_height_known: entry(*index).height_m.is_some(),
            })
            .collect();
        Self { cameras: known.iter().map(|(index, ..)| *index).collect(), colours: SiteColours::new(&views) }
    }

    /// Returns all pairs of cameras, as indices of the search.
    #[must_use]
    pub fn pairs(&self) -> Vec<[usize; 2]> {
        self.colours.pairs()
    }

    /// Estimates the relative pose of a pair.
    #[must_use]
    pub fn register(&self, pair: [usize; 2]) -> PairRegistration {
        register_pair(&self.colours, pair)
    }

    /// Combines the registered pairs to placements in the frame of the site. `progress` receives the
    /// completed fraction, 0 to 1, and returns `false` to cancel. Returns `None` if it was cancelled.
    ///
    /// A group with placed cameras is moved so that its first placed camera keeps its pose. Without a placed
    /// camera, the largest group determines the frame of the site.
    pub fn place(
        &self,
        site: &Site,
        pairs: &[PairRegistration],
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> Option<SitePlacement> {
        let registration = join(&self.colours, pairs, progress)?;
        let groups: Vec<Vec<usize>> = registration
            .groups
            .iter()
            .map(|group| group.iter().map(|&view| self.cameras[view]).collect())
            .collect();
        let frames = self.frames(site, &registration);
        let mut cameras: Vec<CameraPlacement> = (0..site.cameras.len())
            .map(|camera| {
                let group = groups.iter().position(|group| group.contains(&camera));
                let reason = self.reason(camera, group, &frames, &registration);
                CameraPlacement { placement: None, group, reason }
            })
            .collect();
        for (frame, group) in frames.iter().zip(&registration.groups) {
            for &view in group {
                let (index, pose) = (self.cameras[view], registration.cameras[view]);
                if let (Some(frame), Some(pose), false) = (frame, pose, is_placed_by_hand(site, index)) {
                    cameras[index].placement = Some(frame.placement(&pose));
                }
            }
        }
        let is_found = |pair: &&PairRegistration| pair.views.iter().all(|&view| view < self.cameras.len());
        let pairs = registration.pairs.iter().filter(is_found).map(|pair| PairPlacement {
            cameras: pair.views.map(|view| self.cameras[view]),
            decision: pair.decision,
            score: pair.score,
            ratio: pair.ratio,
        });
        let (is_complete, reason) = summary(&registration, site.cameras.len());
        Some(SitePlacement { cameras, groups, pairs: pairs.collect(), is_complete, reason })
    }

    /// Returns the transformation of each group to the frame of the site; `None` if it is unknown.
    fn frames(&self, site: &Site, registration: &SiteRegistration) -> Vec<Option<Frame>> {
        let by_placed = |group: &Vec<usize>| {
            let known = group.iter().find(|&&view| is_placed_by_hand(site, self.cameras[view]))?;
            Some(Frame::new(&registration.cameras[*known]?, &site.cameras[self.cameras[*known]].camera()?))
        };
        let mut frames: Vec<Option<Frame>> = registration.groups.iter().map(by_placed).collect();
        let is_free = !(0..site.cameras.len()).any(|index| is_placed_by_hand(site, index));
        let sizes = registration.groups.iter().map(Vec::len).enumerate();
        if let Some((largest, _)) = sizes.rev().max_by_key(|(_, size)| *size).filter(|_| is_free) {
            frames[largest] = Some(Frame::IDENTITY);
        }
        frames
    }

    /// Returns why a camera is not placed, or how accurate its placement is.
    fn reason(
        &self,
        camera: usize,
        group: Option<usize>,
        frames: &[Option<Frame>],
        registration: &SiteRegistration,
    ) -> String {
        let Some(view) = self.cameras.iter().position(|&index| index == camera) else {
            return "the image has no accepted calibration".into();
        };
        if let Some(group) = group {
            let others = counted(registration.groups[group].len() - 1, "other camera", "other cameras");
            return match frames[group] {
                Some(_) => format!(
                    "placed by colours together with {others}; the position can be wrong by half a metre"
                ),
                None => format!(
                    "its pose relative to {others} is known, but not its place in the site; place one of these cameras by hand"
                ),
            };
        }
        let is_ambiguous =
            |pair: &PairRegistration| pair.decision == PairDecision::Ambiguous && pair.views.contains(&view);
        if registration.pairs.iter().any(is_ambiguous) {
            "several places agree with the colours of another image".into()
        } else {
            "no other image clearly shows the same place".into()
        }
    }
}

/// Whether the operator, control points or another program have placed a camera. The search keeps its pose.
fn is_placed_by_hand(site: &Site, camera: usize) -> bool {
    let entry = &site.cameras[camera];
    entry.is_placed() && !entry.placement.as_ref().is_some_and(|placement| placement.estimated)
}

/// Returns whether all cameras are placed together, and a summary of the result.
fn summary(registration: &SiteRegistration, count: usize) -> (bool, String) {
    let placed: usize = registration.groups.iter().map(Vec::len).sum();
    let against = registration.agreement.iter().filter(|pair| !pair.agrees).count();
    match registration.groups.len() {
        0 => (false, "no two images clearly show the same place".into()),
        1 if placed == count && against == 0 => {
            (true, "every camera is placed by colours; link points to check and refine the positions".into())
        }
        1 if placed == count => {
            let pairs = counted(against, "pair contradicts", "pairs contradict");
            (false, format!("{pairs} the common placement"))
        }
        groups => (
            false,
            format!("{placed} of {count} cameras are placed, in {}", counted(groups, "group", "groups")),
        ),
    }
}

/// Similarity transformation from the frame of a group to the frame of the site.
#[derive(Clone, Copy, Debug)]
struct Frame {
    /// Rotation, in radians.
    turn: f64,
    scale: f64,
    /// Position in the frame of the site of the origin of the group, in metres.
    origin: [f64; 2],
}

impl Frame {
    const IDENTITY: Self = Self { turn: 0.0, scale: 1.0, origin: [0.0; 2] };

    /// Creates the transformation that maps the pose of a camera in the group to its pose in the site.
    fn new(group: &Camera, site: &Camera) -> Self {
        let linear =
            Self { turn: site.yaw - group.yaw, scale: site.position.z / group.position.z, origin: [0.0; 2] };
        let moved = linear.map(group.position.on_floor());
        Self { origin: [site.position.x - moved.x, site.position.y - moved.y], ..linear }
    }

    fn map(&self, point: FloorPoint) -> FloorPoint {
        let (sin, cos) = self.turn.sin_cos();
        let [x, y] = [cos * point.x - sin * point.y, sin * point.x + cos * point.y];
        FloorPoint::new(self.scale * x + self.origin[0], self.scale * y + self.origin[1])
    }

    /// Returns the placement of a camera of the group. It does not set the height, because colours determine
    /// only the ratios of the heights.
    fn placement(&self, camera: &Camera) -> PlacementEntry {
        PlacementEntry {
            move_m: self.map(camera.position.on_floor()),
            turn_deg: wrapped(camera.yaw + self.turn).to_degrees(),
            scale: None,
            fixed: false,
            held: FixedEntry::default(),
            estimated: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::{Covariance, Lens, Pixel, WorldPoint};

    #[test]
    fn frame_maps_the_known_camera_to_its_pose_in_the_site() {
        let camera = |x: f64, y: f64, z: f64, yaw: f64| {
            let lens = Lens::pinhole(Pixel::new(320.0, 240.0));
            let position = WorldPoint::new(x, y, z);
            Camera { position, yaw, pitch: 0.5, roll: 0.0, focal: 500.0, lens, covariance: Covariance::EXACT }
        };
        let (group, site) = (camera(1.0, 2.0, 2.5, 0.3), camera(-4.0, 7.0, 3.0, -2.9));
        let frame = Frame::new(&group, &site);
        let placement = frame.placement(&group);
        assert!(placement.move_m.distance(site.position.on_floor()) < 1e-12);
        assert!((placement.turn_deg - site.yaw.to_degrees()).abs() < 1e-9);
        // Distances are scaled with the ratio of the heights.
        let other = frame.map(FloorPoint::new(4.0, 6.0));
        assert!((other.distance(placement.move_m) - 5.0 * 1.2).abs() < 1e-12);
    }
}
