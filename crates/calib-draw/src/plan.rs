//! Overlays of the floor plan, seen from above, in metres.

use calib_core::{Camera, FloorPoint, floor_grid};

use calib_core::floor::{position_ellipse, view_angle};

use crate::agreement::{Element, elements};
use crate::item::{ElementStatus, Meaning};
use crate::item::{Geometry, Item};
use crate::scene::Scene;

/// Layer of a plan overlay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlanLayer {
    /// Metre grid inside four floor corners; the number is the distance of grid lines in metres.
    Grid([FloorPoint; 4], f64),
    /// Regions of the planes other than the floor, with their names.
    Planes,
    /// EFOV of every camera.
    Efovs,
    /// Uncertainty ellipse of every camera's position; the value is its semi-axis in standard deviations.
    PositionEllipses(f64),
    /// Marks: virtual elements on the floor.
    Marks,
    /// Floor positions of each link according to every view that shows it, connected by a line.
    Links,
    /// Solved links and marks, with lines to their positions according to each camera.
    Observations,
    /// Control points, with lines to their positions according to the calibrated cameras.
    ControlPoints,
    /// Cameras, as cones of their horizontal fields of view.
    Cameras,
}

/// Floor plan with the cameras that its overlays show.
#[derive(Clone, Copy, Debug)]
pub struct PlanView<'a> {
    scene: &'a dyn Scene,
    uppermost: Option<usize>,
    placed_only: bool,
}

impl<'a> PlanView<'a> {
    /// Creates the view of a site with all solved cameras.
    #[must_use]
    pub fn new(scene: &'a dyn Scene) -> Self {
        Self { scene, uppermost: None, placed_only: false }
    }

    /// Restricts the view to placed cameras.
    #[must_use]
    pub fn placed_only(self) -> Self {
        Self { placed_only: true, ..self }
    }

    /// Draws the camera with this index above all others.
    #[must_use]
    pub fn with_uppermost(self, camera: usize) -> Self {
        Self { uppermost: Some(camera), ..self }
    }

    /// Returns the visible cameras with their indices, in drawing order. A camera entry that a newer period
    /// supersedes is visible only if it is the uppermost one.
    fn cameras(&self) -> impl Iterator<Item = (usize, Camera)> {
        let count = self.scene.site().cameras.len();
        let uppermost = self.uppermost.filter(|&camera| camera < count);
        let is_below =
            move |&camera: &usize| Some(camera) != uppermost && !self.scene.site().is_superseded(camera);
        let below = (0..count).filter(is_below);
        below.chain(uppermost).filter_map(|camera| {
            let solution =
                if self.placed_only { self.scene.placed(camera) } else { self.scene.solution(camera) };
            Some((camera, solution.and_then(|_| self.scene.pose(camera))?))
        })
    }
}

impl PlanLayer {
    fn items(self, view: &PlanView) -> Vec<Item<FloorPoint>> {
        match self {
            Self::Grid(corners, step) => grid(&corners, step),
            Self::Planes => planes(view),
            Self::Efovs => view.cameras().filter_map(|(camera, _)| efov(view, camera)).collect(),
            Self::PositionEllipses(sigmas) => {
                let ellipse = |(camera, pose): (usize, Camera)| {
                    let corners = position_ellipse(&pose, sigmas)?;
                    Some(Item::polygon(Meaning::PositionEllipse(camera), corners))
                };
                view.cameras().filter_map(ellipse).collect()
            }
            Self::Marks => marks(view),
            Self::Links => links(view),
            Self::Observations => sightings(view),
            Self::ControlPoints => control_points(view),
            Self::Cameras => view.cameras().map(|(camera, pose)| cone(view, camera, &pose)).collect(),
        }
    }
}

/// Returns the items of some layers on the plan, in drawing order: the first layer is the lowest.
#[must_use]
pub fn on_plan(view: &PlanView, layers: &[PlanLayer]) -> Vec<Item<FloorPoint>> {
    layers.iter().flat_map(|layer| layer.items(view)).collect()
}

