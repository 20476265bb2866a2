//! People as figures of balls and tapering limbs.

use crate::material::Material;
use crate::shape::Shape;
use crate::stage::Stage;
use crate::vector::{Vec3, vec3};

/// Standing or walking person.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Person {
    /// Midpoint between the feet, in metres.
    pub(crate) at: [f32; 2],
    /// Viewing direction, in radians counter-clockwise from +x.
    pub(crate) turn: f32,
    /// Height to the top of the head, in metres.
    pub(crate) height: f32,
    /// Half the length of a step, divided by the height of the person; 0 for a standing person.
    pub(crate) stride: f32,
    /// Colours of jacket, trousers, skin and hair, as `0xRRGGBB`.
    pub(crate) colours: [u32; 4],
}

/// All people of the scene.
pub(crate) const PEOPLE: [Person; 7] = [
    person([13.8, 11.6], -2.6, 1.76, 0.13, [0x2f_4a6b, 0x39_3a3f, 0xd0_a184, 0x3a_2a1e]),
    person([14.6, 2.4], -0.4, 1.68, 0.05, [0xa8_3f38, 0x2d_3442, 0xd8_ad92, 0x6a_4526]),
    person([8.3, 12.0], 3.0, 1.72, 0.0, [0x5f_7f5c, 0x2c_2d30, 0xc4_9174, 0x22_1c18]),
    person([3.4, 5.3], 3.1, 1.80, 0.03, [0xc7_b48c, 0x4a_5a70, 0xd4_a88c, 0x8a_6a42]),
    person([21.6, 5.4], 2.7, 1.74, 0.1, [0x6c_5a7a, 0x3b_3530, 0xa8_7450, 0x1c_1714]),
    person([27.6, 4.4], 2.2, 1.77, 0.08, [0xd9_7f26, 0x2c_3a55, 0xd0_a184, 0x4a_3624]),
    person([11.6, -6.7], 0.2, 1.75, 0.14, [0x3f_5a7a, 0x31_3c4e, 0xd0_a184, 0x5a_4630]),
];

/// All people of the scene a month later.
pub(crate) const PEOPLE_LATER: [Person; 8] = [
    person([10.2, 9.4], 1.2, 1.81, 0.12, [0x7a_3b34, 0x30_3236, 0xd0_a184, 0x22_1c18]),
    person([16.9, 5.2], 2.9, 1.62, 0.0, [0x3e_6b8a, 0x44_4038, 0xd8_ad92, 0x8a_6a42]),
    person([7.2, 5.1], 0.1, 1.74, 0.1, [0xd9_c8a0, 0x2d_3442, 0xa8_7450, 0x1c_1714]),
    person([20.1, 10.3], -1.9, 1.70, 0.14, [0x4f_7a4a, 0x3b_3530, 0xc4_9174, 0x3a_2a1e]),
    person([3.6, 9.8], 0.8, 1.66, 0.02, [0x8a_4f6d, 0x39_3a3f, 0xd4_a88c, 0x6a_4526]),
    person([13.2, 5.0], -0.6, 1.58, 0.07, [0xc9_6f35, 0x2c_3a55, 0xd0_a184, 0x4a_3624]),
    person([26.4, 5.6], -1.2, 1.79, 0.0, [0x35_5e58, 0x2c_2d30, 0xd0_a184, 0x22_1c18]),
    person([14.8, -5.6], 3.0, 1.72, 0.1, [0xb4_4a3a, 0x31_3c4e, 0xa8_7450, 0x1c_1714]),
];

const fn person(at: [f32; 2], turn: f32, height: f32, stride: f32, colours: [u32; 4]) -> Person {
    Person { at, turn, height, stride, colours }
}

/// Adds people to the stage.
pub(crate) fn build(stage: &mut Stage, people: &[Person]) {
    for person in people {
        person.build(stage);
    }
}

impl Person {
    /// Returns a point of the body in world coordinates, in metres. Its offsets from the midpoint between the
    /// feet, ahead, to the left and up, are fractions of the person's height.
    fn body(&self, ahead: f32, left: f32, up: f32) -> Vec3 {
        let (sin, cos) = self.turn.sin_cos();
        let h = self.height;
        let [x, y] = self.at;
        vec3(x + h * (cos * ahead - sin * left), y + h * (sin * ahead + cos * left), h * up)
    }

    fn build(&self, stage: &mut Stage) {
        let [jacket, trousers, skin, hair] = self.colours.map(Material::matt);
        let shoes = Material::matt(0x24_2220);
        let h = self.height;
        let mut limb = |from: [f32; 3], to: [f32; 3], radii: [f32; 2], material: Material| {
            let shape = Shape::Cone {
                from: self.body(from[0], from[1], from[2]),
                to: self.body(to[0], to[1], to[2]),
                radii: radii.map(|r| r * h),
            };
            stage.add(shape, material);
        };
        let s = self.stride;
        for side in [-1.0, 1.0] {
            let (step, lift) = (s * side, if side < 0.0 { 0.02 * s / 0.13 } else { 0.0 });
            let (hip, knee) = ([0.0, 0.05 * side, 0.50], [0.5 * step + 0.012, 0.05 * side, 0.275]);
            let ankle = [step, 0.052 * side, 0.045 + lift];
            limb(hip, knee, [0.052, 0.036], trousers);
            limb(knee, ankle, [0.037, 0.028], trousers);
            limb(
                [step - 0.012, 0.054 * side, 0.022 + lift],
                [step + 0.085, 0.058 * side, 0.018],
                [0.022, 0.018],
                shoes,
            );
            let (shoulder, elbow) = ([0.0, 0.108 * side, 0.79], [-0.5 * step - 0.02, 0.135 * side, 0.625]);
            let hand = [-step + 0.05, 0.13 * side, 0.49];
            limb(shoulder, elbow, [0.034, 0.028], jacket);
            limb(elbow, hand, [0.028, 0.02], jacket);
            limb(hand, [-step + 0.06, 0.128 * side, 0.462], [0.021, 0.019], skin);
            limb([0.0, 0.048 * side, 0.49], [0.0, 0.06 * side, 0.76], [0.058, 0.062], jacket);
        }
        limb([0.0, 0.0, 0.5], [0.0, 0.0, 0.775], [0.066, 0.062], jacket);
        limb([0.0, -0.075, 0.785], [0.0, 0.075, 0.785], [0.046, 0.046], jacket);
        limb([0.0, 0.0, 0.8], [0.008, 0.0, 0.87], [0.034, 0.03], skin);
        limb([0.012, 0.0, 0.905], [0.006, 0.0, 0.942], [0.043, 0.05], skin);
        limb([-0.014, 0.0, 0.925], [-0.004, 0.0, 0.9475], [0.049, 0.0525], hair);
    }
}
