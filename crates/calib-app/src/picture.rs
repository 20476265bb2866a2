//! Images: decoding in the background, textures in tiles no larger than the GL limit, small copies.

use std::collections::BTreeMap;
use std::sync::Arc;

use calib_editor::Source;
use calib_plan::{DrawingFacts, Part, View};
use calib_site::Plan;
use egui::{Color32, ColorImage, Context, Painter, Pos2, Rect, TextureHandle, TextureOptions, Vec2};
use image::RgbImage;

use crate::canvas::Mapping;
use crate::detail::{Detail, Visible};
use crate::drawing::DecodedImage;
use crate::platform::{Here, Platform as _, Task};

/// Whether memory is limited to 4 GB, as in a browser.
const HAS_SMALL_MEMORY: bool = cfg!(target_pointer_width = "32");
/// Largest side of a tile, in pixels; WebGL2 guarantees no larger textures.
const MAX_TILE_SIDE_PX: u32 = 2048;
/// Longer side of the small copy of an image, in pixels.
const OVERVIEW_SIDE_PX: u32 = 1024;
/// Memory budget for decoded images, in bytes. The images that were not shown for the longest time are
/// dropped first.
const MEMORY_BUDGET_BYTES: usize = if HAS_SMALL_MEMORY { 1 << 28 } else { 1 << 30 };

/// Decoded image, cut into tiles that are not uploaded yet.
struct Decoded {
    image: RgbImage,
    drawing: Option<DrawingFacts>,
    svg: Option<Arc<[u8]>>,
    tiles: Vec<([u32; 2], ColorImage)>,
    overview: ColorImage,
}

/// Decoded image with its textures.
pub struct Picture {
    /// Pixels of the image.
    pub image: Arc<RgbImage>,
    /// Small copy of the whole image.
    pub overview: TextureHandle,
    /// Properties of the drawing that was rasterised; `None` for other images.
    pub drawing: Option<DrawingFacts>,
    /// Sharp picture of the visible part of a drawing.
    detail: Option<Detail>,
    waiting: Vec<([u32; 2], ColorImage)>,
    tiles: Vec<([u32; 2], [u32; 2], TextureHandle)>,
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Picture").field("size", &self.size()).finish_non_exhaustive()
    }
}

/// Texture with the rectangle of image pixels that it covers.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Upper left corner of the covered rectangle, in image pixels.
    pub low: [f64; 2],
    /// Width and height of the covered rectangle, in image pixels.
    pub size: [f64; 2],
    /// Id of the texture.
    pub texture: egui::TextureId,
}

enum State {
    Loading(Task<Result<Decoded, String>>),
    Ready(Box<Picture>),
    Failed(String),
}

struct Slot {
    state: State,
    /// Number of the last frame that showed the image.
    shown: u64,
}

/// Requested images and their decoding, by their name in the site.
#[derive(Default)]
pub struct Pictures {
    slots: BTreeMap<String, Slot>,
    frame: u64,
}

impl std::fmt::Debug for Pictures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pictures").field("slots", &self.slots.len()).finish_non_exhaustive()
    }
}

/// Cuts an image into tiles, and makes its small copy.
fn cut_into_tiles(DecodedImage { image, drawing, svg }: DecodedImage) -> Decoded {
    let (width, height) = image.dimensions();
    let mut tiles = Vec::new();
    for y in (0..height).step_by(MAX_TILE_SIDE_PX as usize - 2) {
        for x in (0..width).step_by(MAX_TILE_SIDE_PX as usize - 2) {
            // Neighbouring tiles overlap by two pixels, so that filtering shows no seam.
            let (w, h) = (MAX_TILE_SIDE_PX.min(width - x), MAX_TILE_SIDE_PX.min(height - y));
            let tile = image::imageops::crop_imm(&image, x, y, w, h).to_image();
            tiles.push(([x, y], ColorImage::from_rgb([w as usize, h as usize], &tile)));
        }
    }
    let ratio = (f64::from(OVERVIEW_SIDE_PX) / f64::from(width.max(height).max(1))).min(1.0);
    let size = [width, height].map(|side| ((f64::from(side) * ratio) as u32).max(1));
    let small = image::imageops::thumbnail(&image, size[0], size[1]);
    let overview = ColorImage::from_rgb(size.map(|side| side as usize), &small);
    Decoded { image, drawing, svg, tiles, overview }
}