fn grid(corners: &[FloorPoint], step: f64) -> Vec<Item<FloorPoint>> {
    let lines = floor_grid(corners, step).into_iter();
    let on_floor = lines.map(|line| line.iter().map(|point| point.on_floor()).collect());
    on_floor.map(|line| Item::polyline(Meaning::Grid, line)).collect()
}

fn planes(view: &PlanView) -> Vec<Item<FloorPoint>> {
    let mut items = Vec::new();
    for (index, plane) in view.scene.site().planes.iter().enumerate().filter(|(_, p)| !p.region.is_empty()) {
        let meaning = Meaning::Plane(index);
        items.push(Item::polygon(meaning, plane.region.clone()));
        items.push(Item::label(meaning, plane.anchor(), plane.title().to_owned()));
    }
    items
}

fn efov(view: &PlanView, camera: usize) -> Option<Item<FloorPoint>> {
    let solution = view.scene.solution(camera)?;
    Some(Item::polygon(Meaning::Efov(camera), solution.efov_m.clone()))
}

fn cone(view: &PlanView, camera: usize, pose: &Camera) -> Item<FloorPoint> {
    let foot = pose.position.on_floor();
    let ahead = FloorPoint { x: foot.x - pose.yaw.sin(), y: foot.y + pose.yaw.cos() };
    let size = view.scene.site().cameras[camera].size();
    // A fisheye camera that looks down by more than 45° covers all directions.
    let all_round = pose.lens.distortion.is_wide() && pose.pitch > 0.25 * std::f64::consts::PI;
    let view = if all_round { std::f64::consts::TAU } else { view_angle(&pose.lens, pose.focal, size) };
    let half_angle = 0.5 * view;
    Item::new(Meaning::Camera(camera), Geometry::Cone { foot, ahead, half_angle })
}

fn marks(view: &PlanView) -> Vec<Item<FloorPoint>> {
    let mut items = Vec::new();
    for (index, mark) in view.scene.site().marks.iter().enumerate().filter(|(_, mark)| !mark.off) {
        let (shape, meaning) = (mark.shape(), Meaning::Mark(index));
        for line in shape.polylines() {
            items.push(Item::polyline(meaning, line.iter().map(|point| point.on_floor()).collect()));
        }
        let at = shape.at.on_floor();
        items.push(Item::point(meaning, at));
        let name = mark.name.as_ref().or(mark.id.as_ref());
        items.extend(name.map(|name| Item::label(meaning, at, name.clone())));
    }
    items
}

fn links(view: &PlanView) -> Vec<Item<FloorPoint>> {
    let mut items = Vec::new();
    for (index, link) in view.scene.site().links.iter().enumerate() {
        let plane = view.scene.plane(link.plane.as_deref()).raised(link.height_m.unwrap_or(0.0));
        let positions = link.seen.iter().filter_map(|seen| {
            let camera = view.scene.index(&seen.camera)?;
            view.scene.placed(camera)?;
            let position = view.scene.pose(camera)?.pixel_to_plane(seen.px.or(seen.foot)?, &plane)?;
            Some((camera, position.on_floor()))
        });
        let positions: Vec<(usize, FloorPoint)> = positions.collect();
        let meaning = |camera| Meaning::LinkPosition { index, camera };
        items.extend(
            positions.windows(2).map(|pair| Item::polyline(meaning(None), vec![pair[0].1, pair[1].1])),
        );
        items.extend(positions.iter().map(|&(camera, at)| Item::point(meaning(Some(camera)), at)));
        let named = link.id.as_ref().zip(positions.first());
        items.extend(named.map(|(id, &(_, at))| Item::label(meaning(None), at, id.clone())));
    }
    items
}

/// Returns the solved links and marks. Lines to the positions according to each camera are below the points.
fn sightings(view: &PlanView) -> Vec<Item<FloorPoint>> {
    let elements: Vec<Element> =
        elements(view.scene.site()).into_iter().filter(|element| !element.is_off).collect();
    let mut items: Vec<Item<FloorPoint>> = elements.iter().flat_map(observation_lines).collect();
    for element in elements.iter().filter(|element| !element.views.is_empty()) {
        let (at, meaning) =
            (element.solution.at_m.on_floor(), Meaning::Solved(element_status(element, None)));
        items.push(Item::point(meaning, at));
        items.push(Item::label(meaning, at, element.id.clone()));
    }
    items
}

