//! Reading of an image from a video: one frame, or the scene without the objects that move.

use std::path::Path;
use std::sync::Arc;

use calib_image::EmptyScene;
use calib_input::frame_name;
use egui::{ColorImage, Context, TextureHandle, TextureOptions};
use image::RgbImage;

use crate::choice::Chosen;
use crate::platform::{FrameRequest, Here, Platform as _, Progress, Task, VideoFrames};

/// Number of small frames in the strip.
const STRIP_FRAMES: usize = 8;

/// Number of frames from which the empty scene is computed.
pub(crate) const SCENE_FRAMES: usize = 25;

/// Sheet for one video.
pub(crate) struct VideoSheet {
    pub(crate) file: Chosen,
    /// Small frames with their times in seconds; empty until they are read.
    pub(crate) strip: Vec<(f64, TextureHandle)>,
    pub(crate) duration_s: f64,
    pub(crate) pixel_aspect: f64,
    /// Time of the chosen frame, in seconds.
    pub(crate) time_s: f64,
    /// Whether the empty scene is chosen instead of one frame.
    pub(crate) removes_moving: bool,
    /// Whether the pixels that something covered are marked.
    pub(crate) marks_moved: bool,
    pub(crate) frame: Option<Still>,
    pub(crate) scene: Option<Still>,
    pub(crate) reading: Option<Reading>,
    pub(crate) error: Option<String>,
    /// Image that is being written as PNG: name of the file, and its bytes.
    pub(crate) encoding: Option<Task<Result<(String, Vec<u8>), String>>>,
}

impl std::fmt::Debug for VideoSheet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("VideoSheet")
            .field("file", &self.file.name)
            .field("time_s", &self.time_s)
            .finish_non_exhaustive()
    }
}

/// Image that can be used.
pub(crate) struct Still {
    /// Time of the frame, in seconds; `None` for the empty scene.
    pub(crate) time_s: Option<f64>,
    pub(crate) image: Arc<RgbImage>,
    pub(crate) texture: TextureHandle,
    /// The image with the covered pixels marked, and the shares of the pixels that something covered in some of the
    /// frames and in a third of them.
    pub(crate) moved: Option<(TextureHandle, [f64; 2])>,
}

/// Reading of frames that is running. Dropping it cancels the work.
pub(crate) struct Reading {
    pub(crate) request: FrameRequest,
    pub(crate) progress: Arc<Progress>,
    pub(crate) task: Task<Result<VideoFrames, String>>,
}

impl Drop for Reading {
    fn drop(&mut self) {
        self.progress.cancel();
    }
}

impl VideoSheet {
    /// Opens the sheet, and starts reading the strip.
    pub(crate) fn new(ctx: &Context, file: Chosen) -> Self {
        let mut sheet = Self {
            file,
            strip: Vec::new(),
            duration_s: 0.0,
            pixel_aspect: 1.0,
            time_s: 0.0,
            removes_moving: false,
            marks_moved: false,
            frame: None,
            scene: None,
            reading: None,
            error: None,
            encoding: None,
        };
        sheet.read(ctx, FrameRequest::Strip(STRIP_FRAMES));
        sheet
    }

    /// Starts reading frames, and cancels other reading.
    fn read(&mut self, ctx: &Context, request: FrameRequest) {
        let progress = Arc::<Progress>::default();
        let task = Here::frames(ctx, &self.file, request, &progress);
        self.error = None;
        self.reading = Some(Reading { request, progress, task });
    }

    /// Takes the frames that were read, and starts reading the chosen image if it is missing.
    pub(crate) fn poll(&mut self, ctx: &Context) {
        if let Some(result) =
            self.reading.as_ref().and_then(|reading| Some((reading.request, reading.task.poll()?)))
        {
            self.reading = None;
            match result {
                (request, Ok(found)) => self.take(ctx, request, found),
                (_, Err(error)) => self.error = Some(error),
            }
        }
        if self.error.is_some() || self.strip.is_empty() {
            return;
        }
        let is_read = |request| self.reading.as_ref().is_some_and(|reading| reading.request == request);
        let request = if self.removes_moving {
            self.scene.is_none().then_some(FrameRequest::Spread(SCENE_FRAMES))
        } else {
            let is_shown = self.frame.as_ref().is_some_and(|frame| frame.time_s == Some(self.time_s));
            (!is_shown).then_some(FrameRequest::At(self.time_s))
        };
        // A frame that is being decoded is shown before the next one is read, so that the image follows the slider.
        let is_decoding =
            self.reading.as_ref().is_some_and(|reading| matches!(reading.request, FrameRequest::At(_)));
        match request {
            Some(FrameRequest::At(_)) if is_decoding => {}
            Some(request) if !is_read(request) => self.read(ctx, request),
            _ => {}
        }
    }

    /// Stores frames that were read.
    fn take(&mut self, ctx: &Context, request: FrameRequest, found: VideoFrames) {
        let VideoFrames { duration_s, pixel_aspect, frames } = found;
        (self.duration_s, self.pixel_aspect) = (duration_s, pixel_aspect);
        match request {
            FrameRequest::Strip(_) => {
                let small = |(time, image): (f64, RgbImage)| (time, texture(ctx, &image));
                self.strip = frames.into_iter().map(small).collect();
                self.time_s = self.strip.first().map_or(0.0, |(time, _)| *time);
            }
            FrameRequest::At(asked) => {
                let Some((_, image)) = frames.into_iter().next() else { return };
                let texture = texture(ctx, &image);
                self.frame =
                    Some(Still { time_s: Some(asked), image: Arc::new(image), texture, moved: None });
            }
            FrameRequest::Spread(_) => {
                let images: Vec<RgbImage> = frames.into_iter().map(|(_, image)| image).collect();
                let EmptyScene { image, moved, moved_share, busy_share } = EmptyScene::new(&images);
                let marked = texture(ctx, &marked(&image, &moved));
                let texture = texture(ctx, &image);
                let moved = Some((marked, [moved_share, busy_share]));
                self.scene = Some(Still { time_s: None, image: Arc::new(image), texture, moved });
            }
        }
    }

    /// Returns the chosen image, if it is read.
    pub(crate) fn chosen(&self) -> Option<&Still> {
        if self.removes_moving {
            return self.scene.as_ref();
        }
        self.frame.as_ref().filter(|frame| frame.time_s == Some(self.time_s))
    }

    /// Returns the name of the file of an image.
    pub(crate) fn name_of(&self, still: &Still) -> String {
        let stem = Path::new(&self.file.name)
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into());
        match still.time_s {
            Some(time) => format!("{}.png", frame_name(&stem, time)),
            None => format!("{stem} empty.png"),
        }
    }
}

/// Uploads an image.
fn texture(ctx: &Context, image: &RgbImage) -> TextureHandle {
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    let pixels = ColorImage::from_rgb([width, height], image.as_raw());
    ctx.load_texture("video", pixels, TextureOptions::LINEAR)
}

/// Returns the image with some pixels tinted.
fn marked(image: &RgbImage, moved: &[bool]) -> RgbImage {
    const TINT: [u8; 3] = [255, 96, 0];
    let mut marked = image.clone();
    for (pixel, _) in marked.pixels_mut().zip(moved).filter(|(_, moved)| **moved) {
        for (value, tint) in pixel.0.iter_mut().zip(TINT) {
            *value = value.midpoint(tint);
        }
    }
    marked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_moved_pixels_are_marked() {
        let image = RgbImage::from_pixel(2, 1, image::Rgb([100, 100, 100]));
        assert_eq!(marked(&image, &[false, true]).as_raw(), &[100, 100, 100, 177, 98, 50]);
    }
}
