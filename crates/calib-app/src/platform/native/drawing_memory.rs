//! How much memory drawing an SVG takes, before it is drawn.
//!
//! A group with opacity, a blend mode, a clip, a mask or a filter is drawn on a layer of its own, as large as what it
//! holds, up to five times the picture either way; its clip and its mask on more of that size, and every step of a
//! filter keeps its result. A pattern is drawn as a tile of any size, and a drawing within the drawing on a layer as
//! large as what it is drawn on. What exists at once is summed along each branch; of branches the largest counts.

use resvg::usvg::filter::{Filter, Kind};
use resvg::usvg::{ClipPath, Group, ImageKind, Mask, Node, Paint, Path, Pattern, Transform, Tree};

/// Nodes that are walked at most: patterns that hold each other several times would be drawn without end.
const MOST_NODES: usize = 200_000;
/// Sides of the largest layer, in sides of the picture.
const LARGEST: f64 = 5.0;
/// Layers that a step of a filter takes beside its result.
const WORKING: usize = 6;
/// Of a clip or mask, in layers, with its transparency as bytes of their own.
const STENCIL: f64 = 1.5;
/// Bytes of a pixel.
const RGBA: f64 = 4.0;

/// What a drawing takes while it is drawn on so many pixels, in bytes; `None` where it has no end.
pub(super) fn bytes_to_draw(tree: &Tree, zoom: Transform, size: [u32; 2]) -> Option<f64> {
    let size = size.map(f64::from);
    let mut walk = Walk { nodes: 0 };
    Some(RGBA * (area(size) + walk.children(tree.root(), Place::picture(zoom, size))?))
}

fn area([width, height]: [f64; 2]) -> f64 {
    width * height
}

/// Where something is drawn.
#[derive(Clone, Copy)]
struct Place {
    /// From its coordinates to pixels.
    to_pixels: Transform,
    /// What it is drawn on, in pixels.
    canvas: [f64; 2],
    /// The largest layer there is, in pixels.
    largest: [f64; 2],
}

impl Place {
    fn picture(to_pixels: Transform, size: [f64; 2]) -> Self {
        Self { to_pixels, canvas: size, largest: size.map(|side| LARGEST * side) }
    }

    fn within(self, transform: Transform) -> Self {
        Self { to_pixels: self.to_pixels.pre_concat(transform), ..self }
    }

    /// Width and height of the layer of a group.
    fn layer(self, group: &Group) -> [f64; 2] {
        /// For edges between pixels, on both sides together.
        const EDGE: f64 = 4.0;
        let bounds = group.layer_bounding_box();
        let (x, y) = self.to_pixels.get_scale();
        // Layers with filters are turned with the group, the others are upright.
        let upright = bounds.transform(self.to_pixels).map_or([f32::MAX; 2], |at| [at.width(), at.height()]);
        let turned = [bounds.width() * x, bounds.height() * y];
        let sides = if group.filters().is_empty() { upright } else { turned };
        [0, 1].map(|axis| (f64::from(sides[axis]) + EDGE).min(self.largest[axis]))
    }
}

/// Pixels that exist at once beside what is drawn on, and how many nodes were met.
struct Walk {
    nodes: usize,
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
        self.nodes += 1;
        if self.nodes > MOST_NODES {
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
        let place = place.within(group.transform());
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
        Some(area(place.canvas) * (filter.primitives().len() + WORKING) as f64 + most)
    }

    fn mask(&mut self, mask: &Mask, place: Place) -> Option<f64> {
        let inner = self.children(mask.root(), place)?;
        let next = mask.mask().map_or(Some(0.0), |mask| self.mask(mask, place))?;
        Some(STENCIL * area(place.canvas) + inner.max(next))
    }

    fn clip(&mut self, clip: &ClipPath, place: Place) -> Option<f64> {
        let inner = self.clipping(clip.root(), place.within(clip.transform()))?;
        let next = clip.clip_path().map_or(Some(0.0), |clip| self.clip(clip, place))?;
        Some(STENCIL * area(place.canvas) + inner.max(next))
    }

    /// What a clip is made of: groups with a clip of their own are drawn on layers as large as that.
    fn clipping(&mut self, group: &Group, place: Place) -> Option<f64> {
        let mut most = 0.0_f64;
        for node in group.children() {
            let inner = match node {
                Node::Group(group) => {
                    let place = place.within(group.transform());
                    let inner = self.clipping(group, place)?;
                    match group.clip_path() {
                        Some(clip) => area(place.canvas) + inner.max(self.clip(clip, place)?),
                        None => inner,
                    }
                }
                Node::Text(text) => self.clipping(text.flattened(), place)?,
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

    /// The tile of a pattern.
    fn pattern(&mut self, pattern: &Pattern, place: Place) -> Option<f64> {
        let (x, y) = place.within(pattern.transform()).to_pixels.get_scale();
        let rect = pattern.rect();
        let canvas = [rect.width() * x, rect.height() * y].map(f64::from);
        let tile = Place { to_pixels: Transform::from_scale(x, y), canvas, ..place };
        Some(area(canvas) + self.children(pattern.root(), tile)?)
    }
}
