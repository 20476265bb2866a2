//! Mapping between an image or the plan and its canvas on the screen: pan, zoom, undistortion and fisheye windows.
//!
//! Document points are raw pixels of an image, or floor metres on the plan. Canvas points are document points after
//! undistortion or after projection into a fisheye window. Screen points are points of the user interface.

use calib_core::{Lens, Pixel, UndistortedPixel, Window};
use egui::{Pos2, Rect, Vec2};

/// Pan and zoom of a canvas, in canvas units. These are metres of the floor, or pixels of the raw image, the
/// undistorted image or a fisheye window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Point in the middle of the canvas, in canvas units.
    pub centre: [f64; 2],
    /// Screen points per canvas unit.
    pub zoom: f64,
    /// Whether the second axis points up, as on the floor.
    pub y_up: bool,
}

/// Pan and zoom of a canvas with its rectangle on the screen. Maps document points (raw pixels of an image, or floor
/// metres on the plan) to the screen and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mapping {
    /// Pan and zoom of the canvas.
    pub view: View,
    /// Rectangle of the canvas on the screen, in points.
    pub rect: Rect,
    /// Undistortion or fisheye window that is applied to the image; `None` for raw images and the plan.
    pub bend: Option<Bend>,
}

/// Map from raw pixels to canvas points: undistortion, or projection into a fisheye window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bend {
    /// Undistortion of the image of this lens; document points are raw pixels.
    Lens(Lens),
    /// Virtual view of a fisheye image; document points are raw pixels, canvas points are pixels of the
    /// window.
    Window {
        /// Lens of the camera.
        lens: Lens,
        /// Focal length of the camera, in pixels.
        focal: f64,
        /// Flat or cylindrical window.
        window: Window,
    },
}

impl Bend {
    /// Maps a raw pixel to the canvas; `None` if the lens or the window does not map it.
    fn canvas_from_raw(&self, at: Pixel) -> Option<[f64; 2]> {
        match self {
            Self::Lens(lens) => lens.undistort(at).map(|pixel| [pixel.u, pixel.v]),
            Self::Window { lens, focal, window } if window.is_round => {
                window.raw_to_window(lens, *focal, at).map(Into::into)
            }
            Self::Window { lens, focal, window } => {
                // Smallest ratio of depth to distance from the axis. It keeps points finite in directions of
                // 90° and more.
                const MIN_DEPTH_RATIO: f64 = 0.02;
                let [x, y, z] = lens.bearing(at)?;
                let direction = [x / focal, y / focal, z];
                let [x, y, z] = window
                    .window_from_camera()
                    .map(|row| row[0] * direction[0] + row[1] * direction[1] + row[2] * direction[2]);
                let Pixel { u, v } = window.principal_point;
                let beside = x.hypot(y);
                if z <= 0.0 && beside < 1e-9 {
                    return Some([u + window.focal / MIN_DEPTH_RATIO, v]);
                }
                let depth = z.max(MIN_DEPTH_RATIO * beside);
                Some([u + window.focal * x / depth, v + window.focal * y / depth])
            }
        }
    }

    /// Maps a canvas point to the raw pixel that the canvas shows there; `None` if the canvas shows no pixel
    /// there.
    fn raw_from_canvas(&self, [x, y]: [f64; 2]) -> Option<Pixel> {
        match self {
            Self::Lens(lens) => lens.distort(UndistortedPixel::new(x, y)),
            Self::Window { lens, focal, window } => window.raw(lens, *focal, Pixel::new(x, y)),
        }
    }

    /// Returns the size of the window, in pixels; `None` for an undistorted image.
    #[must_use]
    pub fn size(&self) -> Option<[f64; 2]> {
        match self {
            Self::Lens(_) => None,
            Self::Window { window, .. } => Some(window.size.map(|side| side as f64)),
        }
    }

    /// Returns the width of a full circle in a panorama, in canvas pixels; `None` for other views.
    fn period_px(&self) -> Option<f64> {
        match self {
            Self::Window { window, .. } if window.is_round => Some(std::f64::consts::TAU * window.focal),
            _ => None,
        }
    }
}

