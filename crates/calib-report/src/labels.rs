//! Placement of labels without overlaps.

use crate::style;
use crate::svg::{Anchor, Svg};

/// Position of a label relative to its point: offset of the baseline to the right and down, in screen pixels,
/// and the anchor of the text.
pub(crate) type LabelOffset = (f64, f64, Anchor);

/// Placed labels of a drawing.
#[derive(Debug, Default)]
pub(crate) struct Labels {
    /// Rectangles of the labels (left, top, right and bottom, in pixels), with their texts.
    occupied: Vec<([f64; 4], String)>,
}

impl Labels {
    /// Places a label at the first offset without overlap and reserves its rectangle. Returns the start of
    /// the baseline and the anchor, or `None` if all offsets overlap.
    pub(crate) fn place(
        &mut self,
        svg: &Svg,
        about: [f64; 2],
        text: &str,
        places: &[LabelOffset],
    ) -> Option<([f64; 2], Anchor)> {
        places.iter().map(|place| label_position(svg, about, place)).find(|&(at, anchor)| {
            let own = label_rectangle(svg, at, text, anchor);
            let is_free = !self.occupied.iter().any(|(other, _)| is_overlapping(&own, other));
            if is_free {
                self.occupied.push((own, text.to_owned()));
            }
            is_free
        })
    }

    /// Whether a label with the same text already overlaps this position. A point and its reprojection need
    /// only one label.
    pub(crate) fn has_duplicate(&self, svg: &Svg, about: [f64; 2], text: &str, place: &LabelOffset) -> bool {
        let (at, anchor) = label_position(svg, about, place);
        let own = label_rectangle(svg, at, text, anchor);
        self.occupied.iter().any(|(other, said)| said == text && is_overlapping(&own, other))
    }

    /// Reserves the rectangle of a tag; the point is its upper left corner.
    pub(crate) fn reserve_tag(&mut self, svg: &Svg, [x, y]: [f64; 2], text: &str) {
        let [width, height] = svg.tag_size(text);
        self.occupied.push(([x, y, x + width, y + height], text.to_owned()));
    }
}

/// Returns the baseline position and the anchor of a label at an offset from a point.
pub(crate) fn label_position(
    svg: &Svg,
    [x, y]: [f64; 2],
    &(right, down, anchor): &LabelOffset,
) -> ([f64; 2], Anchor) {
    ([x + right * svg.scale, y + down * svg.scale], anchor)
}

/// Returns the rectangle of a label: left, top, right and bottom in pixels. Its height is slightly below the
/// letter height, because descenders may touch another label.
fn label_rectangle(svg: &Svg, [x, y]: [f64; 2], text: &str, anchor: Anchor) -> [f64; 4] {
    /// Height of the rectangle above the baseline, relative to the letter height.
    const ASCENT_REL: f64 = 0.75;
    /// Height of the rectangle below the baseline, relative to the letter height.
    const DESCENT_REL: f64 = 0.2;
    let (size, width) = (style::TEXT * svg.scale, svg.text_width(text));
    let left = match anchor {
        Anchor::Start => x,
        Anchor::Middle => x - 0.5 * width,
        Anchor::End => x - width,
    };
    [left, y - ASCENT_REL * size, left + width, y + DESCENT_REL * size]
}

/// Whether two rectangles overlap.
fn is_overlapping(a: &[f64; 4], b: &[f64; 4]) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_at_one_point_do_not_overlap_and_the_last_is_dropped() {
        let (svg, mut labels) = (Svg::new([400.0, 300.0], 1.0), Labels::default());
        let places = [(7.0, -5.0, Anchor::Start), (-7.0, -5.0, Anchor::End)];
        let mut place = |at: [f64; 2]| labels.place(&svg, at, "word", &places);
        assert_eq!(place([100.0, 100.0]), Some(([107.0, 95.0], Anchor::Start)));
        assert_eq!(place([100.0, 100.0]), Some(([93.0, 95.0], Anchor::End)));
        assert_eq!(place([101.0, 101.0]), None);
        assert!(place([100.0, 130.0]).is_some());
        assert!(labels.has_duplicate(&svg, [101.0, 101.0], "word", &places[0]));
        assert!(!labels.has_duplicate(&svg, [101.0, 101.0], "other", &places[0]));
        assert!(!labels.has_duplicate(&svg, [101.0, 200.0], "word", &places[0]));
    }
}
