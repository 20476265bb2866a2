//! Reading of an image from a video: one frame, or the scene without the objects that move.

use std::path::Path;
use std::sync::Arc;

use calib_editor::images::png;
use calib_image::{EmptyScene, shrunk};
use calib_input::frame_name;
use egui::{ColorImage, Context, TextureHandle, TextureOptions};
use image::RgbImage;

use crate::choice::Chosen;
use crate::platform::{FrameRequest, Here, Lost, Platform as _, Progress, Task, VideoContent, VideoFrames};

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
    /// Whether the scene without moving objects is chosen instead of one frame.
    pub(crate) removes_moving: bool,
    /// Whether the pixels that moving objects covered are marked.
    pub(crate) marks_changed: bool,
    pub(crate) frame: Option<Still>,
    pub(crate) scene: Option<Still>,
    pub(crate) reading: Option<Reading>,
    pub(crate) error: Option<String>,
    /// Image that is being saved.
    pub(crate) saving: Option<Task<Result<Chosen, String>>>,
}

impl std::fmt::Debug for VideoSheet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("VideoSheet")
            .field("file", &self.file.name)
            .field("time_s", &self.time_s)
            .finish_non_exhaustive()
    }
}

/// Image from the video that the operator can use: a frame, or the scene without moving objects.
pub(crate) struct Still {
    /// Time at which the frame was requested, and time at which it appears, in seconds. `None` for the scene without
    /// moving objects.
    pub(crate) times_s: Option<[f64; 2]>,
    pub(crate) image: Arc<RgbImage>,
    pub(crate) texture: TextureHandle,
    /// Image with the changed pixels marked, and two shares of pixels, 0 to 1. Moving objects covered the first
    /// share in some of the frames, and the second share in at least a third of them. `None` for a frame.
    pub(crate) changed: Option<(TextureHandle, [f64; 2])>,
}

/// Reading of frames that is running. Dropping it cancels the work after the current frame.
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
            marks_changed: false,
            frame: None,
            scene: None,
            reading: None,
            error: None,
            saving: None,
        };
        sheet.read(ctx, FrameRequest::Strip(STRIP_FRAMES));
        // The browser keeps its own copy of the video.
        sheet.file.bytes = None;
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
        let outcome =
            self.reading.as_ref().and_then(|reading| Some((reading.request, reading.task.outcome()?)));
        if let Some((request, outcome)) = outcome {
            self.reading = None;
            match outcome {
                Ok(Ok(found)) => self.take(ctx, request, found),
                Ok(Err(error)) => self.error = Some(format!("{} {error}.", self.file.name)),
                Err(Lost) => {
                    let name = &self.file.name;
                    self.error = Some(format!("Internal error while reading {name}. Please report it."));
                }
            }
        }
        if self.error.is_some() || self.strip.is_empty() {
            return;
        }
        let is_requested = |request| self.reading.as_ref().is_some_and(|reading| reading.request == request);
        let request = if self.removes_moving {
            self.scene.is_none().then_some(FrameRequest::Scene(SCENE_FRAMES))
        } else {
            self.chosen().is_none().then_some(FrameRequest::At(self.time_s))
        };
        // A frame that is being decoded is shown before the next one is read, so that the image follows the slider.
        let is_decoding =
            self.reading.as_ref().is_some_and(|reading| matches!(reading.request, FrameRequest::At(_)));
        match request {
            Some(FrameRequest::At(_)) if is_decoding => {}
            Some(request) if !is_requested(request) => self.read(ctx, request),
            _ => {}
        }
    }

    /// Stores frames that were read.
    fn take(&mut self, ctx: &Context, request: FrameRequest, found: VideoFrames) {
        (self.duration_s, self.pixel_aspect) = (found.duration_s, found.pixel_aspect);
        match (request, found.content) {
            (FrameRequest::At(requested), VideoContent::Frames(frames)) => {
                let Some((time, image)) = frames.into_iter().next() else { return };
                let texture = texture(ctx, &image);
                let times_s = Some([requested, time]);
                self.frame = Some(Still { times_s, image: Arc::new(image), texture, changed: None });
            }
            (_, VideoContent::Frames(frames)) => {
                let small = |(time, image): (f64, RgbImage)| (time, texture(ctx, &image));
                self.strip = frames.into_iter().map(small).collect();
                self.time_s = self.strip.first().map_or(0.0, |(time, _)| *time);
            }
            (_, VideoContent::Scene(EmptyScene { image, changed, changed_share, busy_share })) => {
                let marked = texture(ctx, &marked(&image, &changed));
                let texture = texture(ctx, &image);
                let changed = Some((marked, [changed_share, busy_share]));
                self.scene = Some(Still { times_s: None, image: Arc::new(image), texture, changed });
            }
        }
    }

    /// Returns the chosen image, if it is read.
    pub(crate) fn chosen(&self) -> Option<&Still> {
        if self.removes_moving {
            return self.scene.as_ref();
        }
        let is_chosen = |frame: &&Still| frame.times_s.is_some_and(|[requested, _]| requested == self.time_s);
        self.frame.as_ref().filter(is_chosen)
    }

    /// Returns the file name of an image, without an ending.
    pub(crate) fn name_of(&self, still: &Still) -> String {
        let stem = Path::new(&self.file.name)
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into());
        match still.times_s {
            Some([_, time]) => frame_name(&stem, time),
            None => format!("{stem} empty"),
        }
    }

    /// Starts saving the chosen image as PNG. The desktop app writes it to the folder of the video. The page keeps it
    /// in memory.
    pub(crate) fn save(&mut self, ctx: &Context) {
        let Some(still) = self.chosen() else { return };
        let (image, name) = (Arc::clone(&still.image), self.name_of(still));
        let video = self.file.path.clone();
        let save = move || Ok(save_image(video.as_deref(), &name, "png", png(&image)?));
        self.saving = Some(Task::spawn(ctx, save));
    }
}