/// Fraction of the canvas that a fitted document fills.
const FITTED_FRACTION: f64 = 0.94;

/// Least and greatest zoom of an image, in screen points per pixel: 5 % to 6,400 %.
const IMAGE_ZOOM: (f64, f64) = (0.05, 64.0);
/// Least and greatest zoom of the floor, in screen points per metre: 100 km to 10 cm fill a window.
const FLOOR_ZOOM: (f64, f64) = (0.01, 1e4);
/// Zoom range, in screen points per canvas unit; screen coordinates lose precision outside it.
const ZOOM_RANGE: std::ops::RangeInclusive<f64> = 1e-4..=1e5;

impl View {
    /// Returns the view that shows the whole area from `low` to `high`, in canvas units. With `fill`, the area covers
    /// the whole rectangle instead, and parts of it may be cut off.
    #[must_use]
    pub fn of(low: [f64; 2], high: [f64; 2], rect: Rect, y_up: bool, fill: bool) -> Self {
        let size = [(high[0] - low[0]).abs().max(1e-6), (high[1] - low[1]).abs().max(1e-6)];
        let fits = [f64::from(rect.width()) / size[0], f64::from(rect.height()) / size[1]];
        let zoom = if fill { fits[0].max(fits[1]) } else { FITTED_FRACTION * fits[0].min(fits[1]) };
        let centre = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        Self { centre, zoom: zoom.clamp(*ZOOM_RANGE.start(), *ZOOM_RANGE.end()), y_up }
    }

    /// Pans the view by a distance on the screen, in points.
    pub fn pan(&mut self, by: Vec2) {
        self.centre[0] -= f64::from(by.x) / self.zoom;
        self.centre[1] -= self.sign() * f64::from(by.y) / self.zoom;
    }

    /// Returns the sign of the second screen axis relative to the second document axis.
    const fn sign(&self) -> f64 {
        if self.y_up { -1.0 } else { 1.0 }
    }
}

impl Mapping {
    /// Creates the mapping of a view in the rectangle of its canvas, without undistortion.
    #[must_use]
    pub const fn new(view: View, rect: Rect) -> Self {
        Self { view, rect, bend: None }
    }

    /// Maps a document point to canvas units: undistorted pixels, window pixels or metres. A point that a fisheye
    /// window does not show is mapped far outside the canvas.
    #[must_use]
    pub fn flat(&self, at: [f64; 2]) -> [f64; 2] {
        /// Canvas position of points that a window does not show, far outside every canvas.
        const FAR_OFF_CANVAS: [f64; 2] = [-1e6, -1e6];
        let is_window = self.bend.is_some_and(|bend| bend.size().is_some());
        self.flat_through_bend(at).unwrap_or(if is_window { FAR_OFF_CANVAS } else { at })
    }

    /// Maps a raw pixel through the undistortion or the fisheye window. `None` if the canvas has neither of them, or
    /// if the pixel cannot be mapped.
    fn flat_through_bend(&self, at: [f64; 2]) -> Option<[f64; 2]> {
        self.bend.and_then(|bend| bend.canvas_from_raw(at.into()))
    }

    /// Maps a document point (raw pixel of the image, or floor metres on the plan) to the screen.
    #[must_use]
    pub fn screen(&self, at: [f64; 2]) -> Pos2 {
        self.screen_of_flat(self.flat(at))
    }

    /// Maps a polyline of the image to the screen. In a fisheye window, straight lines of the image become curves,
    /// and invisible points are left out. In a panorama, lines continue across the seam.
    #[must_use]
    pub fn path(&self, points: &[Pixel]) -> Vec<Pos2> {
        let Some(bend) = self.bend.filter(|bend| bend.size().is_some()) else {
            return points.iter().map(|&at| self.screen(at.into())).collect();
        };
        let mut before: Option<[f64; 2]> = None;
        let flat = subdivided(points).filter_map(|at| self.flat_through_bend(at.into())).map(|mut flat| {
            if let (Some(round), Some([x, _])) = (bend.period_px(), before) {
                flat[0] += round * ((x - flat[0]) / round).round();
            }
            before = Some(flat);
            self.screen_of_flat(flat)
        });
        flat.collect()
    }

