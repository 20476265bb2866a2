//! Tree of bounding boxes over the solids, for the nearest intersection and for occlusion.

use std::ops::Range;

use crate::shape::{Bounds, Line, Shape};
use crate::vector::{greater, lesser};

/// Intersection of a ray and a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// Distance along the ray, in metres.
    pub(crate) distance: f32,
    /// Index of the solid in the list from which the tree was made.
    pub(crate) solid: u32,
}

/// Four boxes, stored coordinate by coordinate so that one instruction tests all of them.
#[derive(Clone, Copy, Debug)]
struct Node {
    min: [[f32; 4]; 3],
    max: [[f32; 4]; 3],
    /// Index of the child node of each box, or of the first shape of a leaf.
    first: [u32; 4],
    /// Number of shapes of each box if it is a leaf; 0 for a child node.
    count: [u32; 4],
}

/// Hierarchy of bounding boxes, divided by the surface-area heuristic.
#[derive(Debug)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
    shapes: Vec<Shape>,
    /// Indices of the shapes in the list from which the tree was made; the shapes of a leaf are consecutive.
    order: Vec<u32>,
}

/// Maximum number of shapes in a leaf. Intersecting a shape takes about as long as intersecting a node.
const MAX_LEAF_SHAPES: usize = 3;
/// Size of the traversal stack, in entries; sufficient for a million shapes.
const STACK_SIZE: usize = 64;

impl Tree {
    pub(crate) fn new(shapes: &[Shape]) -> Self {
        let bounds: Vec<Bounds> = shapes.iter().map(Shape::bounds).collect();
        let mut order: Vec<u32> = (0..shapes.len() as u32).collect();
        let mut nodes = vec![Node::EMPTY];
        let mut open = vec![(0, 0..shapes.len())];
        while let Some((node, range)) = open.pop() {
            for (slot, part) in quarters(&mut order, range, &bounds).into_iter().enumerate() {
                let around =
                    order[part.clone()].iter().fold(Bounds::EMPTY, |all, &i| all.union(bounds[i as usize]));
                for axis in 0..3 {
                    nodes[node].min[axis][slot] = around.min.axis(axis);
                    nodes[node].max[axis][slot] = around.max.axis(axis);
                }
                if part.len() <= MAX_LEAF_SHAPES {
                    nodes[node].first[slot] = part.start as u32;
                    nodes[node].count[slot] = part.len() as u32;
                } else {
                    nodes[node].first[slot] = nodes.len() as u32;
                    open.push((nodes.len(), part));
                    nodes.push(Node::EMPTY);
                }
            }
        }
        let shapes = order.iter().map(|&i| shapes[i as usize]).collect();
        Self { nodes, shapes, order }
    }

    /// Returns the first solid along the ray within `limit` metres.
    pub(crate) fn nearest(&self, line: &Line, limit: f32) -> Option<Hit> {
        let mut best = None;
        let mut reach = limit;
        self.walk(line, limit, |first, count| {
            for i in first..first + count {
                if let Some(distance) = self.shapes[i].hit(line, reach) {
                    reach = distance;
                    best = Some(Hit { distance, solid: self.order[i] });
                }
            }
            Some(reach)
        });
        best
    }

    /// Whether the ray meets no solid within `limit` metres.
    pub(crate) fn is_clear(&self, line: &Line, limit: f32) -> bool {
        let mut clear = true;
        self.walk(line, limit, |first, count| {
            clear = self.shapes[first..first + count].iter().all(|shape| shape.hit(line, limit).is_none());
            clear.then_some(limit)
        });
        clear
    }

    /// Visits the leaves along the ray up to `limit` metres, nearer leaves first. `visit` receives the index
    /// of the first shape and the number of shapes. It returns the new limit, or `None` to stop.
    #[inline]
    fn walk(&self, line: &Line, limit: f32, mut visit: impl FnMut(usize, usize) -> Option<f32>) {
        let mut limit = limit;
        // Entries: first index, count, distance.
        let mut open = [(0_u32, 0_u32, 0.0_f32); STACK_SIZE];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (first, count, distance) = open[depth];
            if distance >= limit {
                continue;
            }
            if count > 0 {
                match visit(first as usize, count as usize) {
                    Some(shorter) => limit = shorter,
                    None => return,
                }
                continue;
            }
            let node = &self.nodes[first as usize];
            let (near, far) = node.spans(line, limit);
            let bottom = depth;
            for slot in 0..4 {
                if near[slot] > far[slot] {
                    continue;
                }
                // The nearest box goes to the top of the stack.
                let mut at = depth;
                while at > bottom && open[at - 1].2 < near[slot] {
                    open[at] = open[at - 1];
                    at -= 1;
                }
                open[at] = (node.first[slot], node.count[slot], near[slot]);
                depth += 1;
            }
        }
    }
}

