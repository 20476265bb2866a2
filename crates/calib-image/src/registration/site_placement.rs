//! Placements of the cameras of a site from the colours of their images.

use calib_core::single::Known;
use calib_core::{Camera, FloorPoint, Placement, PlanPixel, PlanScale, WorldPoint};
use calib_site::{FixedEntry, PlacementEntry, Site, Stage, counted};
use image::RgbImage;

use crate::compare::median;
use crate::registration::floor_scan::FloorScan;
use crate::registration::local_view::View;
use crate::registration::pair_search::{PairDecision, PairRegistration, register_pair};
use crate::registration::plan_obstacles::PlanObstacles;
use crate::registration::plan_search::{PlanPose, ScannedCamera, locate, moved};
use crate::registration::site_colours::{SiteColours, SmallImage, small_image};
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
    plan: Option<SearchedPlan>,
}

/// Floor plan on which cameras are placed.
#[derive(Clone, Debug)]
struct SearchedPlan {
    obstacles: PlanObstacles,
    scale: PlanScale,
    /// Visible floor of each view.
    scans: Vec<FloorScan>,
    /// Whether the height of each view is measured.
    is_height_known: Vec<bool>,
}

impl SearchedPlan {
    /// Prepares the plan. Returns `None` if the site has no plan, or its image shows no obstacles.
    fn new(site: &Site, image: &RgbImage, views: &[View], small: &[SmallImage]) -> Option<Self> {
        let scale = site.plan.as_ref()?.scale();
        let scan = |(view, small): (&View, &SmallImage)| {
            let small = small.as_ref();
            small.map_or_else(FloorScan::default, |(image, local)| FloorScan::new(view, local, image))
        };
        Some(Self {
            obstacles: PlanObstacles::new(image, scale.metres_per_px)?,
            scale,
            scans: views.iter().zip(small).map(scan).collect(),
            is_height_known: views.iter().map(|view| view.is_height_known).collect(),
        })
    }

    /// Searches for the pose of a group of views on the plan. Returns the cameras in the frame of the site, or why they
    /// are not placed. Returns `None` if the search was cancelled.
    fn locate(
        &self,
        group: &[(usize, &Camera)],
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> Option<Result<Vec<Camera>, Frame>> {
        /// Standard deviations of the log of the scale, if all heights are measured and if they are assumed.
        const SCALE_SIGMAS: [f64; 2] = [0.03, 0.2];
        let is_assumed = group.iter().any(|(view, _)| !self.is_height_known[*view]);
        let cameras: Vec<ScannedCamera> =
            group.iter().map(|&(view, camera)| ScannedCamera { camera, scan: &self.scans[view] }).collect();
        let sigma = SCALE_SIGMAS[usize::from(is_assumed)];
        let placed = match locate(&self.obstacles, &cameras, sigma, progress)? {
            PlanPose::Found(placed) => placed,
            PlanPose::Ambiguous => return Some(Err(Frame::Ambiguous)),
            PlanPose::NotFound => return Some(Err(Frame::Unknown)),
        };
        let origin = self.scale.floor_from_plan(PlanPixel::new(0.0, 0.0));
        let to_site = Placement { by: origin, turn: -self.scale.x_axis, scale: 1.0 };
        Some(Ok(placed.iter().map(|camera| moved(camera, &to_site)).collect()))
    }
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
    /// Whether all cameras with an image are placed together, and no pair contradicts the joint solution.
    pub is_complete: bool,
    /// Summary of the result, or the reason why cameras are not placed.
    pub reason: String,
}

/// Placement of one camera, from the colours of its image or from the plan.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CameraPlacement {
    /// Estimated placement in the frame of the site; `None` if it is unknown, or if the camera keeps its pose.
    pub placement: Option<PlacementEntry>,
    /// Height that follows from the scale of the plan, with its standard deviation, in metres. `None` without a place on
    /// the plan, or if a height is entered.
    pub height_m: Option<Known>,
    /// Whether the camera was already placed, and keeps its pose.
    pub is_kept: bool,
    /// Index of the group of the camera in [`SitePlacement::groups`]; `None` without a group.
    pub group: Option<usize>,
    /// Why the camera is not placed, or how accurate its placement is.
    pub reason: String,
}