    fn screen_of_flat(&self, [x, y]: [f64; 2]) -> Pos2 {
        let View { centre, zoom, .. } = self.view;
        let (dx, dy) = ((x - centre[0]) * zoom, self.view.sign() * (y - centre[1]) * zoom);
        // Far outside the screen, the painter needs only the direction.
        let clamp = |value: f64| value.clamp(-1e7, 1e7) as f32;
        self.rect.center() + Vec2::new(clamp(dx), clamp(dy))
    }

    /// Maps a screen point to a document point: a raw pixel of the image, or floor metres on the plan. In a fisheye
    /// window, a screen point outside the image is mapped to a pixel far outside the image.
    #[must_use]
    pub fn document(&self, at: Pos2) -> [f64; 2] {
        self.bent_at(at).map_or_else(|| self.off_image(at), Into::into)
    }

    /// Maps a screen point to the raw pixel that an undistorted image or a fisheye window shows there. `None` if it
    /// shows no pixel there, and on all other canvases.
    #[must_use]
    pub fn bent_at(&self, at: Pos2) -> Option<Pixel> {
        self.bend.and_then(|bend| bend.raw_from_canvas(self.flat_at(at)))
    }

    /// Returns the document point for a screen point that `bent_at` does not map. In a fisheye window it is a pixel
    /// far outside the image. On other canvases it is the canvas point.
    fn off_image(&self, at: Pos2) -> [f64; 2] {
        match self.bend {
            Some(Bend::Window { lens, .. }) => {
                let Pixel { u, v } = lens.principal_point;
                [-u.abs() - 1e4, -v.abs() - 1e4]
            }
            _ => self.flat_at(at),
        }
    }

    /// Maps a screen point to a canvas point, in pixels of the raw image, the undistorted image or a fisheye window,
    /// or in metres of the floor.
    fn flat_at(&self, at: Pos2) -> [f64; 2] {
        let View { centre, zoom, .. } = self.view;
        let by = at - self.rect.center();
        [centre[0] + f64::from(by.x) / zoom, centre[1] + self.view.sign() * f64::from(by.y) / zoom]
    }

    /// Converts a distance on the screen, in points, to raw pixels of the image or to metres on the plan. In a
    /// fisheye window the result is approximate.
    #[must_use]
    pub fn units(&self, points: f32) -> f64 {
        let units = f64::from(points) / self.view.zoom;
        match self.bend {
            Some(Bend::Window { lens, window, .. }) => units * lens.focal / window.focal,
            _ => units,
        }
    }

    /// Returns the view zoomed by `factor`; the content at the screen point `at` stays there. `fitted` is the zoom that
    /// shows the whole document.
    #[must_use]
    pub fn zoomed(&self, at: Pos2, factor: f64, fitted: f64) -> View {
        let fixed = self.flat_at(at);
        let mut view = self.view;
        let (least, greatest) = if view.y_up { FLOOR_ZOOM } else { IMAGE_ZOOM };
        // The view that shows the whole document is always within the range.
        let least = least.min(fitted).min(view.zoom);
        view.zoom = (view.zoom * factor).clamp(least, greatest.max(view.zoom));
        let now = Self { view, ..*self }.flat_at(at);
        view.centre = [view.centre[0] + fixed[0] - now[0], view.centre[1] + fixed[1] - now[1]];
        view
    }
}

