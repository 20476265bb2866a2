//! Images of the demonstration that are served with the page. They are rendered at build time, because
//! rendering takes a minute in a browser.

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

/// JPEG image, and its file name in the demonstration's site.
pub(crate) struct DemoImage {
    pub(crate) name: String,
    pub(crate) jpeg: Vec<u8>,
}

/// Renders every image that the demonstration's site names.
pub(crate) fn demo_images() -> anyhow::Result<Vec<DemoImage>> {
    let demo = calib_demo::demo_site();
    let cameras = demo.truth.iter().zip(&demo.site.cameras);
    let named =
        cameras.filter_map(|((_, camera), entry)| Some((entry.image.clone()?, camera, entry.size_px)));
    let mut pictures: Vec<DemoImage> = named
        .map(|(name, camera, size)| DemoImage::new(name, &calib_demo::render(camera, size)))
        .collect::<anyhow::Result<_>>()?;
    if let Some(name) = demo.site.plan.as_ref().and_then(|plan| plan.image.clone()) {
        pictures.push(DemoImage::new(name, &calib_demo::render_plan())?);
    }
    Ok(pictures)
}

impl DemoImage {
    fn new(name: String, image: &RgbImage) -> anyhow::Result<Self> {
        /// JPEG quality at which edges move by less than 0.1 px.
        const QUALITY: u8 = 82;
        let mut jpeg = Vec::new();
        image.write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, QUALITY))?;
        Ok(Self { name, jpeg })
    }
}