/// Decision about a pair of cameras.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PairPlacement {
    /// Indices of the cameras in the site.
    pub cameras: [usize; 2],
    /// Decision about the relative pose.
    pub decision: PairDecision,
    /// Score of the best relative pose, in bits.
    pub score: f64,
    /// Score of the best relative pose divided by the score of the best different pose.
    pub ratio: f64,
}

/// Frame of a group of cameras in the site.
#[derive(Clone, Copy, Debug)]
enum Frame {
    /// Similarity to the frame of the site, from cameras that are already placed.
    OfPlaced(Placement),
    /// The poses are in the frame of the site, from the plan.
    OnPlan,
    /// The group determines the frame of the site.
    Own,
    /// Unknown: several places on the plan match the visible floor.
    Ambiguous,
    /// Unknown.
    Unknown,
}

impl Frame {
    /// Returns the similarity to the frame of the site, if it is known.
    fn placement(self) -> Option<Placement> {
        match self {
            Self::OfPlaced(frame) => Some(frame),
            Self::OnPlan | Self::Own => Some(Placement::NONE),
            Self::Ambiguous | Self::Unknown => None,
        }
    }

    /// Describes the placement of a camera of a group with `others`.
    fn reason(self, others: &str) -> String {
        match self {
            Self::OfPlaced(_) | Self::Own => format!(
                "it was placed by matching colours with {others}; the position can be wrong by half a metre"
            ),
            Self::OnPlan => format!(
                "it was placed on the plan by its visible floor, together with {others}; the position can be wrong by \
                 half a metre"
            ),
            Self::Ambiguous => format!(
                "its pose relative to {others} is known, but their visible floor matches several places on the plan; \
                 place one of these cameras by hand"
            ),
            Self::Unknown => format!(
                "its pose relative to {others} is known, but not its position in the site; place one of \
                 these cameras by hand"
            ),
        }
    }

    /// Describes the placement of a camera without a group.
    fn reason_of_single(self) -> &'static str {
        match self {
            Self::OnPlan => {
                "it was placed on the plan by its visible floor; the position can be wrong by half a metre"
            }
            Self::Ambiguous => {
                "its visible floor matches several places on the plan; place the camera by hand, or click control \
                 points"
            }
            _ => {
                "its visible floor matches no place on the plan, and no other image clearly shows the same part of the \
                 scene; place the camera by hand, or click control points"
            }
        }
    }
}

impl SitePlacement {
    /// Creates the result of a search that did not start, with the reason.
    #[must_use]
    pub fn refused(site: &Site, reason: String) -> Self {
        let camera = CameraPlacement {
            placement: None,
            height_m: None,
            is_kept: false,
            group: None,
            reason: reason.clone(),
        };
        let cameras = vec![camera; site.cameras.len()];
        Self { cameras, groups: Vec::new(), pairs: Vec::new(), is_complete: false, reason }
    }

    /// Returns the site with the estimated placements and heights.
    #[must_use]
    pub fn write_into(&self, mut site: Site) -> Site {
        for (entry, found) in site.cameras.iter_mut().zip(&self.cameras) {
            if found.placement.is_some() {
                entry.placement.clone_from(&found.placement);
                entry.height_m = entry.height_m.or(found.height_m);
            }
        }
        site
    }
}

impl PlacementSearch {
    /// Longer side above which images are reduced before the search, in pixels. Larger images do not improve
    /// the result.
    pub const SIDE_PX: u32 = 960;
    /// Share of the work of a search, 0 to 1, that is the registration of the pairs.
    pub const PAIRS_SHARE: f64 = 0.7;

    /// Returns the indices of the cameras of a solved site that can be placed: those with a calibration and an
    /// image. A camera with several calibration periods is placed by its first entry in the site file.
    ///
    /// # Errors
    /// When fewer than two (with a plan: one) or more than 16 cameras can be placed, or all are placed; the error is the
    /// reason.
    pub fn cameras(site: &Site) -> Result<Vec<usize>, String> {
        let cameras: Vec<usize> =
            (0..site.cameras.len()).filter(|&camera| why_not_searched(site, camera).is_none()).collect();
        match cameras.len() {
            0 => Err("no image has an accepted calibration; calibrate the cameras first".into()),
            1 if site.plan.is_none() => {
                Err("only one image has an accepted calibration; two are needed".into())
            }
            count if count > MAX_CAMERAS => Err(format!(
                "{count} cameras are calibrated, but at most {MAX_CAMERAS} can be placed at once; use a site \
                 with fewer cameras"
            )),
            _ if cameras.iter().all(|&camera| is_kept(site, camera)) => {
                Err("every calibrated camera is already placed".into())
            }
            _ => Ok(cameras),
        }
    }

