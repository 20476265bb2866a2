//! A tree of bounding boxes over the solids: the nearest hit, and whether anything is in the way.

use crate::shape::{Bounds, Line, Shape};

/// A solid that a line meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// In metres along the line.
    pub(crate) distance: f32,
    /// Index of the solid in the list the tree was made of.
    pub(crate) solid: u32,
}

/// An inner node (`count` = 0: children at `first` and `first + 1`) or a leaf of `count` shapes.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    first: u32,
    count: u32,
}

/// Bounding boxes in bounding boxes, divided by the surface-area rule.
#[derive(Debug)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
    shapes: Vec<Shape>,
    /// Index of every shape in the list the tree was made of.
    order: Vec<u32>,
}

/// Shapes in a leaf: a test of a shape costs about as much as one of a node.
const LEAF: usize = 3;
/// Deeper than a tree of a million shapes.
const DEPTH: usize = 64;

impl Tree {
    pub(crate) fn new(shapes: &[Shape]) -> Self {
        let bounds: Vec<Bounds> = shapes.iter().map(Shape::bounds).collect();
        let mut order: Vec<u32> = (0..shapes.len() as u32).collect();
        let mut nodes = vec![Node { bounds: Bounds::EMPTY, first: 0, count: 0 }];
        let mut open = vec![(0, 0, shapes.len())];
        while let Some((node, from, to)) = open.pop() {
            let mine = &mut order[from..to];
            let around = mine.iter().fold(Bounds::EMPTY, |all, &i| all.union(bounds[i as usize]));
            let middle = if mine.len() > LEAF { divide(mine, &bounds) } else { 0 };
            if middle == 0 {
                nodes[node] = Node { bounds: around, first: from as u32, count: mine.len() as u32 };
                continue;
            }
            let first = nodes.len();
            nodes[node] = Node { bounds: around, first: first as u32, count: 0 };
            nodes.extend([nodes[node]; 2]);
            open.extend([(first, from, from + middle), (first + 1, from + middle, to)]);
        }
        let shapes = order.iter().map(|&i| shapes[i as usize]).collect();
        Self { nodes, shapes, order }
    }

    /// The first solid that the line meets nearer than `limit` metres.
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

    /// Whether nothing is on the line nearer than `limit` metres.
    pub(crate) fn is_clear(&self, line: &Line, limit: f32) -> bool {
        let mut clear = true;
        self.walk(line, limit, |first, count| {
            clear = self.shapes[first..first + count].iter().all(|shape| shape.hit(line, limit).is_none());
            clear.then_some(limit)
        });
        clear
    }

    /// Visits the leaves on the line, nearer ones first, until `visit` gives no new limit.
    #[inline]
    fn walk(&self, line: &Line, limit: f32, mut visit: impl FnMut(usize, usize) -> Option<f32>) {
        let mut limit = limit;
        let mut stack = [(0_u32, 0.0_f32); DEPTH];
        let mut depth = 0;
        let mut here = 0;
        loop {
            let node = &self.nodes[here as usize];
            let mut next = None;
            if node.count > 0 {
                match visit(node.first as usize, node.count as usize) {
                    Some(shorter) => limit = shorter,
                    None => return,
                }
            } else {
                let enter = |child: u32| {
                    let (near, far) = self.nodes[child as usize].bounds.span(line);
                    (near <= far && far > 0.0 && near < limit).then_some(near)
                };
                next = match (enter(node.first), enter(node.first + 1)) {
                    (Some(a), Some(b)) => {
                        let swap = b < a;
                        stack[depth] = (node.first + u32::from(!swap), a.max(b));
                        depth += 1;
                        Some(node.first + u32::from(swap))
                    }
                    (Some(_), None) => Some(node.first),
                    (None, Some(_)) => Some(node.first + 1),
                    (None, None) => None,
                };
            }
            here = match next {
                Some(next) => next,
                None => loop {
                    if depth == 0 {
                        return;
                    }
                    depth -= 1;
                    if stack[depth].1 < limit {
                        break stack[depth].0;
                    }
                },
            };
        }
    }
}

/// Sorts the shapes into two parts and gives the size of the first; 0 where a leaf is as good.
fn divide(order: &mut [u32], bounds: &[Bounds]) -> usize {
    let sorted = |order: &mut [u32], axis: usize| {
        order.sort_by(|&a, &b| {
            let at = |i: u32| bounds[i as usize].middle().axis(axis);
            at(a).total_cmp(&at(b)).then(a.cmp(&b))
        });
    };
    let mut best = (f32::INFINITY, 0, 0);
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
    fn the_tree_says_what_a_search_through_all_says() {
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
