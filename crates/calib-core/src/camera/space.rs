//! One type for every space a point can lie in. Only the mapping functions
//! ([`Lens`](crate::Lens), [`Camera`](crate::Camera), [`PlanScale`]) lead from one to another.

/// Declares a point type with two or three named coordinates that reads and writes as a JSON array.
macro_rules! point {
    ($(#[$doc:meta])* $name:ident { $($(#[$coordinate_doc:meta])* $coordinate:ident),+ } = $array:ty, $text:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[derive(serde::Serialize, serde::Deserialize)]
        #[serde(from = $text, into = $text)]
        pub struct $name {
            $($(#[$coordinate_doc])* pub $coordinate: f64),+
        }

        impl $name {
            /// The point with these coordinates, in the order of the fields.
            #[must_use]
            pub const fn new($($coordinate: f64),+) -> Self {
                Self { $($coordinate),+ }
            }

            /// Whether every coordinate is a number.
            #[must_use]
            pub fn is_finite(self) -> bool {
                $(self.$coordinate.is_finite())&&+
            }

            /// Euclidean distance to `other`, in the unit of this space.
            #[must_use]
            pub fn distance(self, other: Self) -> f64 {
                (0.0 $(+ (self.$coordinate - other.$coordinate).powi(2))+).sqrt()
            }
        }

        #[cfg(feature = "schema")]
        impl schemars::JsonSchema for $name {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }
            fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                <$array>::json_schema(generator)
            }
        }
    };
}

point!(
    /// A point as seen in the image file, lens distortion included, in pixels.
    ///
    /// The image spans `[0, width] x [0, height]`, so the centre of the first pixel is (0.5, 0.5).
    Pixel {
        /// To the right, in pixels.
        u,
        /// Downwards, in pixels.
        v
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// Where a [`Pixel`] would lie if the lens were a perfect pinhole, in pixels.
    ///
    /// It shares the principal point with the raw image, and the scale at it.
    UndistortedPixel {
        /// To the right, in pixels.
        u,
        /// Downwards, in pixels.
        v
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// A point of a horizontal plane of the base system, in metres.
    FloorPoint {
        /// World x, in metres.
        x,
        /// World y, in metres.
        y
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// A point of the base system: right-handed, metres, z up, floor at z = 0.
    WorldPoint {
        /// World x, in metres.
        x,
        /// World y, in metres.
        y,
        /// Height above the floor, in metres.
        z
    } = [f64; 3], "[f64; 3]"
);

point!(
    /// A point of the floor plan's picture, in its pixels: x right, y down, origin at the corner.
    PlanPixel {
        /// To the right, in plan pixels.
        x,
        /// Downwards, in plan pixels.
        y
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// The disc of an image in which a fisheye shows the scene; black is around it.
    ImageCircle {
        /// Its middle, to the right, in pixels.
        u,
        /// Its middle, downwards, in pixels.
        v,
        /// Its radius, in pixels.
        radius
    } = [f64; 3], "[f64; 3]"
);

macro_rules! from_array {
    ($($name:ident($($coordinate:ident),+) = $array:ty;)+) => {$(
        impl From<$array> for $name {
            fn from([$($coordinate),+]: $array) -> Self {
                Self { $($coordinate),+ }
            }
        }
        impl From<$name> for $array {
            fn from(point: $name) -> Self {
                [$(point.$coordinate),+]
            }
        }
    )+};
}

from_array! {
    Pixel(u, v) = [f64; 2];
    UndistortedPixel(u, v) = [f64; 2];
    FloorPoint(x, y) = [f64; 2];
    WorldPoint(x, y, z) = [f64; 3];
    PlanPixel(x, y) = [f64; 2];
    ImageCircle(u, v, radius) = [f64; 3];
}

impl ImageCircle {
    /// The circle of an image, of this width and height in pixels, whose own is not known: about its middle, as wide as its
    /// longer side.
    pub fn around([w, h]: [f64; 2]) -> Self {
        Self { u: 0.5 * w, v: 0.5 * h, radius: 0.5 * w.max(h) }
    }

    /// Its middle.
    #[must_use]
    pub const fn centre(self) -> Pixel {
        Pixel { u: self.u, v: self.v }
    }

    /// Whether a pixel is within it.
    #[must_use]
    pub fn holds(self, pixel: Pixel) -> bool {
        pixel.distance(self.centre()) <= self.radius
    }
}

impl FloorPoint {
    /// The point of space `height` metres above this point of the floor.
    #[must_use]
    pub const fn at_height(self, height: f64) -> WorldPoint {
        WorldPoint { x: self.x, y: self.y, z: height }
    }
}

impl WorldPoint {
    /// The point of the floor straight below.
    #[must_use]
    pub const fn on_floor(self) -> FloorPoint {
        FloorPoint { x: self.x, y: self.y }
    }
}

/// How a floor plan's picture lies in the base system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanScale {
    /// Size of a plan pixel, in metres.
    pub metres_per_px: f64,
    /// The plan pixel of world (0, 0).
    pub origin: PlanPixel,
    /// Direction of world +x, in radians counter-clockwise from the plan's right.
    pub x_axis: f64,
}

impl PlanScale {
    /// Where a point of the floor lies on the plan.
    #[must_use]
    pub fn plan_from_floor(&self, point: FloorPoint) -> PlanPixel {
        let (sin, cos) = self.x_axis.sin_cos();
        let right = (cos * point.x - sin * point.y) / self.metres_per_px;
        let up = (sin * point.x + cos * point.y) / self.metres_per_px;
        PlanPixel { x: self.origin.x + right, y: self.origin.y - up }
    }

    /// The point of the floor that a plan pixel shows.
    #[must_use]
    pub fn floor_from_plan(&self, point: PlanPixel) -> FloorPoint {
        let (sin, cos) = self.x_axis.sin_cos();
        let right = (point.x - self.origin.x) * self.metres_per_px;
        let up = (self.origin.y - point.y) * self.metres_per_px;
        FloorPoint { x: cos * right + sin * up, y: cos * up - sin * right }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn world_x_points_right_on_an_unturned_plan_and_y_up() {
        let plan = PlanScale { metres_per_px: 0.02, origin: PlanPixel::new(100.0, 700.0), x_axis: 0.0 };
        assert_eq!(plan.plan_from_floor(FloorPoint::new(2.0, 4.0)), PlanPixel::new(200.0, 500.0));
    }

    #[test]
    fn a_quarter_turn_of_the_x_axis_points_world_x_up_the_plan() {
        let plan =
            PlanScale { metres_per_px: 0.01, origin: PlanPixel::new(0.0, 0.0), x_axis: 90_f64.to_radians() };
        assert!(plan.plan_from_floor(FloorPoint::new(1.0, 0.0)).distance(PlanPixel::new(0.0, -100.0)) < 1e-9);
    }

    proptest! {
        #[test]
        fn the_plan_and_the_floor_are_inverse_to_each_other(
            x in -1e3..1e3_f64, y in -1e3..1e3_f64, turn in -4.0..4.0_f64, scale in 1e-3..1.0_f64,
        ) {
            let plan = PlanScale { metres_per_px: scale, origin: PlanPixel::new(31.0, -7.0), x_axis: turn };
            let point = FloorPoint { x, y };
            prop_assert!(plan.floor_from_plan(plan.plan_from_floor(point)).distance(point) < 1e-9);
        }
    }
}