    /// Prepares the images of the cameras with these indices, and the image of the plan. An image of a camera may be
    /// smaller than the calibrated size. The image of the plan has its full size; without it, cameras are only placed
    /// relative to each other.
    #[must_use]
    pub fn new(site: &Site, cameras: &[usize], images: &[RgbImage], plan: Option<&RgbImage>) -> Self {
        let mut known: Vec<(usize, &RgbImage, Camera)> = cameras
            .iter()
            .zip(images)
            .filter_map(|(&index, image)| Some((index, image, site.cameras.get(index)?.camera()?)))
            .collect();
        let has_height = |index: usize| site.cameras[index].height_m.is_some() || is_kept(site, index);
        // Cameras whose height is assumed probably hang about as high as the others.
        let is_measured = |(index, ..): &&(usize, &RgbImage, Camera)| has_height(*index);
        let heights: Vec<f64> =
            known.iter().filter(is_measured).map(|(.., camera)| camera.position.z).collect();
        if !heights.is_empty() {
            let height = median(heights);
            let assumed = known.iter_mut().filter(|(index, ..)| !has_height(*index));
            assumed.for_each(|(.., camera)| camera.position.z = height);
        }
        let views: Vec<View> = known
            .iter()
            .map(|(index, image, camera)| View {
                camera,
                image,
                size_px: site.cameras[*index].size_px,
                is_height_known: site.cameras[*index].height_m.is_some_and(is_accurate),
            })
            .collect();
        let small: Vec<SmallImage> = views.iter().map(small_image).collect();
        Self {
            cameras: known.iter().map(|(index, ..)| *index).collect(),
            colours: SiteColours::from_small_images(&views, &small),
            plan: plan.and_then(|image| SearchedPlan::new(site, image, &views, &small)),
        }
    }