fn texture_options() -> TextureOptions {
    TextureOptions { mipmap_mode: Some(egui::TextureFilter::Linear), ..TextureOptions::LINEAR }
}

impl Picture {
    fn upload(ctx: &Context, name: &str, decoded: Decoded) -> Self {
        let overview = ctx.load_texture(format!("{name} small"), decoded.overview, texture_options());
        Self {
            image: Arc::new(decoded.image),
            overview,
            drawing: decoded.drawing,
            detail: decoded.svg.map(Detail::new),
            waiting: decoded.tiles,
            tiles: Vec::new(),
        }
    }

    /// Returns width and height of the image, in pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.image.dimensions().into()
    }

    /// Returns the estimated memory of the image with its textures, in bytes.
    fn bytes(&self) -> usize {
        self.image.len() + 4 * self.image.len() / 3 + self.detail.as_ref().map_or(0, Detail::bytes)
    }

    /// Uploads one more tile. Uploading all tiles in one frame would cause a delay.
    fn next_tile(&mut self, ctx: &Context) {
        let Some((at, tile)) = self.waiting.pop() else { return };
        let size = tile.size.map(|side| side as u32);
        self.tiles.push((at, size, ctx.load_texture("tile", tile, texture_options())));
        ctx.request_repaint();
    }

    /// Returns the tiles of the image, or its small copy until all tiles are uploaded.
    pub fn pieces(&mut self, ctx: &Context) -> Vec<Piece> {
        self.next_tile(ctx);
        if !self.waiting.is_empty() {
            return vec![Piece {
                low: [0.0, 0.0],
                size: self.size().map(f64::from),
                texture: self.overview.id(),
            }];
        }
        let piece = |(at, size, texture): &([u32; 2], [u32; 2], TextureHandle)| Piece {
            low: at.map(f64::from),
            size: size.map(f64::from),
            texture: texture.id(),
        };
        self.tiles.iter().map(piece).collect()
    }

    /// Returns the tiles of a plan. If they are blurred at this zoom, the last piece is a sharp picture of the visible
    /// part, once it is drawn.
    pub(crate) fn pieces_of_plan(&mut self, ctx: &Context, visible: Visible) -> Vec<Piece> {
        let (mut pieces, whole) = (self.pieces(ctx), self.size());
        if let Some(detail) = &mut self.detail {
            detail.update(ctx, whole, visible);
            pieces.extend(detail.drawn.as_ref().map(|(part, texture)| Piece {
                low: part.low,
                size: part.size,
                texture: texture.id(),
            }));
        }
        pieces
    }

    /// Returns the part of a drawing that is shown as a sharp picture.
    #[must_use]
    pub fn sharp_part(&self) -> Option<Part> {
        Some(self.detail.as_ref()?.drawn.as_ref()?.0)
    }

    /// Paints the image at its position on the canvas, multiplied by the colour `tint`.
    pub fn paint(&mut self, painter: &Painter, mapping: &Mapping, tint: Color32) {
        if mapping.bend.is_some_and(|bend| bend.size().is_some()) {
            // Areas without pixels are black, like the area outside an image circle.
            painter.rect_filled(mapping.rect.intersect(painter.clip_rect()), 0.0, Color32::BLACK);
            // The small copy is painted below the tiles, for cells that cross two of them.
            let size = self.size().map(f64::from);
            Piece { low: [0.0, 0.0], size, texture: self.overview.id() }.paint(painter, mapping, tint);
        }
        if tint == Color32::WHITE {
            for piece in self.pieces(painter.ctx()) {
                piece.paint(painter, mapping, tint);
            }
        } else {
            let size = self.size().map(f64::from);
            Piece { low: [0.0, 0.0], size, texture: self.overview.id() }.paint(painter, mapping, tint);
        }
    }
}

