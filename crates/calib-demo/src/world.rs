//! Everything that is there: solids, lamps, outlines for the plan, people.

use std::sync::OnceLock;

use calib_core::{Camera, Pixel, WorldPoint};

use crate::material::Material;
use crate::shape::{Bounds, Line, Shape};
use crate::tree::Tree;
use crate::vector::{Vec3, vec3};

/// A shape and its paint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solid {
    pub(crate) shape: Shape,
    pub(crate) material: Material,
}

/// A rectangle under a ceiling that sends light down.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lamp {
    pub(crate) centre: Vec3,
    /// Half lengths along x and y, in metres.
    pub(crate) half: [f32; 2],
    /// Light that leaves it, linear.
    pub(crate) radiance: Vec3,
}

/// A rectangle that the plan outlines, in metres: x0, y0, x1, y1.
pub(crate) type Outline = [f32; 4];

/// The scene.
#[derive(Debug)]
pub(crate) struct World {
    pub(crate) solids: Vec<Solid>,
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) outlines: Vec<Outline>,
    pub(crate) tree: Tree,
}

/// The scene while it is built.
#[derive(Debug, Default)]
pub(crate) struct Stage {
    pub(crate) solids: Vec<Solid>,
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) outlines: Vec<Outline>,
}

impl Stage {
    pub(crate) fn put(&mut self, shape: Shape, material: Material) {
        self.solids.push(Solid { shape, material });
    }

    /// A box between two opposite corners, in any order, in metres.
    pub(crate) fn block(&mut self, a: [f32; 3], b: [f32; 3], material: Material) {
        let (a, b) = (vec3(a[0], a[1], a[2]), vec3(b[0], b[1], b[2]));
        self.put(Shape::Box(Bounds { min: a.min(b), max: a.max(b) }), material);
    }

    /// A box that stands on `foot`, turned counter-clockwise by `turn` radians; size is width, depth, height.
    pub(crate) fn turned(&mut self, foot: [f32; 3], turn: f32, size: [f32; 3], material: Material) {
        let (sin, cos) = turn.sin_cos();
        let axes = [vec3(cos, sin, 0.0), vec3(-sin, cos, 0.0), Vec3::UP];
        let half = vec3(size[0], size[1], size[2]) * 0.5;
        let centre = vec3(foot[0], foot[1], foot[2] + half.z);
        self.put(Shape::Turned { centre, axes, half }, material);
    }

    /// A rod with round ends, in metres.
    pub(crate) fn rod(&mut self, from: [f32; 3], to: [f32; 3], radius: f32, material: Material) {
        let shape = Shape::Cone { from: from.into(), to: to.into(), radii: [radius, radius] };
        self.put(shape, material);
    }

    /// An upright cylinder on `foot`, in metres.
    pub(crate) fn drum(&mut self, foot: [f32; 3], radius: f32, height: f32, material: Material) {
        let from = Vec3::from(foot);
        self.put(Shape::Drum { from, to: from + Vec3::UP * height, radius }, material);
    }

    pub(crate) fn ball(&mut self, centre: [f32; 3], radius: f32, material: Material) {
        self.put(Shape::ball(centre.into(), radius), material);
    }

    /// Shows a rectangle on the plan.
    pub(crate) fn outline(&mut self, x0: f32, y0: f32, x1: f32, y1: f32) {
        self.outlines.push([x0, y0, x1, y1]);
    }

    fn finish(self) -> World {
        let shapes: Vec<Shape> = self.solids.iter().map(|solid| solid.shape).collect();
        World { tree: Tree::new(&shapes), solids: self.solids, lamps: self.lamps, outlines: self.outlines }
    }
}

impl From<[f32; 3]> for Vec3 {
    fn from([x, y, z]: [f32; 3]) -> Self {
        vec3(x, y, z)
    }
}

/// The scene, built once.
pub(crate) fn world() -> &'static World {
    static WORLD: OnceLock<World> = OnceLock::new();
    WORLD.get_or_init(|| {
        let mut stage = Stage::default();
        crate::building::build(&mut stage);
        crate::shop::build(&mut stage);
        crate::produce::build(&mut stage);
        crate::store::build(&mut stage);
        crate::barn::build(&mut stage);
        crate::figure::build(&mut stage);
        stage.finish()
    })
}

/// Whether a camera with an image of `size` pixels shows a point of space: inside the image, nothing before it.
///
/// What hides the last `slack` metres of the way does not count: the point may lie on a surface, or
/// in the middle of a foot.
#[must_use]
pub fn visible(camera: &Camera, size: [u32; 2], point: WorldPoint, slack: f64) -> bool {
    camera.world_to_pixel(point).is_some_and(|pixel| is_inside(pixel, size, 0.0))
        && is_clear(camera, point, slack)
}

/// Whether a pixel lies inside an image, `margin` pixels from its border.
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