/// Subdivides a line into short segments, so that a window can curve the line.
fn subdivided(points: &[Pixel]) -> impl Iterator<Item = Pixel> {
    /// Longest segment, in raw pixels.
    const STEP_PX: f64 = 16.0;
    /// Largest number of segments between two points of the line.
    const MAX_STEPS: f64 = 400.0;
    let between = points.windows(2).flat_map(|pair| {
        let (a, b) = (pair[0], pair[1]);
        let steps = (a.distance(b) / STEP_PX).clamp(1.0, MAX_STEPS).ceil();
        (1..=steps as usize).map(move |step| {
            let t = step as f64 / steps;
            Pixel::new(a.u + t * (b.u - a.u), a.v + t * (b.v - a.v))
        })
    });
    points.first().copied().into_iter().chain(between)
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
            principal_point: Pixel::new(960.0, 540.0),
            focal: 1400.0,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        };
        let mapping = Mapping { bend: Some(Bend::Lens(lens)), ..mapping(false) };
        let there = mapping.document(mapping.screen([123.4, 777.7]));
        assert!((there[0] - 123.4).abs() < 1e-3 && (there[1] - 777.7).abs() < 1e-3, "{there:?}");
        let edge = [300.0, 900.0, 1500.0].map(|u| lens.distort(UndistortedPixel::new(u, 200.0)).unwrap());
        assert!(edge[0].v - edge[1].v > 5.0, "the lens bends it");
        let shown = edge.map(|pixel| mapping.screen(pixel.into()).y);
        assert!((shown[0] - shown[1]).abs() < 1e-2 && (shown[0] - shown[2]).abs() < 1e-2, "{shown:?}");
    }

    fn fisheye() -> Lens {
        let distortion = calib_core::Distortion::KannalaBrandt { k: [0.0; 4] };
        Lens {
            principal_point: Pixel::new(720.0, 720.0),
            focal: 440.0,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        }
    }

    #[test]
    fn a_window_maps_both_ways_and_shows_great_circles_straight() {
        let lens = fisheye();
        for window in Window::quadrants(calib_core::floor::Mount::Ceiling, [1280, 800]).unwrap() {
            let bend = Bend::Window { lens, focal: lens.focal, window };
            let view = View { centre: [640.0, 400.0], zoom: 0.6, y_up: false };
            let mapping = Mapping { bend: Some(bend), view, ..mapping(false) };
            let ends = [Pos2::new(250.0, 200.0), Pos2::new(700.0, 480.0)].map(|at| mapping.document(at));
            for at in ends {
                let there = mapping.document(mapping.screen(at));
                assert!(
                    (there[0] - at[0]).abs() < 1e-2 && (there[1] - at[1]).abs() < 1e-2,
                    "{there:?} {at:?}"
                );
            }
            let path = mapping.path(&calib_core::floor::annotated_line_curve(&lens, &ends.map(Pixel::from)));
            let (a, b) = (path[0], path[path.len() - 1]);
            let along = (b - a).normalized();
            let off = |at: &Pos2| ((*at - a).x * along.y - (*at - a).y * along.x).abs();
            assert!(path.iter().map(off).fold(0.0, f32::max) < 0.5, "straight in the window");
            // A point behind the window is far from its canvas.
            let behind = window.direction(window.principal_point).map(|part| -part);
            if let Some(pixel) =
                lens.bearing_to_pixel([lens.focal * behind[0], lens.focal * behind[1], behind[2]])
            {
                assert!(!mapping.rect.expand(2000.0).contains(mapping.screen(pixel.into())), "{pixel:?}");
            }
        }
    }

    #[test]
    fn a_line_across_the_seam_of_a_panorama_does_not_cross_it() {
        let lens = fisheye();
        let window = Window::panorama(calib_core::floor::Mount::Ceiling, 1.6, [2400, 800]).unwrap();
        let bend = Bend::Window { lens, focal: lens.focal, window };
        let view = View { centre: [1200.0, 400.0], zoom: 0.3, y_up: false };
        let mapping = Mapping { bend: Some(bend), view, ..mapping(false) };
        // The line crosses the vertical through the image centre, below the centre.
        let path = mapping.path(&[Pixel::new(600.0, 1100.0), Pixel::new(850.0, 1120.0)]);
        let longest = path.windows(2).map(|pair| pair[0].distance(pair[1])).fold(0.0, f32::max);
        assert!(longest < 20.0, "{longest}");
    }

    #[test]
    fn zooming_keeps_what_is_under_the_cursor() {
        for y_up in [false, true] {
            let mut mapping = mapping(y_up);
            let at = Pos2::new(222.0, 333.0);
            let before = mapping.document(at);
            for _ in 0..40 {
                mapping.view = mapping.zoomed(at, 1.2, 1.0);
            }
            let after = mapping.document(at);
            assert!((before[0] - after[0]).abs() < 1e-6 && (before[1] - after[1]).abs() < 1e-6);
        }
    }
}
