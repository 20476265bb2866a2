//! `cargo xtask pictures`: the pictures of the README and of the guide, taken from the app in Chromium.
//!
//! `pictures.mjs` draws in the page and saves screenshots. The screenshots `moving-*` become the animation of
//! the README. The others become the pictures of the guide.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use anyhow::{Context as _, ensure};
use image::codecs::jpeg::JpegEncoder;
use image::{Rgb, RgbImage, Rgba, RgbaImage};

use crate::heavy::browser;
use crate::heavy::demo_images::demo_images;
use crate::workspace::root;

/// Path of the animation in the README, relative to the workspace.
const MOVING: &str = ".github/calibration.png";
/// Folder of the guide's pictures, relative to the workspace.
const GUIDE: &str = "docs/src/pictures";

/// Takes all pictures again. `web` is the folder of the page. The page is built first, unless `as_is` is set.
pub(crate) fn run(web: &Path, as_is: bool) -> anyhow::Result<()> {
    let work = root().join("target/pictures");
    if work.exists() {
        std::fs::remove_dir_all(&work)?;
    }
    let (demo, shots) = (work.join("demo"), work.join("shots"));
    std::fs::create_dir_all(&demo)?;
    for image in demo_images()? {
        std::fs::write(demo.join(image.name), image.jpeg)?;
    }
    std::fs::write(demo.join("site.json"), calib_demo::demo_site().site.to_json())?;
    browser::take_pictures(web, "pictures.mjs", &shots, &demo, as_is)?;

    let mut frames = Vec::new();
    std::fs::create_dir_all(root().join(GUIDE))?;
    let mut names: Vec<_> = std::fs::read_dir(&shots)?.collect::<Result<_, _>>()?;
    names.sort_by_key(std::fs::DirEntry::file_name);
    for entry in names {
        let path = entry.path();
        let name = path.file_stem().context("no name")?.to_string_lossy().into_owned();
        let picture = image::open(&path)?.to_rgb8();
        if name.starts_with("moving-") {
            frames.push(picture);
        } else {
            write_jpeg(&picture, &root().join(GUIDE).join(name).with_extension("jpg"))?;
        }
    }
    write_animation(&frames, &root().join(MOVING))
}

fn write_jpeg(picture: &RgbImage, to: &Path) -> anyhow::Result<()> {
    /// JPEG quality at which small text has no visible artefacts.
    const QUALITY: u8 = 88;
    let mut file = BufWriter::new(File::create(to)?);
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut file, QUALITY))?;
    Ok(())
}

/// Writes an animated PNG. Each frame after the first contains only the pixels that change.
fn write_animation(frames: &[RgbImage], to: &Path) -> anyhow::Result<()> {
    /// Display time of a frame, and of the last frame, in milliseconds.
    const DELAYS_MS: [u16; 2] = [800, 4000];
    let first = frames.first().context("no frames")?;
    let (width, height) = first.dimensions();
    ensure!(frames.iter().all(|frame| frame.dimensions() == (width, height)), "frames of different sizes");
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(to)?), width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_compression(png::Compression::High);
    encoder.set_animated(u32::try_from(frames.len())?, 0)?;
    encoder.set_blend_op(png::BlendOp::Over)?;
    let mut writer = encoder.write_header()?;
    let mut shown = RgbImage::new(width, height);
    for (index, frame) in frames.iter().enumerate() {
        let change = if index == 0 { Change::all(frame) } else { Change::between(&shown, frame) };
        let delay = DELAYS_MS[usize::from(index + 1 == frames.len())];
        writer.set_frame_delay(delay, 1000)?;
        writer.reset_frame_position()?;
        writer.set_frame_dimension(change.pixels.width(), change.pixels.height())?;
        writer.set_frame_position(change.at[0], change.at[1])?;
        writer.write_image_data(&change.pixels)?;
        shown.clone_from(frame);
    }
    Ok(writer.finish()?)
}

/// Rectangle with the changed pixels of a frame. Pixels without a change are transparent.
struct Change {
    /// Left and upper border of the rectangle.
    at: [u32; 2],
    pixels: RgbaImage,
}

impl Change {
    fn all(frame: &RgbImage) -> Self {
        let pixels = RgbaImage::from_fn(frame.width(), frame.height(), |x, y| opaque(*frame.get_pixel(x, y)));
        Self { at: [0, 0], pixels }
    }

    fn between(before: &RgbImage, after: &RgbImage) -> Self {
        let differs = |x: u32, y: u32| before.get_pixel(x, y) != after.get_pixel(x, y);
        let (mut low, mut high) = ([u32::MAX; 2], [0, 0]);
        for (x, y, _) in after.enumerate_pixels().filter(|&(x, y, _)| differs(x, y)) {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x + 1), high[1].max(y + 1)];
        }
        // A frame without a change contains one transparent pixel.
        let low = low.map(|border| if border == u32::MAX { 0 } else { border });
        let size = [0, 1].map(|axis| (high[axis] - low[axis].min(high[axis])).max(1));
        let pixels = RgbaImage::from_fn(size[0], size[1], |x, y| {
            let (x, y) = (low[0] + x, low[1] + y);
            if differs(x, y) { opaque(*after.get_pixel(x, y)) } else { Rgba([0; 4]) }
        });
        Self { at: low, pixels }
    }
}

fn opaque(Rgb([r, g, b]): Rgb<u8>) -> Rgba<u8> {
    Rgba([r, g, b, 255])
}
