//! Rendering of SVG overlays onto images, with resvg.

use std::sync::Arc;

use anyhow::Context as _;
use calib_report::Svg;
use image::RgbImage;
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg;

/// Renders an SVG onto an image of the same size.
pub(crate) fn draw_on(svg: &Svg, image: &RgbImage) -> anyhow::Result<RgbImage> {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let names: Vec<String> =
        fonts.faces().flat_map(|face| face.families.iter().map(|(name, _)| name.clone())).collect();
    if let Some(name) = names.first() {
        fonts.set_sans_serif_family(name);
    }
    let options = usvg::Options {
        font_family: "sans-serif".into(),
        fontdb: Arc::new(fonts),
        ..usvg::Options::default()
    };
    let tree = usvg::Tree::from_str(&svg.finish(""), &options).context("cannot render the overlay")?;
    let (width, height) = image.dimensions();
    let mut pixmap = Pixmap::new(width, height).context("the image has no pixels")?;
    for (to, from) in pixmap.data_mut().as_chunks_mut::<4>().0.iter_mut().zip(image.pixels()) {
        let [r, g, b] = from.0;
        *to = [r, g, b, 255];
    }
    resvg::render(&tree, Transform::identity(), &mut pixmap.as_mut());
    let colours = pixmap.data().as_chunks::<4>().0.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
    RgbImage::from_raw(width, height, colours).context("the image has no pixels")
}