impl Piece {
    /// Paints the texture at its position on the canvas, multiplied by the colour `tint`. An undistorted
    /// image is painted as a mesh of cells.
    pub fn paint(&self, painter: &Painter, mapping: &Mapping, tint: Color32) {
        /// Number of cells along each side of the mesh of an undistorted image.
        const CELLS_PER_SIDE: u32 = 32;
        let at =
            |s: f64, t: f64| mapping.screen([self.low[0] + s * self.size[0], self.low[1] + t * self.size[1]]);
        if mapping.bend.is_some_and(|bend| bend.size().is_some()) {
            return self.paint_window(painter, mapping, tint);
        }
        if mapping.bend.is_none() {
            let rect = Rect::from_two_pos(at(0.0, 0.0), at(1.0, 1.0));
            if rect.intersects(painter.clip_rect()) {
                painter.image(self.texture, rect, Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0)), tint);
            }
            return;
        }
        let mut mesh = egui::Mesh::with_texture(self.texture);
        for row in 0..=CELLS_PER_SIDE {
            for column in 0..=CELLS_PER_SIDE {
                let (s, t) = (
                    f64::from(column) / f64::from(CELLS_PER_SIDE),
                    f64::from(row) / f64::from(CELLS_PER_SIDE),
                );
                let uv = Pos2::new(s as f32, t as f32);
                mesh.vertices.push(egui::epaint::Vertex { pos: at(s, t), uv, color: tint });
            }
        }
        for row in 0..CELLS_PER_SIDE {
            for column in 0..CELLS_PER_SIDE {
                let first = row * (CELLS_PER_SIDE + 1) + column;
                mesh.add_triangle(first, first + 1, first + CELLS_PER_SIDE + 1);
                mesh.add_triangle(first + 1, first + CELLS_PER_SIDE + 2, first + CELLS_PER_SIDE + 1);
            }
        }
        painter.add(egui::Shape::mesh(mesh));
    }

    /// Paints the part of the texture that a fisheye window shows, as a mesh of screen cells. The corners of the
    /// cells are mapped to image pixels.
    fn paint_window(&self, painter: &Painter, mapping: &Mapping, tint: Color32) {
        /// Side of a cell, in points.
        const CELL_SIDE: f32 = 12.0;
        /// Largest number of halvings of a cell on the border of the visible area. The smallest cells are
        /// smaller than a point.
        const MAX_HALVINGS: u32 = 4;
        let rect = mapping.rect.intersect(painter.clip_rect());
        if !rect.is_positive() {
            return;
        }
        let [columns, rows] = [rect.width(), rect.height()].map(|side| (side / CELL_SIDE).ceil() as u32);
        let mut mesh = egui::Mesh::with_texture(self.texture);
        let mut is_shown = Vec::new();
        for row in 0..=rows {
            for column in 0..=columns {
                let share = Vec2::new(column as f32 / columns as f32, row as f32 / rows as f32);
                let pos = rect.min + share * rect.size();
                let uv = self.uv(mapping, pos);
                is_shown.push(uv.is_some());
                mesh.vertices.push(egui::epaint::Vertex { pos, uv: uv.unwrap_or_default(), color: tint });
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let first = row * (columns + 1) + column;
                let corners = [first, first + 1, first + columns + 1, first + columns + 2];
                let shown = corners.iter().filter(|&&corner| is_shown[corner as usize]).count();
                if shown == corners.len() {
                    mesh.add_triangle(corners[0], corners[1], corners[2]);
                    mesh.add_triangle(corners[1], corners[3], corners[2]);
                } else if shown > 0 {
                    let [low, high] =
                        [corners[0], corners[3]].map(|corner| mesh.vertices[corner as usize].pos);
                    self.add_subdivided_cell(
                        &mut mesh,
                        mapping,
                        (Rect::from_min_max(low, high), tint),
                        MAX_HALVINGS,
                    );
                }
            }
        }
        painter.add(egui::Shape::mesh(mesh));
    }

    /// Adds a cell that crosses the border of the visible area to the mesh, in smaller cells.
    fn add_subdivided_cell(
        &self,
        mesh: &mut egui::Mesh,
        mapping: &Mapping,
        (cell, tint): (Rect, Color32),
        halvings: u32,
    ) {
        let middle = cell.center();
        for low in [cell.min, Pos2::new(middle.x, cell.top()), Pos2::new(cell.left(), middle.y), middle] {
            let quarter = Rect::from_min_size(low, 0.5 * cell.size());
            let corners =
                [quarter.left_top(), quarter.right_top(), quarter.left_bottom(), quarter.right_bottom()];
            let shown = corners
                .map(|pos| Some(egui::epaint::Vertex { pos, uv: self.uv(mapping, pos)?, color: tint }));
            if let [Some(a), Some(b), Some(c), Some(d)] = shown {
                let first = mesh.vertices.len() as u32;
                mesh.vertices.extend([a, b, c, d]);
                mesh.add_triangle(first, first + 1, first + 2);
                mesh.add_triangle(first + 1, first + 3, first + 2);
            } else if halvings > 1 && shown.iter().any(Option::is_some) {
                self.add_subdivided_cell(mesh, mapping, (quarter, tint), halvings - 1);
            }
        }
    }

    /// Returns the texture coordinates (0 to 1) at a screen point of a window; `None` outside the texture.
    fn uv(&self, mapping: &Mapping, pos: Pos2) -> Option<Pos2> {
        let at = mapping.bent_at(pos)?;
        let uv = [(at.u - self.low[0]) / self.size[0], (at.v - self.low[1]) / self.size[1]];
        let is_own = uv.iter().all(|part| (0.0..=1.0).contains(part));
        is_own.then(|| Pos2::new(uv[0] as f32, uv[1] as f32))
    }
}

