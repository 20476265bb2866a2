//! Memory that rasterising an SVG needs, computed before it is rasterised.
//!
//! A group with opacity, blend mode, clip, mask or filter is painted on its own layer. The layer is as large as the
//! group, up to five times the image in each direction. Its clip and its mask need more layers of that size, and
//! every filter step keeps its result. A pattern needs a tile, whose size has no limit. A nested drawing needs a
//! layer as large as the canvas. Memory that exists at the same time is summed along each branch; the largest
//! branch counts.

use resvg::usvg::filter::{Filter, Kind};
use resvg::usvg::{ClipPath, Group, ImageKind, Mask, Node, Paint, Path, Pattern, Transform, Tree};

/// Largest number of visited nodes; patterns that contain each other would otherwise never end.
const MAX_NODES: usize = 2_000_000;
/// Weight of a node inside a pattern in the count of visited nodes. Such nodes are painted again for every use of
/// the pattern.
const PATTERN_NODE_COST: usize = 10;
/// Largest width of a layer divided by the width of the image, and the same for the height. Larger layers are
/// clipped by resvg.
const MAX_LAYER_RATIO: f64 = 5.0;
/// Number of working layers of a filter, in addition to the result of each filter step.
const WORKING_LAYERS: usize = 6;
/// Memory of a clip or a mask with its alpha bytes, in layers of the same size.
const STENCIL_LAYERS: f64 = 1.5;
/// Bytes of an RGBA pixel.
const BYTES_PER_PIXEL: f64 = 4.0;

/// Returns the memory needed to rasterise an SVG at this size, in bytes; `None` if it has more nodes than
/// [`MAX_NODES`].
pub(super) fn bytes_to_draw(tree: &Tree, zoom: Transform, size: [u32; 2]) -> Option<f64> {
    let size = size.map(f64::from);
    let mut walk = Walk { nodes: 0, cost: 1 };
    Some(BYTES_PER_PIXEL * (area(size) + walk.children(tree.root(), Place::picture(zoom, size))?))
}

fn area([width, height]: [f64; 2]) -> f64 {
    width * height
}

/// Coordinate system and canvas of a node.
#[derive(Clone, Copy)]
struct Place {
    /// Transform from the coordinates of the node to image pixels.
    to_pixels: Transform,
    /// Size of the current canvas, in pixels.
    canvas: [f64; 2],
    /// Size of the largest layer, in pixels.
    largest: [f64; 2],
}

impl Place {
    fn picture(to_pixels: Transform, size: [f64; 2]) -> Self {
        Self { to_pixels, canvas: size, largest: size.map(|side| MAX_LAYER_RATIO * side) }
    }

    fn transformed(self, transform: Transform) -> Self {
        Self { to_pixels: self.to_pixels.pre_concat(transform), ..self }
    }

    /// Returns width and height of the layer of a group, in pixels.
    fn layer(self, group: &Group) -> [f64; 2] {
        /// Margin for antialiasing, both sides together, in pixels.
        const ANTIALIASING_MARGIN: f64 = 4.0;
        let bounds = group.layer_bounding_box();
        let (x, y) = self.to_pixels.get_scale();
        // Layers with filters rotate with the group; others are axis-aligned.
        let upright = bounds.transform(self.to_pixels).map_or([f32::MAX; 2], |at| [at.width(), at.height()]);
        let turned = [bounds.width() * x, bounds.height() * y];
        let sides = if group.filters().is_empty() { upright } else { turned };
        [0, 1].map(|axis| (f64::from(sides[axis]) + ANTIALIASING_MARGIN).min(self.largest[axis]))
    }
}

/// Traversal of an SVG tree. Each method returns the largest number of layer pixels that exist at the same time, or
/// `None` beyond [`MAX_NODES`].
struct Walk {
    /// Number of visited nodes.
    nodes: usize,
    /// Weight of the current nodes in `nodes`: 1, or [`PATTERN_NODE_COST`] inside a pattern.
    cost: usize,
}

impl Walk {
    fn children(&mut self, group: &Group, place: Place) -> Option<f64> {
        let mut most = 0.0_f64;
        for node in group.children() {
            most = most.max(self.node(node, place)?);
        }
        Some(most)
    }