impl Drop for VideoSheet {
    fn drop(&mut self) {
        Here::close_video();
    }
}

/// Writes an image to the folder of the file `neighbour`, such as its video. If another file has the name, a number is
/// added to the name. If there is no folder, or the image cannot be written, it is returned in memory.
pub(crate) fn save_image(neighbour: Option<&Path>, name: &str, ending: &str, bytes: Vec<u8>) -> Chosen {
    const MAX_NUMBER: u32 = 100;
    let named = |number: u32| match number {
        1 => format!("{name}.{ending}"),
        number => format!("{name}-{number}.{ending}"),
    };
    let paths =
        neighbour.into_iter().flat_map(|file| (1..MAX_NUMBER).map(move |k| file.with_file_name(named(k))));
    for path in paths {
        if !path.exists() {
            match Here::write(&path, &bytes) {
                Ok(()) => return Chosen::of_path(path),
                Err(_) => break,
            }
        }
        if Here::read(&path).is_ok_and(|old| old == bytes) {
            return Chosen::of_path(path);
        }
    }
    Chosen { name: named(1), path: None, bytes: Some(bytes) }
}

/// Uploads an image, at a size that every graphics card supports.
fn texture(ctx: &Context, image: &RgbImage) -> TextureHandle {
    /// Longest side of the texture, in pixels.
    const MAX_SIDE: u32 = 1280;
    let smaller = shrunk(image, MAX_SIDE);
    let image = smaller.as_ref().unwrap_or(image);
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    let pixels = ColorImage::from_rgb([width, height], image.as_raw());
    ctx.load_texture("video", pixels, TextureOptions::LINEAR)
}

/// Returns the image with the `changed` pixels tinted.
fn marked(image: &RgbImage, changed: &[bool]) -> RgbImage {
    const TINT: [u8; 3] = [255, 96, 0];
    let mut marked = image.clone();
    for (pixel, _) in marked.pixels_mut().zip(changed).filter(|(_, changed)| **changed) {
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
    fn only_changed_pixels_are_marked() {
        let image = RgbImage::from_pixel(2, 1, image::Rgb([100, 100, 100]));
        assert_eq!(marked(&image, &[false, true]).as_raw(), &[100, 100, 100, 177, 98, 50]);
    }
}