impl Pictures {
    /// Collects decoded images, and drops images if they exceed the memory budget.
    pub fn begin_frame(&mut self, ctx: &Context) {
        self.frame += 1;
        for (name, slot) in &mut self.slots {
            if let State::Loading(task) = &slot.state
                && let Some(result) = task.poll()
            {
                slot.state = match result {
                    Ok(decoded) => State::Ready(Box::new(Picture::upload(ctx, name, decoded))),
                    Err(error) => State::Failed(error),
                };
            }
        }
        self.evict();
    }

    /// Drops the images that were not shown for the longest time until the memory budget suffices.
    fn evict(&mut self) {
        let size = |slot: &Slot| match &slot.state {
            State::Ready(picture) => picture.bytes(),
            _ => 0,
        };
        let mut total: usize = self.slots.values().map(size).sum();
        while total > MEMORY_BUDGET_BYTES {
            let is_idle = |slot: &&Slot| size(slot) > 0 && slot.shown + 1 < self.frame;
            let oldest = self.slots.iter().filter(|(_, s)| is_idle(s)).min_by_key(|(_, slot)| slot.shown);
            let Some((name, freed)) = oldest.map(|(name, slot)| (name.clone(), size(slot))) else { return };
            self.slots.remove(&name);
            total -= freed;
        }
    }

    /// Returns an image once it is decoded; the first call starts the decoding.
    pub fn get(&mut self, ctx: &Context, name: &str, bytes: impl FnOnce() -> Source) -> Option<&mut Picture> {
        self.get_part(ctx, name, || (bytes(), View::default()))
    }