impl Node {
    const EMPTY: Self =
        Self { min: [[f32::INFINITY; 4]; 3], max: [[f32::NEG_INFINITY; 4]; 3], first: [0; 4], count: [0; 4] };

    /// Returns the distances along the ray, in metres, where it enters and leaves each of the four boxes. An entry
    /// is at least 0, an exit at most `limit`. The ray misses a box if the entry is greater than the exit.
    #[inline(always)]
    fn spans(&self, line: &Line, limit: f32) -> ([f32; 4], [f32; 4]) {
        let (mut near, mut far) = ([0.0; 4], [limit; 4]);
        for axis in 0..3 {
            let (origin, inverse) = (line.origin.axis(axis), line.inverse.axis(axis));
            let (front, back) = if inverse < 0.0 {
                (&self.max[axis], &self.min[axis])
            } else {
                (&self.min[axis], &self.max[axis])
            };
            for slot in 0..4 {
                near[slot] = greater((front[slot] - origin) * inverse, near[slot]);
                far[slot] = lesser((back[slot] - origin) * inverse, far[slot]);
            }
        }
        (near, far)
    }
}

/// Divides a range of shapes into up to four ranges by dividing the largest range repeatedly.
fn quarters(order: &mut [u32], range: Range<usize>, bounds: &[Bounds]) -> Vec<Range<usize>> {
    let mut parts = vec![range];
    while parts.len() < 4 {
        let Some(largest) = (0..parts.len()).max_by_key(|&i| parts[i].len()) else { break };
        let part = parts[largest].clone();
        if part.len() <= MAX_LEAF_SHAPES {
            break;
        }
        let middle = part.start + divide(&mut order[part.clone()], bounds);
        parts[largest] = part.start..middle;
        parts.push(middle..part.end);
    }
    parts
}

/// Reorders two or more shapes into two parts by the surface-area heuristic. Returns the size of the first
/// part.
fn divide(order: &mut [u32], bounds: &[Bounds]) -> usize {
    let sorted = |order: &mut [u32], axis: usize| {
        order.sort_by(|&a, &b| {
            let at = |i: u32| bounds[i as usize].middle().axis(axis);
            at(a).total_cmp(&at(b)).then(a.cmp(&b))
        });
    };
    let mut best = (f32::INFINITY, 0, 1);
    let mut right = vec![0.0; order.len()];
    for axis in 0..3 {
        sorted(order, axis);
        let mut around = Bounds::EMPTY;
        for i in (1..order.len()).rev() {
            around = around.union(bounds[order[i] as usize]);
            right[i] = around.half_area() * (order.len() - i) as f32;
        }
        around = Bounds::EMPTY;
        for i in 1..order.len() {
            around = around.union(bounds[order[i - 1] as usize]);
            let cost = around.half_area() * i as f32 + right[i];
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    sorted(order, best.1);
    best.2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::vec3;
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_tree_equals_an_exhaustive_search() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut point = |scale: f32| {
            let mut one = || random.random_range(-scale..scale);
            vec3(one(), one(), one())
        };
        let shapes: Vec<Shape> = (0..200).map(|_| Shape::ball(point(5.0), 0.3)).collect();
        let tree = Tree::new(&shapes);
        for _ in 0..500 {
            let line = Line::new(point(8.0), point(1.0).unit());
            let all = shapes.iter().filter_map(|shape| shape.hit(&line, 20.0)).fold(20.0, f32::min);
            let found = tree.nearest(&line, 20.0);
            assert_eq!(found.map_or(20.0, |hit| hit.distance), all);
            assert_eq!(tree.is_clear(&line, 20.0), found.is_none());
        }
    }
}
