//! World files of floor plans (`.pgw`, `.jgw`, `.wld`): six numbers, one on each line, for the position of the plan
//! image. The files have no units and no coordinate system; metres are assumed. Numbers that are probably degrees are
//! refused.
//!
//! The numbers are A, D, B, E, C, F in this order. They define the world point x = A i + B j + C and
//! y = D i + E j + F. i and j count pixels to the right and down from the centre of the first pixel.

use calib_core::PlanPixel;

use calib_site::{Plan, Site};

use crate::file::File;
use crate::file::{FormatError, Problem, quoted};
use crate::given::Imported;
use crate::input::Input;

/// Extensions of a world file and of the image that it belongs to.
const IMAGE_EXTENSIONS: [(&str, &str); 4] =
    [("pgw", "png"), ("pngw", "png"), ("jgw", "jpg"), ("jpgw", "jpg")];

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let [file] = &files[..] else {
        return Err(FormatError::expected(
            "worldfile",
            format!("{} files", files.len()),
            "one file, because a site has one plan",
        ));
    };
    let [a, d, b, e, c, f] = numbers(file)?;
    refuse_degrees(file, [a, d, b, e], [c, f])?;
    // For a rotation with a scale, one pixel to the right is (a, d) and one pixel down is (d, -a).
    let (right, up) = (0.5 * (a - e), 0.5 * (d + b));
    let metres_per_px = right.hypot(up);
    let skew = (a + e).hypot(d - b);
    if !(metres_per_px > 1e-9 && metres_per_px < 1e9) || skew > 1e-3 * metres_per_px {
        let found = format!("pixels of ({a}, {d}) and ({b}, {e})");
        let expected = "square pixels in metres, with y down; resample a skewed or mirrored image first";
        return Err(FormatError::expected(&file.name, found, expected));
    }
    let square = metres_per_px * metres_per_px;
    let origin_px =
        PlanPixel { x: 0.5 - (right * c + up * f) / square, y: 0.5 - (up * c - right * f) / square };
    let extension = file.extension();
    let picture = IMAGE_EXTENSIONS.iter().find(|(world, _)| *world == extension);
    let image = picture.map(|(_, picture)| format!("{}.{picture}", file.stem()));
    let mut notes = vec![format!("{}: read as metres, {metres_per_px} per pixel", file.name)];
    if let Some(image) = &image {
        notes.push(format!("the plan image is assumed to be {image}, in the folder of the site file"));
    }
    let x_axis_deg = (-up).atan2(right).to_degrees();
    let plan =
        Plan { image, page: None, layers: None, metres_per_px, origin_px, x_axis_deg, georeference: None };
    let site = Site { plan: Some(plan), ..Site::new() };
    site.check().map_err(|error| FormatError::new(&file.name, Problem::InvalidSite(Box::new(error))))?;
    Ok(Imported { site, notes })
}

/// Fails for numbers that are probably degrees of longitude and latitude: tiny pixels, and an origin on the globe.
fn refuse_degrees(file: &File, pixel: [f64; 4], [x, y]: [f64; 2]) -> Result<(), FormatError> {
    /// Size below which a pixel is improbable in metres. As degrees it is about 11 m.
    const MAX_PIXEL_DEG: f64 = 1e-4;
    let size = pixel.iter().fold(0.0_f64, |size, number| size.max(number.abs()));
    if !(size > 0.0 && size < MAX_PIXEL_DEG && x.abs() <= 180.0 && y.abs() <= 90.0) {
        return Ok(());
    }
    let found =
        format!("pixels of {size} at ({x}, {y}), which are probably degrees of longitude and latitude");
    let expected = "metres; reproject the image to a grid in metres (gdalwarp -t_srs EPSG:CODE IMAGE plan.tif), then use \
                    calib plan plan.tif --site SITE";
    Err(FormatError::expected(&file.name, found, expected))
}

fn numbers(file: &File) -> Result<[f64; 6], FormatError> {
    let lines: Vec<&str> = file.as_text()?.split_whitespace().take(7).collect();
    let number = |(index, text): (usize, &&str)| {
        text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| {
            FormatError::expected(format!("{}: line {}", file.name, index + 1), quoted(text), "a number")
        })
    };
    let found = lines.iter().enumerate().map(number).collect::<Result<Vec<f64>, _>>()?;
    found.try_into().map_err(|found: Vec<f64>| {
        FormatError::expected(
            &file.name,
            calib_site::counted(found.len(), "number", "numbers"),
            "the six numbers of a world file",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::FloorPoint;
    use proptest::prelude::*;

    fn file(text: String) -> File {
        File { name: "hall.pgw".into(), bytes: text.into_bytes() }
    }

    proptest! {
        #[test]
        fn every_pixel_is_mapped_by_the_six_numbers(
            size in 0.001..0.2_f64, turn in -3.1..3.1_f64, c in -1e3..1e3_f64, f in -1e3..1e3_f64,
            i in 0.0..4000.0_f64, j in 0.0..4000.0_f64,
        ) {
            let (a, d) = (size * turn.cos(), size * turn.sin());
            let (b, e) = (d, -a);
            let read = crate::import(crate::format("worldfile").unwrap(), &[file(format!("{a}\n{d}\n{b}\n{e}\n{c}\n{f}\n"))]).unwrap();
            let plan = read.site.plan.unwrap();
            prop_assert_eq!(plan.image.as_deref(), Some("hall.png"));
            let floor = plan.scale().floor_from_plan(PlanPixel { x: i + 0.5, y: j + 0.5 });
            let expected = FloorPoint { x: a * i + b * j + c, y: d * i + e * j + f };
            prop_assert!(floor.distance(expected) < 1e-8, "{floor:?}, expected {expected:?}");
        }
    }

    #[test]
    fn world_file_in_degrees_is_rejected_with_advice() {
        let read = |text: &str| {
            crate::import(crate::format("worldfile").unwrap(), &[file(text.into())])
                .map_err(|error| error.to_string())
        };
        for text in ["1.4e-6 0 0 -9e-7 8.55 50.1", "1e-6 0 0 -1e-6 -70.5 -33.4", "0 9e-5 9e-5 0 179 -89"] {
            let error = read(text).unwrap_err();
            assert!(
                error.contains("degrees") && error.contains("gdalwarp") && error.contains("calib plan"),
                "{error}"
            );
        }
        assert!(read("0.02 0 0 -0.02 8.55 50.1").is_ok());
    }

    #[test]
    fn an_invalid_world_file_is_rejected() {
        for text in [
            "1\n2\n3",
            "0.1\n0\n0\n0.1\n0\n0",
            "0.1 0 0.05 -0.1 0 0",
            "0 0 0 0 0 0",
            "a b c d e f",
            "1 0 0 -1 0 0 0",
        ] {
            assert!(
                crate::import(crate::format("worldfile").unwrap(), &[file(text.into())]).is_err(),
                "{text}"
            );
        }
    }
}