    /// Returns the page and the layers of a drawing that `part` selects, once they are decoded; the first call
    /// starts the decoding. `key` depends on page and layers; see [`picture_key`].
    pub fn get_part(
        &mut self,
        ctx: &Context,
        key: &str,
        part: impl FnOnce() -> (Source, View),
    ) -> Option<&mut Picture> {
        let frame = self.frame;
        let slot = self.slots.entry(key.to_owned()).or_insert_with(|| {
            let (source, view) = part();
            Slot { state: State::Loading(Here::picture(ctx, source, view, cut_into_tiles)), shown: frame }
        });
        slot.shown = frame;
        match &mut slot.state {
            State::Ready(picture) => Some(picture),
            _ => None,
        }
    }

    /// Returns an image if it is already decoded.
    #[must_use]
    pub fn ready(&self, name: &str) -> Option<&Picture> {
        match &self.slots.get(name)?.state {
            State::Ready(picture) => Some(picture),
            _ => None,
        }
    }

    /// Returns the reason why an image cannot be shown.
    #[must_use]
    pub fn error(&self, name: &str) -> Option<&str> {
        match &self.slots.get(name)?.state {
            State::Failed(error) => Some(error),
            _ => None,
        }
    }

    /// Returns the number of images that are being decoded.
    #[must_use]
    pub fn loading(&self) -> usize {
        self.slots.values().filter(|slot| matches!(slot.state, State::Loading(_))).count()
    }

    /// Cancels the decoding of images; the cancelled images show an error.
    pub fn stop(&mut self) {
        for slot in self.slots.values_mut().filter(|slot| matches!(slot.state, State::Loading(_))) {
            slot.state = State::Failed("Reading was cancelled.".into());
        }
    }

    /// Drops the images that could not be decoded, so that they are read again.
    pub fn retry(&mut self) {
        self.slots.retain(|_, slot| !matches!(slot.state, State::Failed(_)));
    }

    /// Drops all images.
    pub fn clear(&mut self) {
        self.slots.clear();
    }

    /// Drops the image with this name, so that it is read again.
    pub fn forget(&mut self, name: &str) {
        let part = format!("{name}{PART_MARK}");
        self.slots.retain(|key, _| key != name && !key.starts_with(&part));
    }
}

/// Character that separates the name of a drawing from its page and layers in the key of a picture.
const PART_MARK: char = '\n';

/// Returns the cache key of the image of a plan: its file name and, for a drawing, the shown page and
/// layers. `None` if the plan has no image.
#[must_use]
pub fn picture_key(plan: &Plan) -> Option<String> {
    let name = plan.image.as_ref()?;
    if plan.page.is_none() && plan.layers.is_none() {
        return Some(name.clone());
    }
    Some(format!("{name}{PART_MARK}{:?} {:?}", plan.page, plan.layers))
}

/// Returns the texture coordinates (0 to 1) of the largest central part of an image with the aspect ratio of `rect`.
/// `size` is the size of the image.
#[must_use]
pub fn cropped(size: Vec2, rect: Rect) -> Rect {
    let (image, wanted) = (size.x / size.y.max(1.0), rect.width() / rect.height().max(1.0));
    let keep = if image > wanted {
        Vec2::new(wanted / image, 1.0)
    } else {
        Vec2::new(1.0, image / wanted.max(1e-6))
    };
    Rect::from_center_size(Pos2::new(0.5, 0.5), keep)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_an_image_larger_than_one() {
        let decoded = cut_into_tiles(DecodedImage {
            image: RgbImage::new(2 * MAX_TILE_SIDE_PX + 100, 50),
            drawing: None,
            svg: None,
        });
        let widths: Vec<usize> = decoded.tiles.iter().map(|(_, tile)| tile.size[0]).collect();
        assert!(widths.iter().all(|&width| width <= MAX_TILE_SIDE_PX as usize), "{widths:?}");
        let (at, last) = decoded.tiles.last().unwrap();
        assert_eq!(at[0] as usize + last.size[0], 2 * MAX_TILE_SIDE_PX as usize + 100);
    }
}
