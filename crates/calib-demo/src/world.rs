//! Complete scene: solids, lamps, outlines for the plan, people.

use std::sync::OnceLock;

use calib_core::{Camera, ImageCircle, Pixel, WorldPoint};

use crate::shape::{Line, Shape};
use crate::stage::{Lamp, Outline, Solid, Stage};
use crate::tree::Tree;
use crate::vector::Vec3;
use crate::{barn, building, figure, produce, shop, store};

/// Complete scene of the demonstration.
#[derive(Debug)]
pub(crate) struct World {
    pub(crate) solids: Vec<Solid>,
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) outlines: Vec<Outline>,
    pub(crate) tree: Tree,
}

impl From<Stage> for World {
    fn from(Stage { solids, lamps, outlines }: Stage) -> Self {
        let shapes: Vec<Shape> = solids.iter().map(|solid| solid.shape).collect();
        Self { tree: Tree::new(&shapes), solids, lamps, outlines }
    }
}

/// Returns the scene, built once.
pub(crate) fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| build_scene(shop::GONDOLAS, &figure::PEOPLE).into())
}

/// Returns the scene a month later, built once: one shelf has been moved, the people differ, and some lamps
/// have failed.
pub(crate) fn world_later() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        /// Number of lamps per failed lamp.
        const LAMPS_PER_FAILURE: usize = 5;
        let mut stage = build_scene(shop::GONDOLAS_LATER, &figure::PEOPLE_LATER);
        let mut number = 0..;
        stage.lamps.retain(|_| number.next().unwrap_or(0) % LAMPS_PER_FAILURE != 0);
        stage.into()
    })
}

/// Builds the scene with these rows of shelves and these people.
fn build_scene(gondolas: [[f32; 3]; 2], people: &[figure::Person]) -> Stage {
    let mut stage = Stage::default();
    building::build(&mut stage);
    shop::build(&mut stage, gondolas);
    produce::build(&mut stage);
    store::build(&mut stage);
    barn::build(&mut stage);
    figure::build(&mut stage, people);
    stage
}

/// Whether a camera with an image of `size` pixels shows a world point: inside the image and not hidden.
///
/// Occlusion in the last `slack` metres of the line of sight is ignored: the point may be on a surface, or
/// inside an object, for example inside a person's foot.
#[must_use]
pub fn visible(camera: &Camera, size: [u32; 2], point: WorldPoint, slack: f64) -> bool {
    camera.world_to_pixel(point).is_some_and(|pixel| is_shown(camera, size, pixel, 0.0))
        && is_clear(camera, point, slack)
}

/// Whether a pixel is inside the image, and inside the image circle of a fisheye, at least `margin` pixels
/// from the border.
pub(crate) fn is_shown(camera: &Camera, size: [u32; 2], pixel: Pixel, margin: f64) -> bool {
    let in_circle = |circle: ImageCircle| pixel.distance(circle.centre()) <= circle.radius - margin;
    is_inside(pixel, size, margin) && camera.lens.image_circle.is_none_or(in_circle)
}

/// Whether a pixel is inside an image, at least `margin` pixels from its border.
pub(crate) fn is_inside(pixel: Pixel, size: [u32; 2], margin: f64) -> bool {
    let [w, h] = size.map(f64::from);
    pixel.u >= margin && pixel.u <= w - margin && pixel.v >= margin && pixel.v <= h - margin
}

fn is_clear(camera: &Camera, point: WorldPoint, slack: f64) -> bool {
    let from = Vec3::from(camera.position);
    let way = Vec3::from(point) - from;
    let length = way.length();
    world().tree.is_clear(&Line::new(from, way.unit()), length - slack as f32)
}
