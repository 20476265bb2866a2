//! Pixels of SVG drawings.

use std::sync::{Arc, Mutex, PoisonError};

use image::RgbImage;
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{ImageKind, Options, Tree, fontdb};

use crate::error::PlanError;
use crate::guard::guarded;
use crate::part::Part;
use crate::svg_memory::bytes_to_draw;

/// Longer side of the image of an SVG, in pixels. For a corridor of 60 m, one pixel is 2 cm.
pub(crate) const SVG_SIDE: u32 = 3072;

/// Largest side of a part of a drawing, in pixels.
const MAX_PART_SIDE: u32 = 8192;
/// Largest memory for rasterising an SVG, in bytes.
const MAX_MEMORY_BYTES: f64 = 1e9;
/// Memory for decoding an embedded image, in bytes per pixel: two RGBA copies.
const DECODE_BYTES_PER_PIXEL: u64 = 8;

/// Returns the pixels of an SVG on white. Without a size, the longer side has 3,072 pixels.
///
/// # Errors
///
/// Fails if the SVG is invalid, has no size, or needs too much memory.
pub fn rasterise(bytes: &[u8], size: Option<[u32; 2]>) -> Result<RgbImage, PlanError> {
    let tree = parse(bytes)?;
    let own = tree.size();
    let zoom = match size {
        Some([width, _]) => width as f32 / own.width(),
        None => SVG_SIDE as f32 / own.width().max(own.height()),
    };
    let size =
        size.unwrap_or_else(|| [own.width(), own.height()].map(|side| (side * zoom).round().max(1.0) as u32));
    draw(&tree, Transform::from_scale(zoom, zoom), size)
}

/// Returns the pixels of a part of an SVG document, on white. The part has its own number of pixels.
///
/// # Errors
///
/// Fails if [`rasterise`] would fail, or if a side of the part is not positive or is too long.
pub fn rasterise_part(svg: Arc<[u8]>, part: &Part) -> Result<RgbImage, PlanError> {
    let Part { whole, low, size, pixels } = *part;
    let is_sensible = size.iter().all(|side| *side > 0.0 && side.is_finite())
        && pixels.iter().all(|side| (1..=MAX_PART_SIDE).contains(side));
    if !is_sensible {
        return Err(damaged("the part has no size".into()));
    }
    guarded("drawing", move || {
        let tree = parse(&svg)?;
        let from_whole = whole[0] as f32 / tree.size().width();
        let zoom = [0, 1].map(|k| (f64::from(pixels[k]) / size[k]) as f32);
        let shift = [0, 1].map(|k| -low[k] as f32 * zoom[k]);
        let transform =
            Transform::from_row(zoom[0] * from_whole, 0.0, 0.0, zoom[1] * from_whole, shift[0], shift[1]);
        draw(&tree, transform, pixels)
    })
}

/// Draws a document on white.
fn draw(tree: &Tree, zoom: Transform, [w, h]: [u32; 2]) -> Result<RgbImage, PlanError> {
    let bytes = bytes_to_draw(tree, zoom, [w, h]);
    if bytes.is_none_or(|bytes| bytes > MAX_MEMORY_BYTES) {
        let memory = bytes.map_or_else(|| "too much memory".into(), |bytes| format!("{:.1} GB", bytes / 1e9));
        return Err(too_large(format!(
            "its nested groups with opacity, masks, clips, filters or patterns need {memory}; the \
             limit is {:.1} GB. Flatten it, or export it as PNG",
            MAX_MEMORY_BYTES / 1e9
        )));
    }
    let mut pixels = Pixmap::new(w, h).ok_or_else(|| damaged("it has no size".into()))?;
    pixels.fill(Color::WHITE);
    resvg::render(tree, zoom, &mut pixels.as_mut());
    let colours = pixels.data().as_chunks::<4>().0.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
    RgbImage::from_raw(w, h, colours).ok_or_else(|| damaged("it has no size".into()))
}

fn damaged(reason: String) -> PlanError {
    PlanError::Damaged { kind: "drawing", reason }
}

fn too_large(reason: String) -> PlanError {
    PlanError::Limit { kind: "drawing", reason }
}

fn parse(bytes: &[u8]) -> Result<Tree, PlanError> {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let names: Vec<String> =
        fonts.faces().flat_map(|face| face.families.iter().map(|(name, _)| name.clone())).collect();
    let font_family = names.first().cloned().unwrap_or_default();
    fonts.set_sans_serif_family(&font_family);
    let refused = Mutex::new(None);
    let mut options = Options { font_family, fontdb: Arc::new(fonts), ..Options::default() };
    // A plan must not read files of this machine.
    options.image_href_resolver.resolve_string = Box::new(|_, _| None);
    options.image_href_resolver.resolve_data = Box::new(|mime, data, options| {
        load_embedded(mime, data, options)
            .map_err(|why| *refused.lock().unwrap_or_else(PoisonError::into_inner) = Some(why))
            .ok()
    });
    let tree = Tree::from_data(bytes, &options).map_err(|error| damaged(error.to_string()))?;
    drop(options);
    refused.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(tree), Err)
}

