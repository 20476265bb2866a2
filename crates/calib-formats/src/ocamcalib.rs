//! `calib_results.txt` of `OCamCalib`, the polynomial of D. Scaramuzza, A. Martinelli, R. Siegwart, "A
//! flexible technique for accurate omnidirectional camera calibration and structure from motion", 2006.
//!
//! A pixel (row, column) minus the centre, multiplied by the inverse of `[c d; e 1]`, is a point (x, y) at
//! the radius r. Its ray is `(x, y, a0 + a1 r + a2 r^2 + ...)`. The camera looks toward the side of z that
//! has the sign of a0, which is usually negative. Rows and columns count from the centre of the first pixel.
//! The lens is approximated by the nearest Kannala-Brandt lens, with an error of at most one pixel.

use crate::export::round_up;
use crate::file::File;
use crate::file::{FormatError, Problem};
use crate::fisheye::{MAX_ANGLE, MAX_FIT_ERROR_PX, fit_error_text, fit_lens};
use crate::given::{Imported, ImportedCamera, site_with_notes};
use crate::input::Input;
use crate::tree::digits;

/// Largest accepted number of coefficients of a polynomial; calibrations with a board have fewer.
const MAX_COEFFICIENTS: usize = 32;

/// Number of radii at which the polynomial is sampled.
const RINGS: usize = 400;

/// Line of numbers, with its position in the file.
struct Line {
    place: String,
    numbers: Vec<f64>,
}

impl Line {
    /// Creates an error for a line with another number of values than expected.
    fn wrong(&self, expected: &str) -> FormatError {
        FormatError::expected(
            &self.place,
            calib_site::counted(self.numbers.len(), "number", "numbers"),
            expected,
        )
    }

    fn exactly<const N: usize>(&self, expected: &str) -> Result<[f64; N], FormatError> {
        self.numbers.clone().try_into().map_err(|_| self.wrong(expected))
    }

    /// Returns the coefficients of a line, whose first number is the number of coefficients.
    fn terms(&self) -> Result<&[f64], FormatError> {
        match &self.numbers[..] {
            [count, terms @ ..]
                if *count == terms.len() as f64 && (1..=MAX_COEFFICIENTS).contains(&terms.len()) =>
            {
                Ok(terms)
            }
            _ => Err(self.wrong("the number of coefficients, up to 32, and then the coefficients")),
        }
    }
}

pub(crate) fn read(files: &Input) -> Result<Imported, FormatError> {
    let (mut given, mut notes) = (Vec::new(), Vec::new());
    for file in files.iter() {
        given.push(lens(file, &mut notes)?);
    }
    site_with_notes(given, notes, files, &files[0].name)
}

/// Returns up to six lines of numbers. Empty lines and comments are skipped.
fn lines(file: &File) -> Result<Vec<Line>, FormatError> {
    let is_content = |text: &str| !text.is_empty() && !text.starts_with('#');
    let content = file.as_text()?.lines().map(str::trim).enumerate().filter(|(_, text)| is_content(text));
    let line = |(index, text): (usize, &str)| {
        let place = format!("{} line {}", file.name, index + 1);
        let number = |word: &str| word.parse::<f64>().ok().filter(|value| value.abs() <= 1e12);
        let numbers: Option<Vec<f64>> =
            text.split_whitespace().take(MAX_COEFFICIENTS + 2).map(number).collect();
        let numbers = numbers.ok_or_else(|| {
            FormatError::expected(&place, crate::file::quoted(text), "numbers between -1e12 and 1e12")
        })?;
        Ok(Line { place, numbers })
    };
    // One more line than the format has is enough to detect another format.
    content.take(6).map(line).collect()
}

