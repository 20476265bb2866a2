//! Conversions of points to and from [`mint`], which most mathematics libraries support.

use crate::camera::space::{FloorPoint, Pixel, PlanPixel, UndistortedPixel, WorldPoint};

/// Implements the conversions of point types to and from points of `mint`.
macro_rules! points {
    ($($name:ident($($coordinate:ident = $other:ident),+) = $point:ident;)+) => {$(
        impl From<$name> for mint::$point<f64> {
            fn from(point: $name) -> Self {
                Self { $($other: point.$coordinate),+ }
            }
        }
        impl From<mint::$point<f64>> for $name {
            fn from(point: mint::$point<f64>) -> Self {
                Self { $($coordinate: point.$other),+ }
            }
        }
    )+};
}

points! {
    Pixel(u = x, v = y) = Point2;
    UndistortedPixel(u = x, v = y) = Point2;
    FloorPoint(x = x, y = y) = Point2;
    PlanPixel(x = x, y = y) = Point2;
    WorldPoint(x = x, y = y, z = z) = Point3;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_convert_to_mint_and_back() {
        let point = WorldPoint::new(1.0, 2.0, 3.0);
        let there = mint::Point3::from(point);
        assert_eq!((there.x, there.y, there.z), (1.0, 2.0, 3.0));
        assert_eq!(WorldPoint::from(there), point);
        let pixel = Pixel::new(4.0, 5.0);
        assert_eq!(Pixel::from(mint::Point2::from(pixel)), pixel);
    }
}