    fn node(&mut self, node: &Node, place: Place) -> Option<f64> {
        self.nodes += self.cost;
        if self.nodes > MAX_NODES {
            return None;
        }
        match node {
            Node::Group(group) => self.group(group, place),
            Node::Text(text) => self.group(text.flattened(), place),
            Node::Path(path) => self.path(path, place),
            Node::Image(image) => match image.kind() {
                ImageKind::SVG(tree) => {
                    let inner = Place::picture(place.to_pixels, place.canvas);
                    Some(area(place.canvas) + self.children(tree.root(), inner)?)
                }
                _ => Some(0.0),
            },
        }
    }

    fn group(&mut self, group: &Group, place: Place) -> Option<f64> {
        let place = place.transformed(group.transform());
        if !group.should_isolate() {
            return self.children(group, place);
        }
        let place = Place { canvas: place.layer(group), ..place };
        let mut most = self.children(group, place)?;
        for filter in group.filters() {
            most = most.max(self.filter(filter, place)?);
        }
        if let Some(clip) = group.clip_path() {
            most = most.max(self.clip(clip, place)?);
        }
        if let Some(mask) = group.mask() {
            most = most.max(self.mask(mask, place)?);
        }
        Some(area(place.canvas) + most)
    }

    fn filter(&mut self, filter: &Filter, place: Place) -> Option<f64> {
        let mut most = 0.0_f64;
        for primitive in filter.primitives() {
            if let Kind::Image(image) = primitive.kind() {
                most = most.max(self.group(image.root(), place)?);
            }
        }
        Some(area(place.canvas) * (filter.primitives().len() + WORKING_LAYERS) as f64 + most)
    }

    fn mask(&mut self, mask: &Mask, place: Place) -> Option<f64> {
        let inner = self.children(mask.root(), place)?;
        let next = mask.mask().map_or(Some(0.0), |mask| self.mask(mask, place))?;
        Some(STENCIL_LAYERS * area(place.canvas) + inner.max(next))
    }

    fn clip(&mut self, clip: &ClipPath, place: Place) -> Option<f64> {
        let inner = self.clip_contents(clip.root(), place.transformed(clip.transform()))?;
        let next = clip.clip_path().map_or(Some(0.0), |clip| self.clip(clip, place))?;
        Some(STENCIL_LAYERS * area(place.canvas) + inner.max(next))
    }

    /// Returns the largest number of layer pixels that exist at the same time while the contents of a clip path are
    /// painted; `None` beyond the node limit. A group with its own clip path needs another layer of the canvas
    /// size.
    fn clip_contents(&mut self, group: &Group, place: Place) -> Option<f64> {
        let mut most = 0.0_f64;
        for node in group.children() {
            let inner = match node {
                Node::Group(group) => {
                    let place = place.transformed(group.transform());
                    let inner = self.clip_contents(group, place)?;
                    match group.clip_path() {
                        Some(clip) => area(place.canvas) + inner.max(self.clip(clip, place)?),
                        None => inner,
                    }
                }
                Node::Text(text) => self.clip_contents(text.flattened(), place)?,
                other => self.node(other, place)?,
            };
            most = most.max(inner);
        }
        Some(most)
    }

    fn path(&mut self, path: &Path, place: Place) -> Option<f64> {
        let paints = [path.fill().map(|fill| fill.paint()), path.stroke().map(|stroke| stroke.paint())];
        let mut most = 0.0_f64;
        for paint in paints.into_iter().flatten() {
            if let Paint::Pattern(pattern) = paint {
                most = most.max(self.pattern(pattern, place)?);
            }
        }
        Some(most)
    }

    /// Returns the number of pixels for the tile of a pattern and the layers of its contents; `None` beyond the
    /// node limit.
    fn pattern(&mut self, pattern: &Pattern, place: Place) -> Option<f64> {
        let (x, y) = place.transformed(pattern.transform()).to_pixels.get_scale();
        let rect = pattern.rect();
        let canvas = [rect.width() * x, rect.height() * y].map(f64::from);
        let tile = Place { to_pixels: Transform::from_scale(x, y), canvas, ..place };
        let outer = std::mem::replace(&mut self.cost, PATTERN_NODE_COST);
        let inner = self.children(pattern.root(), tile);
        self.cost = outer;
        Some(area(canvas) + inner?)
    }
}
