//! The pictures of the demonstration as they lie beside the page: rendered here, for in a browser that takes a
//! minute.

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

/// A picture, and the name that the demonstration has for it.
pub(crate) struct Picture {
    pub(crate) name: String,
    pub(crate) jpeg: Vec<u8>,
}

/// Every image that the demonstration names.
pub(crate) fn pictures() -> anyhow::Result<Vec<Picture>> {
    let demo = calib_demo::demo_site();
    let cameras = demo.truth.iter().zip(&demo.site.cameras);
    let named =
        cameras.filter_map(|((_, camera), entry)| Some((entry.image.clone()?, camera, entry.size_px)));
    let mut pictures: Vec<Picture> = named
        .map(|(name, camera, size)| Picture::new(name, &calib_demo::render(camera, size)))
        .collect::<anyhow::Result<_>>()?;
    if let Some(name) = demo.site.plan.as_ref().and_then(|plan| plan.image.clone()) {
        pictures.push(Picture::new(name, &demo.plan)?);
    }
    Ok(pictures)
}

impl Picture {
    fn new(name: String, image: &RgbImage) -> anyhow::Result<Self> {
        /// Edges stay where they are to a tenth of a pixel.
        const QUALITY: u8 = 82;
        let mut jpeg = Vec::new();
        image.write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, QUALITY))?;
        Ok(Self { name, jpeg })
    }
}
