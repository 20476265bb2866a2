//! Sharp picture of the visible part of a drawing: a PDF or a DXF is drawn again for the zoom of the plan.

use std::sync::Arc;

use calib_plan::Part;
use egui::{ColorImage, Context, TextureHandle, TextureOptions};
use image::RgbImage;

use crate::platform::{Here, Platform as _, Task};

/// Time without panning and zooming after which the visible part is drawn, in seconds.
const PAUSE_S: f64 = 0.2;
/// Zoom, in screen pixels per pixel of the whole picture, from which the whole picture looks blurred.
const BLURRED_ZOOM: f64 = 1.2;
/// Largest ratio of two zooms that look equally sharp.
const SIMILAR_ZOOM: f64 = 1.25;
/// Margin around the visible part, as a share of its size.
const MARGIN: f64 = 0.25;
/// Largest side of the picture of a part, in pixels.
const MAX_SIDE: f64 = 4096.0;
/// Number of failures after which no more parts are drawn.
const MAX_FAILURES: usize = 2;

/// Visible part of the plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Visible {
    /// Upper left and lower right corner, in pixels of the whole picture.
    pub(crate) corners: [[f64; 2]; 2],
    /// Screen pixels per pixel of the whole picture.
    pub(crate) zoom: f64,
}

/// Sharp picture of a part of a drawing, and the task that makes the next one.
pub(crate) struct Detail {
    svg: Arc<[u8]>,
    /// Part with its sharp picture.
    pub(crate) drawn: Option<(Part, TextureHandle)>,
    task: Option<(Part, Task<Result<RgbImage, String>>)>,
    /// Number of parts that could not be drawn.
    failures: usize,
    /// Last visible part, and the time from which it has been visible, on the clock of egui in seconds.
    seen: Option<(Visible, f64)>,
}

impl Detail {
    pub(crate) fn new(svg: Arc<[u8]>) -> Self {
        Self { svg, drawn: None, task: None, failures: 0, seen: None }
    }

    /// Stores a part that was drawn, and starts drawing the visible part if the shown picture is blurred. `whole` is
    /// the size of the whole picture, in pixels.
    pub(crate) fn update(&mut self, ctx: &Context, whole: [u32; 2], visible: Visible) {
        if let Some((part, task)) = self.task.take() {
            match task.outcome() {
                None => self.task = Some((part, task)),
                Some(Ok(Ok(image))) => {
                    let size = [image.width(), image.height()].map(|side| side as usize);
                    let pixels = ColorImage::from_rgb(size, &image);
                    self.drawn = Some((part, ctx.load_texture("detail", pixels, TextureOptions::LINEAR)));
                }
                // The whole picture stays.
                Some(_) => self.failures += 1,
            }
        }
        if visible.zoom < BLURRED_ZOOM {
            (self.drawn, self.task) = (None, None);
            return;
        }
        let now = ctx.input(|input| input.time);
        let since = match self.seen {
            Some((seen, since)) if seen == visible => since,
            _ => now,
        };
        self.seen = Some((visible, since));
        let most = ctx.input(|input| input.max_texture_side) as f64;
        let wanted = wanted(whole, visible, most.min(MAX_SIDE));
        let is_new = |wanted: &Part| self.failures < MAX_FAILURES && !self.shows(wanted, visible);
        let Some(wanted) = wanted.filter(is_new) else { return };
        if now - since < PAUSE_S {
            ctx.request_repaint_after_secs((PAUSE_S - (now - since)) as f32 + 0.01);
        } else if self.task.is_none() {
            self.task = Some((wanted, Here::draw_part(ctx, Arc::clone(&self.svg), wanted)));
        }
    }

    /// Whether the drawn part shows all that is visible, as sharply as the wanted part.
    fn shows(&self, wanted: &Part, Visible { corners: [low, high], .. }: Visible) -> bool {
        let density = |part: &Part| f64::from(part.pixels[0]) / part.size[0];
        self.drawn.as_ref().is_some_and(|(part, _)| {
            let covers = (0..2).all(|k| {
                let [low, high] = [low[k], high[k]].map(|at| at.clamp(0.0, f64::from(part.whole[k])));
                part.low[k] <= low + 1.0 && high <= part.low[k] + part.size[k] + 1.0
            });
            covers && density(wanted) < SIMILAR_ZOOM * density(part)
        })
    }
}

/// Returns the visible part with its margin; `None` if no part of the picture is visible, or if its sharp picture
/// would not be sharper than the whole one. `most` is the largest side, in pixels.
fn wanted(whole: [u32; 2], Visible { corners: [low, high], zoom }: Visible, most: f64) -> Option<Part> {
    let margin = [0, 1].map(|k| {
        let side = high[k] - low[k];
        (MARGIN * side).min(0.5 * (most / zoom - side)).max(0.0)
    });
    let within = |k: usize, at: f64| at.clamp(0.0, f64::from(whole[k]));
    let low: [f64; 2] = std::array::from_fn(|k| within(k, low[k] - margin[k]).floor());
    let high: [f64; 2] = std::array::from_fn(|k| within(k, high[k] + margin[k]).ceil());
    let size = [high[0] - low[0], high[1] - low[1]];
    if !size.iter().all(|side| *side >= 1.0) {
        return None;
    }
    let zoom = zoom.min(most / size[0]).min(most / size[1]);
    (zoom > 1.0).then(|| Part {
        whole,
        low,
        size,
        pixels: size.map(|side| (side * zoom).round().max(1.0) as u32),
    })
}

impl Detail {
    /// Returns the memory of the document and of the picture, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let pixels = self.drawn.as_ref().map_or([0; 2], |(part, _)| part.pixels);
        self.svg.len() + 4 * pixels[0] as usize * pixels[1] as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wanted_part_covers_what_is_visible() {
        let visible = Visible { corners: [[100.0, 200.0], [300.0, 320.0]], zoom: 8.0 };
        let part = wanted([1000, 800], visible, 4096.0).unwrap();
        assert_eq!((part.low, part.size), ([50.0, 170.0], [300.0, 180.0]));
        assert_eq!(part.pixels, [2400, 1440]);
        // The number of pixels is limited, and no area outside the picture is drawn.
        let blurred = Visible { corners: [[0.0, 0.0], [1000.0, 800.0]], zoom: 1.3 };
        assert_eq!(wanted([1000, 800], blurred, 900.0), None);
        let edge = Visible { corners: [[-500.0, -500.0], [1900.0, 1900.0]], zoom: 8.0 };
        let part = wanted([1000, 800], edge, 4096.0).unwrap();
        assert_eq!((part.low, part.size, part.pixels), ([0.0, 0.0], [1000.0, 800.0], [4096, 3277]));
        let outside = Visible { corners: [[2000.0, 0.0], [2100.0, 50.0]], zoom: 8.0 };
        assert_eq!(wanted([1000, 800], outside, 4096.0), None);
    }
}
