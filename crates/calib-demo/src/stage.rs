//! Scene under construction: solids, lamps, outlines for the plan.

use crate::material::Material;
use crate::shape::{Bounds, Shape};
use crate::vector::{Vec3, vec3};

/// Shape with its material.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solid {
    pub(crate) shape: Shape,
    pub(crate) material: Material,
}

/// Rectangular lamp under a ceiling that emits light downward.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lamp {
    pub(crate) centre: Vec3,
    /// Half lengths of the lamp along x and y, in metres.
    pub(crate) half: [f32; 2],
    /// Emitted linear light, relative to a well-lit white wall.
    pub(crate) radiance: Vec3,
}

/// Rectangle that the plan outlines, in metres: x0, y0, x1, y1.
pub(crate) type Outline = [f32; 4];

/// Scene under construction.
#[derive(Debug, Default)]
pub(crate) struct Stage {
    pub(crate) solids: Vec<Solid>,
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) outlines: Vec<Outline>,
}

impl Stage {
    pub(crate) fn add(&mut self, shape: Shape, material: Material) {
        self.solids.push(Solid { shape, material });
    }

    /// Adds a box between two opposite corners, in any order, in metres.
    pub(crate) fn block(&mut self, a: [f32; 3], b: [f32; 3], material: Material) {
        let (a, b) = (vec3(a[0], a[1], a[2]), vec3(b[0], b[1], b[2]));
        self.add(Shape::Box(Bounds { min: a.min(b), max: a.max(b) }), material);
    }

    /// Adds a box, rotated counter-clockwise by `turn` radians. `foot` is the centre of its lower face;
    /// `size` is width, depth and height, in metres.
    pub(crate) fn rotated_block(&mut self, foot: [f32; 3], turn: f32, size: [f32; 3], material: Material) {
        let (sin, cos) = turn.sin_cos();
        let axes = [vec3(cos, sin, 0.0), vec3(-sin, cos, 0.0), Vec3::UP];
        let half = vec3(size[0], size[1], size[2]) * 0.5;
        let centre = vec3(foot[0], foot[1], foot[2] + half.z);
        self.add(Shape::RotatedBox { centre, axes, half }, material);
    }

    /// Adds a rod with round ends, in metres.
    pub(crate) fn rod(&mut self, from: [f32; 3], to: [f32; 3], radius: f32, material: Material) {
        let shape = Shape::Cone { from: from.into(), to: to.into(), radii: [radius, radius] };
        self.add(shape, material);
    }

    /// Adds a vertical cylinder; `foot` is the centre of its lower face, in metres.
    pub(crate) fn drum(&mut self, foot: [f32; 3], radius: f32, height: f32, material: Material) {
        let from = Vec3::from(foot);
        self.add(Shape::Drum { from, to: from + Vec3::UP * height, radius }, material);
    }

    pub(crate) fn ball(&mut self, centre: [f32; 3], radius: f32, material: Material) {
        self.add(Shape::ball(centre.into(), radius), material);
    }

    /// Adds the outline of a piece of furniture to the plan: a rectangle, in metres.
    pub(crate) fn outline(&mut self, x0: f32, y0: f32, x1: f32, y1: f32) {
        self.outlines.push([x0, y0, x1, y1]);
    }
}
