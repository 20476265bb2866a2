//! SVG plans as pictures.

use std::sync::{Arc, Mutex, PoisonError};

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{Group, ImageKind, Node, Options, Tree, fontdb};

use crate::drawing::SIDE;

/// Most layers that lie on each other while a drawing is drawn; each takes as much memory as the picture.
const LAYERS: usize = 12;
/// What drawing an embedded picture takes beside decoding it, in bytes a pixel: with its transparency, twice.
const RGBA_TWICE: u64 = 8;

/// Draws an SVG on white, as PNG.
///
/// # Errors
/// When it is no drawing, one without a size, or one that takes more memory than a picture may.
pub(super) fn draw(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let tree = parse(bytes)?;
    let layers = layers(tree.root());
    if layers > LAYERS {
        return Err(format!(
            "{layers} groups with opacity, masks or clips lie in each other in the drawing, and at most {LAYERS} are \
             drawn; flatten it, or export it as PNG"
        ));
    }
    let size = tree.size();
    let zoom = SIDE as f32 / size.width().max(size.height());
    let [w, h] = [size.width(), size.height()].map(|side| (side * zoom).round().max(1.0) as u32);
    let mut pixels = Pixmap::new(w, h).ok_or("The drawing has no size.")?;
    pixels.fill(Color::WHITE);
    resvg::render(&tree, Transform::from_scale(zoom, zoom), &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| error.to_string())
}

fn parse(bytes: &[u8]) -> Result<Tree, String> {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(include_bytes!("../../../assets/IBMPlexSans-Regular.ttf").to_vec());
    let refused = Mutex::new(None);
    let mut options =
        Options { font_family: "IBM Plex Sans".into(), fontdb: Arc::new(fonts), ..Options::default() };
    // A plan from elsewhere reads no files of this machine.
    options.image_href_resolver.resolve_string = Box::new(|_, _| None);
    options.image_href_resolver.resolve_data = Box::new(|mime, data, options| {
        embedded(mime, data, options)
            .map_err(|why| *refused.lock().unwrap_or_else(PoisonError::into_inner) = Some(why))
            .ok()
    });
    let tree = Tree::from_data(bytes, &options).map_err(|error| error.to_string())?;
    drop(options);
    refused.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(tree), Err)
}

/// A picture within a drawing, if decoding it stays within the limits of every other: its header tells.
fn embedded(mime: &str, data: Arc<Vec<u8>>, options: &Options<'_>) -> Result<ImageKind, String> {
    let said = |why: String| format!("a picture in the drawing: {why}");
    let is_png = data.starts_with(b"\x89PNG");
    if is_png || data.starts_with(&[0xff, 0xd8]) {
        calib_input::room_to_decode(&data, RGBA_TWICE).map_err(|error| said(error.to_string()))?;
        return Ok(if is_png { ImageKind::PNG(data) } else { ImageKind::JPEG(data) });
    }
    if mime != "image/svg+xml" {
        return Err(said(format!("{mime} is not read; embed it as PNG or JPEG")));
    }
    Tree::from_data_nested(&data, options).map(ImageKind::SVG).map_err(|error| said(error.to_string()))
}

/// How many layers lie on each other at most while a group is drawn.
fn layers(group: &Group) -> usize {
    let mask = group.mask().map_or(0, |mask| 1 + layers(mask.root()));
    let clip = group.clip_path().map_or(0, |clip| 1 + layers(clip.root()));
    let of_node = |node: &Node| match node {
        Node::Group(group) => layers(group),
        Node::Image(image) => match image.kind() {
            ImageKind::SVG(tree) => 1 + layers(tree.root()),
            _ => 0,
        },
        Node::Path(_) | Node::Text(_) => 0,
    };
    let children = group.children().iter().map(of_node).max().unwrap_or_default();
    usize::from(group.should_isolate()) + children.max(mask).max(clip)
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;

    use super::*;
    use crate::drawing::is_svg;

    #[test]
    fn a_drawing_is_drawn_on_white_in_its_shape() {
        let svg = br##"<svg xmlns="http://www.w3.org/2000/svg" width="200" height="100">
            <rect x="100" width="100" height="100" fill="#204060"/></svg>"##;
        assert!(is_svg(svg) && !is_svg(b"\x89PNG"));
        let image = calib_editor::decode(&draw(svg).unwrap()).unwrap();
        let (w, h) = image.dimensions();
        assert_eq!(w, 2 * h);
        assert_eq!(image.get_pixel(w / 4, h / 2).0, [255; 3]);
        assert_eq!(image.get_pixel(3 * w / 4, h / 2).0, [0x20, 0x40, 0x60]);
        assert!(draw(b"<svg").is_err());
    }

    fn with(inner: &str) -> Result<Vec<u8>, String> {
        let svg = format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="40" height="40">{inner}</svg>"#);
        draw(svg.as_bytes())
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
    fn a_picture_in_a_drawing_is_bounded_as_every_other() {
        let small = calib_editor::decode(&with(&href("image/png", &png(8, 8))).unwrap()).unwrap();
        assert_eq!(small.get_pixel(1000, 1000).0, [0; 3], "it is drawn");
        // Fifty kilobytes that would take 1.2 GB; and within a drawing that is within the drawing.
        let large = href("image/png", &png(10_000, 10_000));
        let nested = format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9">{large}</svg>"#);
        for inner in [large, href("image/svg+xml", nested.as_bytes())] {
            let error = with(&inner).unwrap_err();
            assert!(error.contains("10000 x 10000") && error.contains("scale it down"), "{error}");
        }
        let error = with(&href("image/webp", b"RIFF")).unwrap_err();
        assert!(error.contains("image/webp is not read"), "{error}");
    }

    #[test]
    fn a_drawing_within_drawings_takes_no_memory_without_bound() {
        let deep = |count: usize| {
            let group = r#"<g opacity="0.5"><rect width="9" height="9"/>"#;
            with(&(group.repeat(count) + &"</g>".repeat(count)))
        };
        assert!(deep(3).is_ok());
        let error = deep(200).unwrap_err();
        assert!(error.contains("200 groups"), "{error}");
    }
}
