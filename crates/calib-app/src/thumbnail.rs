//! The small still by which a site is known where sites are kept.

use std::io::Cursor;

use calib_editor::data_uri;
use calib_site::Site;
use image::RgbImage;

use crate::picture::Pictures;

/// Twice what the start page shows, for screens of many pixels.
const SIZE: [u32; 2] = [168, 104];

/// The first still of a site, small: made once, when it is decoded.
#[derive(Debug, Default)]
pub(crate) struct Thumbnail {
    /// What the site calls the still, and the small one as a `data:` URI.
    made: Option<(String, String)>,
    /// The still whose pixels were not there yet.
    awaited: Option<String>,
}

impl Thumbnail {
    /// Makes it, if that is another still than before and its pixels are there.
    pub(crate) fn renew(&mut self, site: &Site, pictures: &Pictures) {
        self.awaited = None;
        let Some(name) = first(site).filter(|name| self.made.as_ref().is_none_or(|(made, _)| made != name))
        else {
            return;
        };
        let picture = pictures.ready(name);
        self.awaited = picture.is_none().then(|| name.to_owned());
        let small = picture.and_then(|picture| small(&picture.image));
        self.made = small.map(|small| (name.to_owned(), small)).or(self.made.take());
    }

    /// Whether the pixels have arrived that were not there when it was to be made.
    pub(crate) fn is_due(&self, pictures: &Pictures) -> bool {
        self.awaited.as_ref().is_some_and(|name| pictures.ready(name).is_some())
    }

    /// That of a site.
    pub(crate) fn of(&self, site: &Site) -> Option<&str> {
        let (name, uri) = self.made.as_ref()?;
        (first(site)? == name).then_some(uri)
    }
}

fn first(site: &Site) -> Option<&str> {
    site.cameras.iter().find_map(|camera| camera.image.as_deref())
}

/// The middle of a still in the shape of the card.
fn small(still: &RgbImage) -> Option<String> {
    let [w, h] = SIZE;
    let (width, height) = still.dimensions();
    let share = (f64::from(width) / f64::from(w)).min(f64::from(height) / f64::from(h));
    let [cut_w, cut_h] = SIZE.map(|side| ((f64::from(side) * share) as u32).max(1));
    let [x, y] = [width.saturating_sub(cut_w) / 2, height.saturating_sub(cut_h) / 2];
    let cut = image::imageops::crop_imm(still, x, y, cut_w, cut_h);
    let small = image::imageops::thumbnail(&*cut, w, h);
    let mut jpeg = Cursor::new(Vec::new());
    small.write_to(&mut jpeg, image::ImageFormat::Jpeg).ok()?;
    Some(data_uri("image/jpeg", jpeg.get_ref()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thumbnail_is_the_middle_of_the_still_and_a_few_kilobytes() {
        // White in the middle, black at the sides that are cut off.
        let still = RgbImage::from_fn(2000, 600, |x, _| {
            image::Rgb([if x.abs_diff(1000) < 480 { 255 } else { 0 }; 3])
        });
        let uri = small(&still).unwrap();
        assert!(uri.starts_with("data:image/jpeg;base64,") && uri.len() < 12_000, "{}", uri.len());
        let bytes =
            calib_editor::Source::of_data_uri(&uri).unwrap().read(|_, _| Err("no file".into())).unwrap();
        let shown = calib_editor::decode(&bytes).unwrap();
        assert_eq!(<[u32; 2]>::from(shown.dimensions()), SIZE);
        assert!(shown.get_pixel(4, 50).0[0] > 240 && shown.get_pixel(163, 50).0[0] > 240);
    }
}
