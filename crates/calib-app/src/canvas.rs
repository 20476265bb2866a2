//! Where on the screen a canvas shows its document: pan, zoom, screen from document and back.

use calib_core::{Lens, UndistortedPixel};
use egui::{Pos2, Rect, Vec2};

/// What a canvas looks at. Document units are pixels of an image, or metres of the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The document point in the middle of the canvas.
    pub centre: [f64; 2],
    /// Screen points per document unit.
    pub zoom: f64,
    /// Whether the document's second axis points up, as the floor's does.
    pub y_up: bool,
}

/// A view with the rectangle it fills: maps both ways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mapping {
    /// What is looked at.
    pub view: View,
    /// Where on the screen.
    pub rect: Rect,
    /// The lens whose bend is taken out of what is shown: what is straight in space is straight here.
    pub lens: Option<Lens>,
}

/// How much of the canvas a document fills that is shown whole.
const ROOM: f64 = 0.94;

/// Beyond these the numbers of a point no longer fit in a coordinate of the screen.
const ZOOMS: std::ops::RangeInclusive<f64> = 1e-4..=1e5;

impl View {
    /// The view that shows `[low, high]` whole, or (`fill`) fills the rectangle with its middle.
    #[must_use]
    pub fn of(low: [f64; 2], high: [f64; 2], rect: Rect, y_up: bool, fill: bool) -> Self {
        let size = [(high[0] - low[0]).abs().max(1e-6), (high[1] - low[1]).abs().max(1e-6)];
        let fits = [f64::from(rect.width()) / size[0], f64::from(rect.height()) / size[1]];
        let zoom = if fill { fits[0].max(fits[1]) } else { ROOM * fits[0].min(fits[1]) };
        let centre = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        Self { centre, zoom: zoom.clamp(*ZOOMS.start(), *ZOOMS.end()), y_up }
    }

    /// Pans by screen points.
    pub fn pan(&mut self, by: Vec2) {
        self.centre[0] -= f64::from(by.x) / self.zoom;
        self.centre[1] -= self.sign() * f64::from(by.y) / self.zoom;
    }

    const fn sign(&self) -> f64 {
        if self.y_up { -1.0 } else { 1.0 }
    }
}

impl Mapping {
    /// A view in its rectangle, bent as the lens bends it.
    #[must_use]
    pub const fn new(view: View, rect: Rect) -> Self {
        Self { view, rect, lens: None }
    }

    /// Where a document point lies once the lens's bend is taken out.
    #[must_use]
    pub fn flat(&self, at: [f64; 2]) -> [f64; 2] {
        let straight = self.lens.and_then(|lens| lens.undistort(at.into()));
        straight.map_or(at, |pixel| [pixel.u, pixel.v])
    }

    /// Where the screen shows a document point.
    #[must_use]
    pub fn screen(&self, at: [f64; 2]) -> Pos2 {
        let View { centre, zoom, .. } = self.view;
        let [x, y] = self.flat(at);
        let (dx, dy) = ((x - centre[0]) * zoom, self.view.sign() * (y - centre[1]) * zoom);
        // Far off the screen the painter needs no more than the direction.
        let clamp = |value: f64| value.clamp(-1e7, 1e7) as f32;
        self.rect.center() + Vec2::new(clamp(dx), clamp(dy))
    }

    /// The document point at a point of the screen.
    #[must_use]
    pub fn document(&self, at: Pos2) -> [f64; 2] {
        let flat = self.flat_at(at);
        let bent = self.lens.and_then(|lens| lens.distort(UndistortedPixel::new(flat[0], flat[1])));
        bent.map_or(flat, Into::into)
    }

    /// What is at a point of the screen once the lens's bend is taken out.
    fn flat_at(&self, at: Pos2) -> [f64; 2] {
        let View { centre, zoom, .. } = self.view;
        let by = at - self.rect.center();
        [centre[0] + f64::from(by.x) / zoom, centre[1] + self.view.sign() * f64::from(by.y) / zoom]
    }

    /// Screen points as document units.
    #[must_use]
    pub fn units(&self, points: f32) -> f64 {
        f64::from(points) / self.view.zoom
    }

    /// The view after zooming by `factor` with what is under `at` staying there.
    #[must_use]
    pub fn zoomed(&self, at: Pos2, factor: f64) -> View {
        let fixed = self.flat_at(at);
        let mut view = self.view;
        view.zoom = (view.zoom * factor).clamp(*ZOOMS.start(), *ZOOMS.end());
        let now = Self { view, ..*self }.flat_at(at);
        view.centre = [view.centre[0] + fixed[0] - now[0], view.centre[1] + fixed[1] - now[1]];
        view
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mapping(y_up: bool) -> Mapping {
        let rect = Rect::from_min_size(Pos2::new(100.0, 50.0), Vec2::new(800.0, 600.0));
        Mapping::new(View { centre: [960.0, 540.0], zoom: 0.37, y_up }, rect)
    }

    #[test]
    fn screen_and_document_are_inverse_to_each_other() {
        for y_up in [false, true] {
            let mapping = mapping(y_up);
            let there = mapping.document(mapping.screen([123.4, 777.7]));
            assert!((there[0] - 123.4).abs() < 1e-3 && (there[1] - 777.7).abs() < 1e-3, "{there:?}");
        }
    }

    #[test]
    fn a_straightened_canvas_maps_both_ways_and_shows_straight_what_the_lens_bends() {
        let brown = calib_core::BrownConrady { k1: -0.3, k2: 0.08, p1: 0.0, p2: 0.0, k3: 0.0 };
        let distortion = calib_core::Distortion::BrownConrady(brown);
        let lens = Lens {
            principal_point: calib_core::Pixel::new(960.0, 540.0),
            focal: 1400.0,
            distortion,
            image_circle: None,
        };
        let mapping = Mapping { lens: Some(lens), ..mapping(false) };
        let there = mapping.document(mapping.screen([123.4, 777.7]));
        assert!((there[0] - 123.4).abs() < 1e-3 && (there[1] - 777.7).abs() < 1e-3, "{there:?}");
        let edge = [300.0, 900.0, 1500.0].map(|u| lens.distort(UndistortedPixel::new(u, 200.0)).unwrap());
        assert!(edge[0].v - edge[1].v > 5.0, "the lens bends it");
        let shown = edge.map(|pixel| mapping.screen(pixel.into()).y);
        assert!((shown[0] - shown[1]).abs() < 1e-2 && (shown[0] - shown[2]).abs() < 1e-2, "{shown:?}");
    }

    #[test]
    fn zooming_keeps_what_is_under_the_cursor() {
        for y_up in [false, true] {
            let mut mapping = mapping(y_up);
            let at = Pos2::new(222.0, 333.0);
            let before = mapping.document(at);
            for _ in 0..40 {
                mapping.view = mapping.zoomed(at, 1.2);
            }
            let after = mapping.document(at);
            assert!((before[0] - after[0]).abs() < 1e-6 && (before[1] - after[1]).abs() < 1e-6);
        }
    }
}