/// Loads an embedded image if the size in its header is within the memory limits of all images.
fn load_embedded(mime: &str, data: Arc<Vec<u8>>, options: &Options<'_>) -> Result<ImageKind, PlanError> {
    let refused = |why: String| too_large(format!("an image in the SVG: {why}"));
    let is_png = data.starts_with(b"\x89PNG");
    if is_png || data.starts_with(&[0xff, 0xd8]) {
        calib_input::check_decode_memory(&data, DECODE_BYTES_PER_PIXEL)
            .map_err(|error| refused(error.to_string()))?;
        return Ok(if is_png { ImageKind::PNG(data) } else { ImageKind::JPEG(data) });
    }
    if mime != "image/svg+xml" {
        return Err(PlanError::Unsupported(format!(
            "an image in the SVG has the type {mime}, which is not supported; embed it as PNG or JPEG"
        )));
    }
    Tree::from_data_nested(&data, options).map(ImageKind::SVG).map_err(|error| damaged(error.to_string()))
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;

    use super::*;

    #[test]
    fn a_drawing_is_rasterised_on_white() {
        let svg = br##"<svg xmlns="http://www.w3.org/2000/svg" width="200" height="100">
            <rect x="100" width="100" height="100" fill="#204060"/></svg>"##;
        let image = rasterise(svg, None).unwrap();
        let (w, h) = image.dimensions();
        assert_eq!(w, 2 * h);
        assert_eq!(image.get_pixel(w / 4, h / 2).0, [255; 3]);
        assert_eq!(image.get_pixel(3 * w / 4, h / 2).0, [0x20, 0x40, 0x60]);
        assert!(rasterise(b"<svg", None).is_err());
    }

    fn with(inner: &str) -> Result<RgbImage, String> {
        let svg = format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="40" height="40">{inner}</svg>"#);
        rasterise(svg.as_bytes(), None).map_err(|error| error.to_string())
    }

    fn href(mime: &str, data: &[u8]) -> String {
        let data = base64::engine::general_purpose::STANDARD.encode(data);
        format!(r#"<image width="40" height="40" href="data:{mime};base64,{data}"/>"#)
    }

    fn png(width: u32, height: u32) -> Vec<u8> {
        let mut png = std::io::Cursor::new(Vec::new());
        image::GrayImage::new(width, height).write_to(&mut png, image::ImageFormat::Png).unwrap();
        png.into_inner()
    }

    #[test]
    fn embedded_images_have_a_size_limit() {
        let small = with(&href("image/png", &png(8, 8))).unwrap();
        assert_eq!(small.get_pixel(1000, 1000).0, [0; 3], "it is drawn");
        // Image of fifty kilobytes that would need 1.2 GB, also nested in another drawing.
        let large = href("image/png", &png(10_000, 10_000));
        let nested = format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9">{large}</svg>"#);
        for inner in [large, href("image/svg+xml", nested.as_bytes())] {
            let error = with(&inner).unwrap_err();
            assert!(error.contains("10000 x 10000") && error.contains("scale it down"), "{error}");
        }
        let error = with(&href("image/webp", b"RIFF")).unwrap_err();
        assert!(error.contains("image/webp, which is not supported"), "{error}");
    }

    /// Returns nested groups, each as large as the drawing.
    fn deep(count: usize) -> String {
        let group = r#"<g opacity="0.5"><rect width="40" height="40"/>"#;
        group.repeat(count) + &"</g>".repeat(count)
    }

    /// Returns a shape that refers to a definition.
    fn by_way_of(way: &str, attribute: &str) -> String {
        format!("<defs>{way}</defs><rect width=\"40\" height=\"40\" {attribute}=\"url(#a)\"/>")
    }

    #[test]
    fn nested_groups_have_a_memory_limit() {
        assert!(with(&deep(3)).is_ok());
        let nested =
            format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="40" height="40">{}</svg>"#, deep(200));
        let steps = r#"<feFlood result="r"/>"#.repeat(500);
        let hostile = [
            deep(200),
            by_way_of(&format!(r#"<mask id="a" width="1" height="1">{}</mask>"#, deep(200)), "mask"),
            by_way_of(
                &format!(
                    r#"<pattern id="a" patternUnits="userSpaceOnUse" width="40" height="40">{}</pattern>"#,
                    deep(200)
                ),
                "fill",
            ),
            by_way_of(
                r#"<pattern id="a" patternUnits="userSpaceOnUse" width="400" height="400"><rect width="9" height="9"/></pattern>"#,
                "stroke",
            ),
            by_way_of(&format!(r#"<filter id="a">{steps}</filter>"#), "filter"),
            href("image/svg+xml", nested.as_bytes()),
        ];
        for inner in hostile {
            let error = with(&inner).unwrap_err();
            assert!(error.contains("the limit is 1.0 GB"), "{error}");
        }
    }

    #[test]
    fn patterns_that_contain_each_other_are_refused() {
        let pattern = |level: usize| {
            let next = format!(r##"<rect width="1" height="1" fill="url(#p{})"/>"##, level + 1).repeat(12);
            format!(
                r#"<pattern id="p{level}" patternUnits="userSpaceOnUse" width="2" height="2">{next}</pattern>"#
            )
        };
        let patterns: String = (0..5).map(pattern).collect();
        let last = r#"<pattern id="p5" patternUnits="userSpaceOnUse" width="2" height="2"><rect width="1" height="1"/></pattern>"#;
        let error = with(&format!(
            "<defs>{patterns}{last}</defs><rect width=\"40\" height=\"40\" fill=\"url(#p0)\"/>"
        ))
        .unwrap_err();
        assert!(error.contains("need too much memory"), "{error}");
    }

    #[test]
    fn patterns_filters_and_clips_are_drawn() {
        let hatch = r#"<pattern id="a" patternUnits="userSpaceOnUse" width="2" height="2"><rect width="1" height="1"/></pattern>"#;
        let shadow = r#"<filter id="a"><feGaussianBlur stdDeviation="1"/><feOffset dx="1"/><feBlend in="SourceGraphic" mode="normal"/></filter>"#;
        let window = r#"<clipPath id="a"><rect width="20" height="40"/></clipPath>"#;
        for (way, attribute) in [(hatch, "fill"), (shadow, "filter"), (window, "clip-path")] {
            let drawn = with(&by_way_of(way, attribute));
            assert!(drawn.is_ok(), "{attribute}: {drawn:?}");
        }
    }
}