fn lens(file: &File, notes: &mut Vec<String>) -> Result<ImportedCamera, FormatError> {
    let lines = lines(file)?;
    let [direct, inverse, centre, affine, size] = &lines[..] else {
        let found = calib_site::counted(lines.len(), "line of numbers", "lines of numbers");
        let expected = "five: both polynomials, centre, affine parameters and size of the image";
        return Err(FormatError::expected(&file.name, found, expected));
    };
    inverse.terms()?;
    let [row, column] = centre.exactly("the row and the column of the centre")?;
    let [height, width] = size.exactly("the height and the width of the image")?;
    let most = f64::from(calib_site::MAX_SIDE);
    if [width, height].iter().any(|side| side.fract() != 0.0 || !(1.0..=most).contains(side)) {
        let found = format!("{} x {}", digits(width), digits(height));
        return Err(FormatError::expected(&size.place, found, "a size in whole pixels"));
    }
    let [c, d, e] = affine.exactly("the affine parameters c, d, e")?;
    let scale = 0.5 * (1.0 + c);
    if !(0.5..=2.0).contains(&scale) {
        let found = format!("c = {}", digits(c));
        return Err(FormatError::expected(&affine.place, found, "square pixels, c near 1"));
    }
    let far = [row.max(height - row), column.max(width - column)];
    let samples = rings(direct, far[0].hypot(far[1]), scale)?;
    let &[theta, rim] = samples.last().ok_or_else(|| FormatError::new(&direct.place, Problem::NoCamera))?;
    // Largest displacement of a point at the rim by the affine parameters c, d and e, in pixels.
    let skew = (0..90)
        .map(|i| (f64::from(i) * 2.0).to_radians().sin_cos())
        .map(|(sin, cos)| ((c - scale) * cos + d * sin).hypot(e * cos + (1.0 - scale) * sin) * rim / scale);
    let skew = skew.fold(0.0, f64::max);
    if skew > MAX_FIT_ERROR_PX {
        let found = format!("affine parameters that move the rim by {skew:.2} px");
        let expected = "square pixels: c near 1, d and e near 0; undistort or resample the image first";
        return Err(FormatError::expected(&affine.place, found, expected));
    }
    let nearest = fit_lens(&samples).filter(|lens| lens.max_error_px.is_finite());
    let off = nearest.map_or(f64::INFINITY, |lens| lens.max_error_px + skew);
    let Some(lens) = nearest.filter(|_| off <= MAX_FIT_ERROR_PX) else {
        let found = fit_error_text("a polynomial", off);
        return Err(FormatError::expected(&direct.place, found, "at most 1 px"));
    };
    notes.push(format!(
        "camera {:?}: its polynomial is approximated by Kannala-Brandt terms, with an error of at most {:.3} px up to {:.0} \
         degrees from the axis",
        file.stem(),
        round_up(off, 3),
        theta.to_degrees()
    ));
    let given =
        ImportedCamera::new(file.stem(), &direct.place, [lens.focal, lens.focal, column + 0.5, row + 0.5]);
    Ok(ImportedCamera {
        size: Some([width as u32, height as u32]),
        distortion: lens.distortion,
        ..given.with_path(&file.name)
    })
}

/// Returns pairs of angle from the axis, in radians, and radius, in pixels. They end at the radius `corner`, at
/// [`MAX_ANGLE`], or where the angle stops growing, whichever is first. The returned radii are multiplied by `scale`.
/// Fails if the angle stops growing in the first third, if there are fewer than 16 pairs, or if a0 is 0.
fn rings(direct: &Line, corner: f64, scale: f64) -> Result<Vec<[f64; 2]>, FormatError> {
    let terms = direct.terms()?;
    let ahead = terms[0].signum();
    let mut rings: Vec<[f64; 2]> = Vec::new();
    let mut has_decreased = false;
    for ring in 1..=RINGS {
        let radius = corner * ring as f64 / RINGS as f64;
        let depth = ahead * terms.iter().rev().fold(0.0, |sum, term| sum * radius + term);
        let theta = radius.atan2(depth);
        if theta > MAX_ANGLE {
            break;
        }
        if theta <= rings.last().map_or(0.0, |&[before, _]| before) || !theta.is_finite() {
            has_decreased = true;
            break;
        }
        rings.push([theta, scale * radius]);
    }
    if terms[0] == 0.0 || rings.len() < 16 || has_decreased && rings.len() < RINGS / 3 {
        let found = "a polynomial whose rays do not turn outward from the centre of the image";
        return Err(FormatError::expected(&direct.place, found, "the polynomial of a lens"));
    }
    Ok(rings)
}
