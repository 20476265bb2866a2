//! SVG plans as pictures.

use crate::drawing::SIDE;

/// Draws an SVG on white, as PNG.
///
/// # Errors
/// When it is no drawing, or one without a size.
pub(super) fn draw(bytes: &[u8]) -> Result<Vec<u8>, String> {
    use resvg::{tiny_skia, usvg};

    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(include_bytes!("../../../assets/IBMPlexSans-Regular.ttf").to_vec());
    let mut options = usvg::Options {
        font_family: "IBM Plex Sans".into(),
        fontdb: std::sync::Arc::new(fonts),
        ..usvg::Options::default()
    };
    // A plan from elsewhere reads no files of this machine.
    options.image_href_resolver.resolve_string = Box::new(|_, _| None);
    let tree = usvg::Tree::from_data(bytes, &options).map_err(|error| error.to_string())?;
    let size = tree.size();
    let zoom = SIDE as f32 / size.width().max(size.height());
    let [w, h] = [size.width(), size.height()].map(|side| (side * zoom).round().max(1.0) as u32);
    let mut pixels = tiny_skia::Pixmap::new(w, h).ok_or("The drawing has no size.")?;
    pixels.fill(tiny_skia::Color::WHITE);
    resvg::render(&tree, tiny_skia::Transform::from_scale(zoom, zoom), &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
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
}