    /// Returns all pairs of cameras, as indices of the prepared cameras of this search (not of the site).
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
    /// Cameras that are already placed keep their poses, and their groups are moved to them. Other groups and single
    /// cameras are placed on the plan. Without a plan and without placed cameras, the largest group determines the frame
    /// of the site.
    pub fn place(
        &self,
        site: &Site,
        pairs: &[PairRegistration],
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> Option<SitePlacement> {
        /// Share of the joint search in the work, if there is a plan.
        const JOINT_SHARE: f64 = 0.5;
        let share = if self.plan.is_some() { JOINT_SHARE } else { 1.0 };
        let mut registration = join(&self.colours, pairs, &mut |done| progress(share * done))?;
        self.add_single_cameras(site, &mut registration);
        let frames =
            self.frames(site, &mut registration, &mut |done| progress(share + (1.0 - share) * done))?;
        let cameras: Vec<CameraPlacement> =
            (0..site.cameras.len()).map(|camera| self.camera(site, camera, &registration, &frames)).collect();
        let indices = |group: &Vec<usize>| group.iter().map(|&view| self.cameras[view]).collect();
        let several = registration.groups.iter().filter(|group| group.len() > 1);
        let groups: Vec<Vec<usize>> = several.map(indices).collect();
        let is_known = |pair: &&PairRegistration| pair.views.iter().all(|&view| view < self.cameras.len());
        let pairs = registration.pairs.iter().filter(is_known).map(|pair| PairPlacement {
            cameras: pair.views.map(|view| self.cameras[view]),
            decision: pair.decision,
            score: pair.score,
            ratio: pair.ratio,
        });
        let against = registration.agreement.iter().filter(|pair| !pair.agrees).count();
        let (is_complete, reason) = summary(site, &cameras, self.plan.is_some(), against);
        Some(SitePlacement { cameras, groups, pairs: pairs.collect(), is_complete, reason })
    }

    /// Adds a group for each single camera that the plan may place.
    fn add_single_cameras(&self, site: &Site, registration: &mut SiteRegistration) {
        if self.plan.is_none() {
            return;
        }
        for (view, camera) in self.colours.cameras.iter().enumerate() {
            if registration.cameras[view].is_none() && !is_kept(site, self.cameras[view]) {
                let position = WorldPoint::new(0.0, 0.0, camera.position.z);
                registration.cameras[view] = Some(Camera { position, ..*camera });
                registration.groups.push(vec![view]);
            }
        }
    }

    /// Returns the frame of each group, and moves the cameras that the plan places. Returns `None` if the search was
    /// cancelled.
    fn frames(
        &self,
        site: &Site,
        registration: &mut SiteRegistration,
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> Option<Vec<Frame>> {
        let count = registration.groups.len() as f64;
        let mut frames = Vec::new();
        for (index, group) in registration.groups.iter().enumerate() {
            let placed = group.iter().filter(|&&view| is_kept(site, self.cameras[view]));
            let poses = placed.filter_map(|&view| {
                Some((registration.cameras[view]?, site.cameras[self.cameras[view]].camera()?))
            });
            if let Some(frame) = group_frame(&poses.collect::<Vec<_>>()) {
                frames.push(Frame::OfPlaced(frame));
                continue;
            }
            let Some(plan) = &self.plan else {
                frames.push(Frame::Unknown);
                continue;
            };
            let members: Vec<(usize, &Camera)> = (group.iter())
                .filter_map(|&view| Some((view, registration.cameras[view].as_ref()?)))
                .collect();
            let found = plan.locate(&members, &mut |done| progress((index as f64 + done) / count))?;
            frames.push(match found {
                Ok(cameras) => {
                    let views: Vec<usize> = members.iter().map(|(view, _)| *view).collect();
                    views
                        .into_iter()
                        .zip(cameras)
                        .for_each(|(view, own)| registration.cameras[view] = Some(own));
                    Frame::OnPlan
                }
                Err(frame) => frame,
            });
        }
        let is_free = self.plan.is_none() && !(0..site.cameras.len()).any(|index| is_kept(site, index));
        let sizes = registration.groups.iter().map(Vec::len).enumerate();
        if let Some((largest, _)) = sizes.rev().max_by_key(|(_, size)| *size).filter(|_| is_free) {
            frames[largest] = Frame::Own;
        }
        Some(frames)
    }

    /// Returns the result of the camera with this index in the site.
    fn camera(
        &self,
        site: &Site,
        camera: usize,
        registration: &SiteRegistration,
        frames: &[Frame],
    ) -> CameraPlacement {
        let view = self.cameras.iter().position(|&index| index == camera);
        let group = view.and_then(|view| registration.groups.iter().position(|group| group.contains(&view)));
        let nothing =
            CameraPlacement { placement: None, height_m: None, is_kept: false, group, reason: String::new() };
        if is_kept(site, camera) {
            let reason = "it was already placed, and keeps its pose".into();
            return CameraPlacement { is_kept: true, reason, ..nothing };
        }
        let Some(view) = view else {
            let why_not = why_not_searched(site, camera).unwrap_or("its image could not be read");
            return CameraPlacement { reason: why_not.into(), ..nothing };
        };
        let found = group.and_then(|group| Some((group, registration.cameras[view]?)));
        let Some((group, pose)) = found else {
            return CameraPlacement { reason: not_found(view, registration).into(), ..nothing };
        };
        let is_single = registration.groups[group].len() < 2;
        let frame = frames[group];
        // Colours determine only the ratios of the heights.
        let sets_height = matches!(frame, Frame::OfPlaced(_));
        let placement = frame.placement().map(|own| placement_in(&own, &pose, sets_height));
        let is_from_plan = matches!(frame, Frame::OnPlan) && site.cameras[camera].height_m.is_none();
        let height_m = is_from_plan.then(|| height_from_plan(pose.position.z));
        let reason = match frame {
            Frame::OnPlan | Frame::Ambiguous | Frame::Unknown if is_single => frame.reason_of_single().into(),
            _ => frame.reason(&self.others(site, view, registration)),
        };
        let group = (!is_single).then_some(group);
        CameraPlacement { placement, height_m, reason, group, ..nothing }
    }

    /// Returns the ids of the other cameras in the group of a view as text. For more than three cameras, the text
    /// contains only their number.
    fn others(&self, site: &Site, view: usize, registration: &SiteRegistration) -> String {
        /// Largest number of names.
        const MAX_NAMES: usize = 3;
        let group = registration.groups.iter().find(|group| group.contains(&view));
        let others: Vec<&str> = group
            .into_iter()
            .flatten()
            .filter(|&&other| other != view)
            .map(|&other| site.cameras[self.cameras[other]].id.as_str())
            .collect();
        match others.as_slice() {
            [] => "no camera".into(),
            [one] => (*one).into(),
            [first @ .., last] if others.len() <= MAX_NAMES => format!("{} and {last}", first.join(", ")),
            _ => counted(others.len(), "other camera", "other cameras"),
        }
    }
}

/// Returns why a view belongs to no group.
fn not_found(view: usize, registration: &SiteRegistration) -> &'static str {
    let is_ambiguous =
        |pair: &PairRegistration| pair.decision == PairDecision::Ambiguous && pair.views.contains(&view);
    if registration.pairs.iter().any(is_ambiguous) {
        "several poses match the colours of another image; link points, or place the camera by hand"
    } else {
        "no other image clearly shows the same part of the scene; link points, or place the camera by hand"
    }
}

/// Returns why the search does not include a camera; `None` if it does.
fn why_not_searched(site: &Site, camera: usize) -> Option<&'static str> {
    let entry = &site.cameras[camera];
    let is_calibrated = entry.solution.as_ref().is_some_and(|own| own.stage >= Stage::Partial);
    if !site.owns_links(camera) {
        Some("only the first entry of this camera in the site file is placed")
    } else if entry.image.is_none() {
        Some("the camera has no image")
    } else if !is_calibrated || entry.camera().is_none() {
        Some("the image has no accepted calibration")
    } else {
        None
    }
}

