//! A newer still with the places of the old one: where they are found again, and where they are not.

use calib_core::Pixel;
use image::{Rgb, RgbImage};

use crate::compare::{Compared, Seen};

/// An edge that is where it is told.
const FOUND: Rgb<u8> = Rgb([40, 220, 90]);
/// One that is not: something stands before it, or it moved by itself.
const LOST: Rgb<u8> = Rgb([255, 90, 40]);

/// The newer still with a dot at every place of an edge.
pub(crate) fn drawn(of: &Compared, seen: &Seen, mut still: RgbImage) -> RgbImage {
    let turned = seen.comparison.turn.at(&of.camera);
    for (place, found) in &seen.comparison.seen {
        if let (Some(found), Some(at)) = (found, turned.pixel(*place)) {
            dot(&mut still, at, if *found { FOUND } else { LOST });
        }
    }
    still
}

fn dot(image: &mut RgbImage, at: Pixel, colour: Rgb<u8>) {
    const HALF: i64 = 1;
    for (x, y) in (-HALF..=HALF).flat_map(|x| (-HALF..=HALF).map(move |y| (x, y))) {
        let (x, y) = (at.u as i64 + x, at.v as i64 + y);
        let pixel = u32::try_from(x).ok().zip(u32::try_from(y).ok());
        if let Some(pixel) = pixel.and_then(|(x, y)| image.get_pixel_mut_checked(x, y)) {
            *pixel = colour;
        }
    }
}
