//! Point types, one for each space. Only the mapping functions of [`Lens`](crate::Lens),
//! [`Camera`](crate::Camera) and [`PlanScale`] convert between them.

/// Declares a point type with two or three named coordinates, which serialises as a JSON array.
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
            /// Creates a point from its coordinates, in the order of the fields.
            #[must_use]
            pub const fn new($($coordinate: f64),+) -> Self {
                Self { $($coordinate),+ }
            }

            /// Whether every coordinate is finite.
            #[must_use]
            pub fn is_finite(self) -> bool {
                $(self.$coordinate.is_finite())&&+
            }

            /// Returns the Euclidean distance to `other`, in the unit of the coordinates.
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
    /// Point of the image file, with lens distortion, in pixels.
    ///
    /// The image spans `[0, width] x [0, height]`, so the centre of the first pixel is (0.5, 0.5).
    Pixel {
        /// Coordinate to the right, in pixels.
        u,
        /// Coordinate downwards, in pixels.
        v
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// Point of the undistorted image, as a perfect pinhole would show it, in pixels.
    ///
    /// The raw image and the undistorted image have the same principal point, and the same scale there.
    UndistortedPixel {
        /// Coordinate to the right, in pixels.
        u,
        /// Coordinate downwards, in pixels.
        v
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// Point of a horizontal plane in world coordinates, in metres.
    FloorPoint {
        /// World x, in metres.
        x,
        /// World y, in metres.
        y
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// Point in world coordinates: right-handed, metres, z up, floor at z = 0.
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
    /// Point of the floor plan image, in its pixels: x right, y down, origin at the top left corner.
    PlanPixel {
        /// Coordinate to the right, in plan pixels.
        x,
        /// Coordinate downwards, in plan pixels.
        y
    } = [f64; 2], "[f64; 2]"
);

point!(
    /// Image circle of a fisheye: the disc of the image that shows the scene, surrounded by black.
    ImageCircle {
        /// Horizontal coordinate of the centre, in pixels to the right.
        u,
        /// Vertical coordinate of the centre, in pixels downwards.
        v,
        /// Radius, in pixels.
        radius
    } = [f64; 3], "[f64; 3]"
);

/// Implements the conversions of point types from and to arrays of their coordinates.
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
    /// Returns the default image circle of an image with this width and height, in pixels. The circle is
    /// centred on the image, and its diameter is the longer side.
    pub fn default_for([w, h]: [f64; 2]) -> Self {
        Self { u: 0.5 * w, v: 0.5 * h, radius: 0.5 * w.max(h) }
    }

    /// Returns the centre of the image circle.
    #[must_use]
    pub const fn centre(self) -> Pixel {
        Pixel { u: self.u, v: self.v }
    }

    /// Whether a pixel is within the image circle, including its rim. The pixel is in the coordinates of the
    /// circle.
    #[must_use]
    pub fn contains(self, pixel: Pixel) -> bool {
        pixel.distance(self.centre()) <= self.radius
    }
}

impl FloorPoint {
    /// Returns the world point with this x and y, at `height` metres above the floor.
    #[must_use]
    pub const fn at_height(self, height: f64) -> WorldPoint {
        WorldPoint { x: self.x, y: self.y, z: height }
    }
}

impl WorldPoint {
    /// Returns the floor point vertically below this world point.
    #[must_use]
    pub const fn on_floor(self) -> FloorPoint {
        FloorPoint { x: self.x, y: self.y }
    }
}

/// Scale, origin and orientation of a floor plan image in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanScale {
    /// Side length of a plan pixel on the floor, in metres.
    pub metres_per_px: f64,
    /// Plan pixel that shows the world origin (0, 0).
    pub origin: PlanPixel,
    /// Direction of world +x on the plan, in radians counter-clockwise from the right of the plan.
    pub x_axis: f64,
}

impl PlanScale {
    /// Maps a floor point to its plan pixel.
    #[must_use]
    pub fn plan_from_floor(&self, point: FloorPoint) -> PlanPixel {
        let (sin, cos) = self.x_axis.sin_cos();
        let right = (cos * point.x - sin * point.y) / self.metres_per_px;
        let up = (sin * point.x + cos * point.y) / self.metres_per_px;
        PlanPixel { x: self.origin.x + right, y: self.origin.y - up }
    }

    /// Maps a plan pixel to its floor point.
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
    fn world_x_is_right_and_y_up_on_an_unrotated_plan() {
        let plan = PlanScale { metres_per_px: 0.02, origin: PlanPixel::new(100.0, 700.0), x_axis: 0.0 };
        assert_eq!(plan.plan_from_floor(FloorPoint::new(2.0, 4.0)), PlanPixel::new(200.0, 500.0));
    }

    #[test]
    fn x_axis_of_90_degrees_points_up_the_plan() {
        let plan =
            PlanScale { metres_per_px: 0.01, origin: PlanPixel::new(0.0, 0.0), x_axis: 90_f64.to_radians() };
        assert!(plan.plan_from_floor(FloorPoint::new(1.0, 0.0)).distance(PlanPixel::new(0.0, -100.0)) < 1e-9);
    }

    proptest! {
        #[test]
        fn plan_and_floor_maps_are_inverse(
            x in -1e3..1e3_f64, y in -1e3..1e3_f64, turn in -4.0..4.0_f64, scale in 1e-3..1.0_f64,
        ) {
            let plan = PlanScale { metres_per_px: scale, origin: PlanPixel::new(31.0, -7.0), x_axis: turn };
            let point = FloorPoint { x, y };
            prop_assert!(plan.floor_from_plan(plan.plan_from_floor(point)).distance(point) < 1e-9);
        }
    }
}