/// Whether an entered height is accurate enough to count as measured.
fn is_accurate(height: Known) -> bool {
    /// Largest relative standard deviation of a measured height.
    const MAX_SIGMA: f64 = 0.03;
    height.sigma.is_none_or(|sigma| sigma <= MAX_SIGMA * height.value)
}

/// Returns a height from the scale of the plan, in metres, rounded to millimetres.
fn height_from_plan(height: f64) -> Known {
    /// Relative standard deviation. It covers the errors of the visible floor and of the lines on the plan.
    const SIGMA: f64 = 0.05;
    let [value, sigma] = [height, SIGMA * height].map(|metres| (1e3 * metres).round() / 1e3);
    Known::prior(value, sigma)
}

/// Whether a camera is already placed and keeps its pose. Only the pose of an earlier search is estimated again: an
/// estimated placement without scale, fixed values and control points.
fn is_kept(site: &Site, camera: usize) -> bool {
    let entry = &site.cameras[camera];
    let is_from_search = |own: &PlacementEntry| {
        own.estimated && own.scale.is_none() && !own.fixed && own.held == FixedEntry::default()
    };
    let is_start_value = entry.solution.as_ref().is_some_and(|own| own.stage == Stage::Placed)
        && entry.control_points.is_empty()
        && entry.placement.as_ref().is_some_and(is_from_search);
    entry.is_placed() && !is_start_value
}