/// Returns the status of a link or mark, in the view of a camera or common to all cameras.
fn element_status(element: &Element, camera: Option<usize>) -> ElementStatus {
    ElementStatus { camera, is_rejected: element.is_rejected, is_off: element.is_off }
}

/// Returns the solved line of a line link, and the lines from the position according to each camera to the
/// solved position.
fn observation_lines(element: &Element) -> Vec<Item<FloorPoint>> {
    let mut items: Vec<Item<FloorPoint>> = floor_line(element).into_iter().collect();
    for view in &element.views {
        let meaning = Meaning::Observed(element_status(element, Some(view.index)));
        let pairs = view.sightings.iter().filter_map(|seen| Some(vec![seen.floor?, seen.solved_floor]));
        items.extend(pairs.map(|pair| Item::polyline(meaning, pair)));
    }
    items
}

/// Returns the part of a solved floor line that the cameras show; `None` for other elements.
fn floor_line(element: &Element) -> Option<Item<FloorPoint>> {
    let turn = element.solution.turn_deg.filter(|_| element.is_long)?;
    let (sin, cos) = turn.to_radians().sin_cos();
    let mut points: Vec<FloorPoint> =
        element.views.iter().flat_map(|view| view.sightings.iter().map(|seen| seen.solved_floor)).collect();
    points.sort_by(|a, b| (a.x * cos + a.y * sin).total_cmp(&(b.x * cos + b.y * sin)));
    Some(Item::polyline(Meaning::Solved(element_status(element, None)), points))
}

fn control_points(view: &PlanView) -> Vec<Item<FloorPoint>> {
    let site = view.scene.site();
    let mut items = Vec::new();
    for (camera, entry) in site.cameras.iter().enumerate() {
        for (index, point) in entry.control_points.iter().enumerate().filter(|(_, point)| !point.off) {
            let Some(control) = point.control_point(site) else { continue };
            let at = control.world.on_floor();
            items.push(Item::point(Meaning::ControlPoint { camera, index, is_off: false }, at));
            let position =
                view.scene.pose(camera).and_then(|pose| pose.pixel_to_floor(point.px, control.world.z));
            let residual = Meaning::Residual { is_off: false };
            items.extend(position.map(|put| Item::polyline(residual, vec![at, put])));
        }
    }
    items
}

/// Returns the outline of a camera's cone in canvas units. It is a triangle, or has a curved front if the
/// cone is wide. For an all-round view it is a disc about the foot. `half_angle` is in radians.
#[must_use]
pub fn cone_corners(foot: [f64; 2], ahead: [f64; 2], half_angle: f64, length: f64) -> Vec<[f64; 2]> {
    /// Smallest half angle of a cone with a curved front, in radians.
    const MIN_CURVED_HALF_ANGLE_RAD: f64 = 1.25;
    /// Number of segments in half of a curved front.
    const STEPS: i32 = 12;
    let [x, y] = foot;
    let angle = (ahead[1] - y).atan2(ahead[0] - x);
    let tip = |turn: f64, length: f64| [x + length * (angle + turn).cos(), y + length * (angle + turn).sin()];
    let share = |step: i32| f64::from(step) / f64::from(STEPS);
    if half_angle >= std::f64::consts::PI {
        return (-STEPS..STEPS).map(|step| tip(half_angle * share(step), 0.6 * length)).collect();
    }
    if half_angle < MIN_CURVED_HALF_ANGLE_RAD {
        return vec![foot, tip(-half_angle, length), tip(half_angle, length)];
    }
    // The half angle is limited, because painters fill only convex areas.
    let half_angle = half_angle.min(std::f64::consts::FRAC_PI_2);
    let bow = (-STEPS..=STEPS).map(|step| tip(half_angle * share(step), 0.8 * length));
    std::iter::once(foot).chain(bow).collect()
}
