//! HEIC images of phones (feature `heic`). The orientation is part of the format: it is applied while decoding, and
//! the orientation in the EXIF data is ignored.

use std::panic::{AssertUnwindSafe, catch_unwind};

use heic_rs::context::Context;
use heic_rs::{DecodeOptions, Error, ImageInfo};
use image::error::{DecodingError, ImageFormatHint};
use image::{ColorType, ImageDecoder, ImageError, ImageResult};

/// Decoder of one HEIC image.
pub(crate) struct HeicDecoder<'a> {
    bytes: &'a [u8],
    info: ImageInfo,
}

impl<'a> HeicDecoder<'a> {
    /// Reads the header.
    pub(crate) fn new(bytes: &'a [u8]) -> ImageResult<Self> {
        let info = without_panic(|| {
            let info = heic_rs::probe(bytes)?;
            check_sizes(bytes, &info)?;
            Ok(info)
        })?;
        Ok(Self { bytes, info })
    }
}

/// Checks that the coded pictures have the sizes in the header, and that the tiles of a grid cover the image only
/// once. Otherwise a small file could need any amount of memory and time.
fn check_sizes(bytes: &[u8], info: &ImageInfo) -> Result<(), Error> {
    let context = Context::open(bytes)?;
    let tiles = context.grid(info.primary_item)?;
    let items = match &tiles {
        Some((_, tiles)) => tiles.clone(),
        None => vec![info.primary_item],
    };
    if let (Some((grid, _)), Some(tile)) = (&tiles, info.grid) {
        let side = |count: u32, side: u32| u64::from(count) * u64::from(side);
        let is_covered_once =
            |count, tile, whole: u32| side(count, tile) < u64::from(whole) + u64::from(tile);
        let [w, h] = [info.coded_width, info.coded_height];
        if !is_covered_once(grid.columns, tile.tile_width, w)
            || !is_covered_once(grid.rows, tile.tile_height, h)
        {
            return Err(Error::Malformed("its tiles are larger than the image"));
        }
    }
    let mut checked = std::collections::BTreeSet::new();
    for item in items.into_iter().filter(|item| checked.insert(*item)) {
        let properties = context.props(item)?;
        let (Some(size), Some(codec)) = (&properties.ispe, &properties.hvcc) else { continue };
        let coded = heic_rs::hevc::probe(&codec.parameter_sets())?;
        if [coded.width, coded.height] != [size.width, size.height] {
            return Err(Error::Malformed("the size of a coded image differs from its header"));
        }
    }
    Ok(())
}

/// Runs a part of the decoder; a panic becomes an error of the file.
fn without_panic<T>(read: impl FnOnce() -> Result<T, Error>) -> ImageResult<T> {
    let found = catch_unwind(AssertUnwindSafe(read));
    found.unwrap_or(Err(Error::Malformed("its data are inconsistent"))).map_err(|error| {
        ImageError::Decoding(DecodingError::new(ImageFormatHint::Name("HEIC".into()), error.to_string()))
    })
}

impl ImageDecoder for HeicDecoder<'_> {
    fn dimensions(&self) -> (u32, u32) {
        (self.info.width, self.info.height)
    }

    fn color_type(&self) -> ColorType {
        ColorType::Rgb8
    }

    fn exif_metadata(&mut self) -> ImageResult<Option<Vec<u8>>> {
        let (bytes, item) = (self.bytes, self.info.primary_item);
        without_panic(|| Ok(Context::open(bytes)?.exif(item)?.map(<[u8]>::to_vec)))
    }

    fn read_image(self, buffer: &mut [u8]) -> ImageResult<()> {
        let pixels = u64::from(self.info.width) * u64::from(self.info.height);
        let options = DecodeOptions::default().with_max_pixels(Some(pixels)).with_alpha(false);
        let image = without_panic(|| heic_rs::decode(self.bytes, &options))?;
        if image.data.len() != buffer.len() {
            return without_panic(|| Err(Error::Malformed("its size differs from its header")));
        }
        buffer.copy_from_slice(&image.data);
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, buffer: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(buffer)
    }
}
