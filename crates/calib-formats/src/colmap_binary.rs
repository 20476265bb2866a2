//! COLMAP's binary model, `cameras.bin` and `images.bin`: converted to the lines of the text model.
//!
//! All numbers are little-endian. `cameras.bin` contains the number of cameras (u64), and for each camera its
//! id (u32), its model (i32), width and height (u64), and the parameters of the model (f64). `images.bin`
//! contains the number of images (u64). For each image, it contains the id (u32), the quaternion and the
//! translation (7 f64), and the id of the camera (u32). The name of the image follows, up to a zero byte, then the
//! number of its points (u64), and 24 bytes for each point.

use std::fmt::Write as _;

use crate::file::{File, FormatError, Problem};
use crate::tree::joined;

/// Camera models with their numbers of parameters, in the order of COLMAP's numbers.
const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// Number of bytes of a point of an image.
const POINT_BYTES: usize = 24;

/// Binary file with its bytes that are not read yet.
struct Bytes<'a> {
    file: &'a File,
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    fn new(file: &'a File) -> Self {
        Self { file, rest: &file.bytes }
    }

    fn cut_off(&self) -> FormatError {
        FormatError::new(&self.file.name, Problem::CutOff)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], FormatError> {
        let (first, rest) = self.rest.split_first_chunk::<N>().ok_or_else(|| self.cut_off())?;
        self.rest = rest;
        Ok(*first)
    }

    fn whole(&mut self) -> Result<u64, FormatError> {
        self.take().map(u64::from_le_bytes)
    }

    fn id(&mut self) -> Result<u32, FormatError> {
        self.take().map(u32::from_le_bytes)
    }

    fn numbers(&mut self, count: usize) -> Result<Vec<f64>, FormatError> {
        (0..count).map(|_| self.take().map(f64::from_le_bytes)).collect()
    }

    /// Returns a text that ends with a zero byte.
    fn text(&mut self) -> Result<&'a str, FormatError> {
        let end = self.rest.iter().position(|&byte| byte == 0).ok_or_else(|| self.cut_off())?;
        let text = std::str::from_utf8(&self.rest[..end]).map_err(|error| {
            FormatError::new(&self.file.name, Problem::NotUtf8 { at: error.valid_up_to() })
        })?;
        self.rest = &self.rest[end + 1..];
        Ok(text)
    }

    fn skip(&mut self, count: usize) -> Result<(), FormatError> {
        self.rest = self.rest.get(count..).ok_or_else(|| self.cut_off())?;
        Ok(())
    }
}

/// Returns a binary file with its content as in `cameras.txt` or `images.txt`. Returns `None` for other files.
pub(crate) fn as_text(file: &File) -> Result<Option<File>, FormatError> {
    let text = match file.base() {
        "cameras.bin" => cameras(&mut Bytes::new(file))?,
        "images.bin" => images(&mut Bytes::new(file))?,
        _ => return Ok(None),
    };
    Ok(Some(File { name: file.name.clone(), bytes: text.into_bytes() }))
}

fn cameras(bytes: &mut Bytes) -> Result<String, FormatError> {
    let mut text = String::new();
    for _ in 0..bytes.whole()? {
        let (id, model) = (bytes.id()?, bytes.take().map(i32::from_le_bytes)?);
        let known = usize::try_from(model).ok().and_then(|model| MODELS.get(model));
        let (name, count) = known.ok_or_else(|| {
            let expected = format!("a model from 0 to {}", MODELS.len() - 1);
            FormatError::expected(&bytes.file.name, format!("the camera model {model}"), expected)
        })?;
        let [width, height] = [bytes.whole()?, bytes.whole()?];
        let _ = writeln!(text, "{id} {name} {width} {height} {}", joined(&bytes.numbers(*count)?, " "));
    }
    Ok(text)
}

fn images(bytes: &mut Bytes) -> Result<String, FormatError> {
    let mut text = String::new();
    for _ in 0..bytes.whole()? {
        let (id, pose, camera, name) = (bytes.id()?, bytes.numbers(7)?, bytes.id()?, bytes.text()?);
        let points = bytes.whole()?;
        bytes.skip(usize::try_from(points).unwrap_or(usize::MAX).saturating_mul(POINT_BYTES))?;
        // A line break in a name would begin another line. The points of an image are on the second line.
        let name = name.replace(['\n', '\r'], " ");
        let mark = if points > 0 { "points" } else { "" };
        let _ = writeln!(text, "{id} {} {camera} {name}\n{mark}", joined(&pose, " "));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{format, import};

    fn files() -> [File; 2] {
        let whole = |values: &[u64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
        let numbers =
            |values: &[f64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
        let ids = |values: &[u32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
        // Model 1 is PINHOLE.
        let lens = numbers(&[900.0, 900.0, 640.0, 360.0]);
        let cameras = [whole(&[1]), ids(&[7, 1]), whole(&[1280, 720]), lens].concat();
        let pose = numbers(&[1.0, 0.0, 0.0, 0.0, 0.5, 1.0, 2.0]);
        let point = vec![0; POINT_BYTES];
        let images =
            [whole(&[1]), ids(&[3]), pose, ids(&[7]), b"a.png\0".to_vec(), whole(&[1]), point].concat();
        [("cameras.bin", cameras), ("images.bin", images)]
            .map(|(name, bytes)| File { name: name.into(), bytes })
    }

    #[test]
    fn binary_model_is_read() {
        let imported = import(format("colmap").unwrap(), &files()).unwrap();
        let camera = &imported.site.cameras[0];
        assert_eq!((camera.id.as_str(), camera.size_px), ("a", [1280, 720]));
        let position = camera.solution.as_ref().unwrap().position_m.unwrap();
        assert_eq!([position.x, position.y, position.z], [-0.5, -1.0, -2.0]);
        assert!(imported.notes.iter().any(|note| note.contains("images.bin")), "{:?}", imported.notes);
    }

    #[test]
    fn incomplete_files_and_unknown_models_are_refused() {
        let [cameras, images] = files();
        for length in 0..cameras.bytes.len() {
            let short = File { bytes: cameras.bytes[..length].to_vec(), ..cameras.clone() };
            assert!(import(format("colmap").unwrap(), &[short, images.clone()]).is_err(), "{length}");
        }
        for length in 0..images.bytes.len() {
            let short = File { bytes: images.bytes[..length].to_vec(), ..images.clone() };
            assert!(import(format("colmap").unwrap(), &[cameras.clone(), short]).is_err(), "{length}");
        }
        let mut unknown = cameras;
        unknown.bytes[12] = 77;
        let error = import(format("colmap").unwrap(), &[unknown, images]).unwrap_err().to_string();
        assert!(error.contains("cameras.bin") && error.contains("77"), "{error}");
    }
}