/// Returns whether all cameras with an image are placed in the same frame, and a summary of the result. `against` is
/// the number of pairs that contradict the joint solution.
fn summary(site: &Site, cameras: &[CameraPlacement], has_plan: bool, against: usize) -> (bool, String) {
    let is_wanted = |index: &usize| site.owns_links(*index) && site.cameras[*index].image.is_some();
    let wanted: Vec<&CameraPlacement> =
        (0..cameras.len()).filter(is_wanted).map(|index| &cameras[index]).collect();
    let kept = wanted.iter().filter(|camera| camera.is_kept).count();
    let placed = wanted.iter().filter(|camera| camera.placement.is_some()).count();
    let wanted = wanted.len();
    let by = if has_plan { "by matching colours and using the plan" } else { "by matching colours" };
    let contradiction = match against {
        0 => String::new(),
        _ => {
            let pairs = counted(against, "pair of cameras contradicts", "pairs of cameras contradict");
            format!("; {pairs} the joint solution")
        }
    };
    let already = if kept > 0 {
        format!("; {}", counted(kept, "was already placed", "were already placed"))
    } else {
        String::new()
    };
    if placed == 0 && !cameras.iter().any(|camera| camera.group.is_some()) {
        let on_plan = if has_plan { ", and no camera could be placed on the plan" } else { "" };
        (false, format!("no two images clearly show the same part of the scene{on_plan}"))
    } else if placed + kept == wanted && against == 0 {
        let all = if kept > 0 { "every other camera" } else { "every camera" };
        (true, format!("{all} was placed {by}; link points to check and refine the positions"))
    } else {
        (false, format!("placed {by}: {placed} of {wanted} cameras{already}{contradiction}"))
    }
}

/// Returns the similarity that maps cameras of the group (first) to the site (second). Several cameras determine
/// it by their positions, one camera by its pose and height. Returns `None` without a camera.
fn group_frame(poses: &[(Camera, Camera)]) -> Option<Placement> {
    /// Smallest distance between two cameras whose positions are used, in metres.
    const MIN_DISTANCE_M: f64 = 0.5;
    let (group, site) = poses.first()?;
    let on_floor = |(group, site): &(Camera, Camera)| (group.position.on_floor(), site.position.on_floor());
    let pairs: Vec<(FloorPoint, FloorPoint)> = poses.iter().map(on_floor).collect();
    if pairs.iter().any(|pair| pair.0.distance(pairs[0].0) > MIN_DISTANCE_M) {
        return Placement::fit(&pairs);
    }
    let [turn, scale] = [site.yaw - group.yaw, site.position.z / group.position.z];
    let moved = Placement { turn, scale, ..Placement::NONE }.map_point(pairs[0].0);
    let by = FloorPoint::new(site.position.x - moved.x, site.position.y - moved.y);
    Some(Placement { by, turn, scale })
}

/// Returns the placement of a camera of a group with this frame. `sets_height` is whether the placement has a scale,
/// which multiplies the height.
fn placement_in(frame: &Placement, pose: &Camera, sets_height: bool) -> PlacementEntry {
    let entry = PlacementEntry::from(Placement::from_camera(&moved(pose, frame)));
    PlacementEntry { scale: entry.scale.filter(|_| sets_height), estimated: true, ..entry }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registration::plan_search::tests::camera;
    use crate::registration::relative_pose::wrapped;

    #[test]
    fn frame_maps_the_known_camera_to_its_pose_in_the_site() {
        let (group, site) = (camera(1.0, 2.0, 2.5, 0.3), camera(-4.0, 7.0, 3.0, -2.9));
        let frame = group_frame(&[(group, site)]).unwrap();
        let placement = placement_in(&frame, &group, true);
        assert!(placement.move_m.distance(site.position.on_floor()) < 1e-12);
        assert!((placement.turn_deg - site.yaw.to_degrees()).abs() < 1e-9);
        // Distances are scaled with the ratio of the heights.
        let other = frame.map_point(FloorPoint::new(4.0, 6.0));
        assert!((other.distance(placement.move_m) - 5.0 * 1.2).abs() < 1e-12);
        assert!(
            (placement.scale.unwrap() - 1.0).abs() < 1e-12
                && placement_in(&Placement::NONE, &group, false).scale.is_none()
        );
        // Two cameras determine the transformation by their positions.
        let moved = |camera: &Camera| {
            let at = frame.map_point(camera.position.on_floor());
            Camera { position: at.at_height(9.0), ..*camera }
        };
        let others = [group, camera(5.0, -1.0, 2.5, 0.0)];
        let found = group_frame(&others.map(|camera| (camera, moved(&camera)))).unwrap();
        assert!((found.scale - 1.2).abs() < 1e-12 && wrapped(found.turn - frame.turn).abs() < 1e-12);
        let at = FloorPoint::new(2.0, -3.0);
        assert!(found.map_point(at).distance(frame.map_point(at)) < 1e-12);
    }
}
