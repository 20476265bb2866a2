//! Calibrated camera for applications. It maps arrays of pixels of one video stream of the camera.
//!
//! All bindings for other languages use this interface. They pass arrays with their options. The computation
//! and the names are defined only here.

use std::ops::Range;

use crate::camera::{Camera, Covariance, FloorCovariance, FloorPoint, ImageCircle, Lens, Pixel, WorldPoint};
use crate::floor::detection_box::BoxForm;
use crate::floor::extent::Extent;
use crate::floor::extent::Status;
use crate::floor::point_projector::PointProjector;
use crate::floor::projector::FloorProjector;
use crate::floor::stream::{PixelOrigin, Stream, StreamError, StreamMap};
use crate::floor::surface::SurfaceProjector;
use crate::floor::surface::{Surface, SurfacePoint};

/// Calibrated camera with the stream to which its pixels belong.
///
/// All columns of a call have the same length. A result that does not exist is NaN, and its status, an index
/// of [`Status::ALL`], gives the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraView {
    floor: FloorProjector,
    size: [f64; 2],
    efov: Vec<FloorPoint>,
    /// Planes other than the floor; empty if pixels are mapped only to the floor.
    surfaces: Vec<Surface>,
    stream: Stream,
    /// Map between the stream and the calibrated image.
    map: StreamMap,
    /// Whether the scale of the floor points is determined.
    scale_is_known: bool,
}

/// Number of points that are mapped together. They fit into the fastest cache.
const CHUNK: usize = 512;

impl CameraView {
    /// Creates the view of a camera with an image of this width and height, and with this floor polygon as
    /// EFOV.
    #[must_use]
    pub fn new(camera: &Camera, size: [f64; 2], efov: Vec<FloorPoint>) -> Self {
        let (stream, map) = (Stream::default(), StreamMap::STILL);
        let (floor, surfaces) = (FloorProjector::new(camera, 0.0), Vec::new());
        Self { floor, size, efov, surfaces, stream, map, scale_is_known: true }
    }

    /// Returns the same view with planes that cover parts of the plan. A pixel is mapped to the plane or
    /// floor that its ray meets first.
    #[must_use]
    pub fn with_surfaces(self, surfaces: Vec<Surface>) -> Self {
        Self { surfaces, ..self }
    }

    /// Returns the same view with the flag `scale_is_known`: whether the scale of the floor points is
    /// determined.
    pub fn with_scale(self, scale_is_known: bool) -> Self {
        Self { scale_is_known, ..self }
    }

    /// Returns the same view for the pixels of another stream.
    ///
    /// # Errors
    /// If the stream does not match the size of the calibrated image.
    pub fn with_stream(&self, stream: Stream) -> Result<Self, StreamError> {
        Ok(Self { map: stream.map(self.size)?, stream, ..self.clone() })
    }

    /// Returns the planes other than the floor; empty if pixels are mapped only to the floor.
    #[must_use]
    pub fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    /// Returns the calibrated camera.
    #[must_use]
    pub const fn camera(&self) -> &Camera {
        self.floor.camera()
    }

    /// Returns the width and height of the calibrated image, in pixels.
    #[must_use]
    pub const fn size(&self) -> [f64; 2] {
        self.size
    }

    /// Returns the stream to which the pixels belong.
    #[must_use]
    pub const fn stream(&self) -> &Stream {
        &self.stream
    }

    /// Returns the width and height of the stream, in its pixels.
    #[must_use]
    pub fn stream_size(&self) -> [f64; 2] {
        let shown = self.stream.crop.map_or(self.size, |[_, _, width, height]| [width, height]);
        self.stream.size.map_or(shown, |size| size.map(f64::from))
    }

    /// Whether the scale of the points is determined. Otherwise the camera is assumed to be 3 m high. The
    /// points then have correct proportions only, and the calibration part of every covariance is unknown.
    #[must_use]
    pub const fn scale_is_known(&self) -> bool {
        self.scale_is_known
    }

    /// Returns the lens for the images of the stream, with pixel coordinates from the corner, and their width
    /// and height. Returns `None` if the stream is stretched and has two focal lengths.
    #[must_use]
    pub fn lens_in_stream(&self) -> Option<(Lens, [f64; 2])> {
        let corner = Stream { origin: PixelOrigin::Corner, ..self.stream };
        let (map, lens) = (corner.map(self.size).ok()?, self.camera().lens);
        let [right, down] = [0, 1].map(|axis| map.to_stream(axis, 1.0) - map.to_stream(axis, 0.0));
        // Scalers round to whole pixels.
        let is_stretched = (right / down - 1.0).abs() > 2e-3;
        let Pixel { u, v } = lens.principal_point;
        let principal_point = Pixel { u: map.to_stream(0, u), v: map.to_stream(1, v) };
        let focal = 0.5 * (right + down) * lens.focal;
        let circle = |ImageCircle { u, v, radius }| ImageCircle {
            u: map.to_stream(0, u),
            v: map.to_stream(1, v),
            radius: 0.5 * (right + down) * radius,
        };
        let image_circle = lens.image_circle.map(circle);
        let lens = Lens { principal_point, focal, image_circle, ..lens };
        (!is_stretched).then_some((lens, self.stream_size()))
    }

    /// Returns the camera for the images of the stream, with the pixel coordinates of the stream. The
    /// covariance is that of the calibrated image. Returns `None` if the stream is stretched and has two
    /// focal lengths.
    #[must_use]
    pub fn camera_in_stream(&self) -> Option<Camera> {
        let camera = self.camera();
        if self.map == StreamMap::STILL {
            return Some(*camera);
        }
        let (mut lens, _) = self.lens_in_stream()?;
        let Pixel { u, v } = camera.lens.principal_point;
        lens.principal_point = Pixel { u: self.map.to_stream(0, u), v: self.map.to_stream(1, v) };
        Some(Camera { lens, focal: camera.focal / camera.lens.focal * lens.focal, ..*camera })
    }

    /// Returns the corners of the EFOV on the floor, in metres.
    #[must_use]
    pub fn efov(&self) -> &[FloorPoint] {
        &self.efov
    }

    /// Returns the size of the calibrated image, in pixels, and the EFOV on the floor, in metres.
    #[must_use]
    pub fn extent(&self) -> Extent<'_> {
        Extent { size: self.size, efov: &self.efov }
    }

    /// Returns a projector from pixels to the horizontal plane at `height` metres.
    fn plane(&self, height: f64) -> FloorProjector {
        if height == 0.0 { self.floor } else { FloorProjector::new(self.camera(), height) }
    }

    /// Converts the stream pixels `(u, v)` to pixels of the calibrated image, at most [`CHUNK`] at a time, and
    /// calls `each` with the index range and the converted pixels.
    fn each_image_chunk(&self, [u, v]: [&[f64]; 2], mut each: impl FnMut(Range<usize>, [&[f64]; 2])) {
        assert!(u.len() == v.len(), "columns of equal length");
        let is_still = self.map == StreamMap::STILL;
        let ranges = (0..u.len()).step_by(CHUNK).map(|first| first..u.len().min(first + CHUNK));
        if is_still {
            ranges.for_each(|range| each(range.clone(), [&u[range.clone()], &v[range]]));
            return;
        }
        let mut still = [[0.0; CHUNK]; 2];
        for range in ranges {
            for (axis, (still, values)) in still.iter_mut().zip([u, v]).enumerate() {
                for (still, &value) in still.iter_mut().zip(&values[range.clone()]) {
                    *still = self.map.to_image(axis, value);
                }
            }
            each(range.clone(), [&still[0][..range.len()], &still[1][..range.len()]]);
        }
    }

    /// Maps pixels to points of the plane at `height`, in metres, with a status for each. With other planes,
    /// the points are `height` metres above the plane or floor that the ray meets first.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn to_floor(&self, height: f64, pixels: [&[f64]; 2], [x, y]: [&mut [f64]; 2], status: &mut [u8]) {
        let (plane, extent) = (self.plane(height), self.extent());
        assert!(status.len() == pixels[0].len(), "columns of equal length");
        self.each_image_chunk(pixels, |range, still| {
            let mut found = [Status::Ok; CHUNK];
            let found = &mut found[..range.len()];
            let at = [&mut x[range.clone()], &mut y[range.clone()]];
            if self.surfaces.is_empty() {
                plane.pixels_to_floor_within(&extent, still, at, found);
            } else {
                self.to_surfaces(height, still, at, found);
            }
            status[range].iter_mut().zip(found).for_each(|(code, &mut status)| *code = status as u8);
        });
    }

    /// Maps the foot points of detection boxes as [`Self::to_floor`] does.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn boxes_to_floor(
        &self,
        height: f64,
        (form, boxes): (BoxForm, &[[f64; 4]]),
        [x, y]: [&mut [f64]; 2],
        status: &mut [u8],
    ) {
        assert!(boxes.len() == status.len(), "columns of equal length");
        form.each_foot(boxes, (self.stream_size(), self.stream.origin), |range, feet| {
            let floor = [&mut x[range.clone()], &mut y[range.clone()]];
            self.to_floor(height, feet, floor, &mut status[range]);
        });
    }

    /// Computes the covariances of the foot points of detection boxes as [`Self::covariances`] does. `sigma` is the
    /// standard deviation of each coordinate of the middle of the lower edge, in pixels of the stream.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn boxes_covariances(
        &self,
        height: f64,
        (form, boxes): (BoxForm, &[[f64; 4]]),
        sigma: f64,
        [pixel, calibration]: [&mut [[f64; 4]]; 2],
    ) {
        assert!(boxes.len() == pixel.len(), "columns of equal length");
        form.each_foot(boxes, (self.stream_size(), self.stream.origin), |range, feet| {
            let parts = [&mut pixel[range.clone()], &mut calibration[range]];
            self.covariances(height, feet, sigma, parts);
        });
    }

    /// Maps pixels to points `height` metres above the plane or floor that the ray meets first, with a status
    /// for each.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn to_surfaces_with_status(
        &self,
        height: f64,
        pixels: [&[f64]; 2],
        points: &mut [Option<SurfacePoint>],
        status: &mut [Status],
    ) {
        let projector = SurfaceProjector::new(self.camera(), height, &self.surfaces);
        assert!(points.len() == pixels[0].len() && points.len() == status.len(), "columns of equal length");
        self.each_image_chunk(pixels, |range, still| {
            let found = (&mut points[range.clone()], &mut status[range]);
            projector.pixels_to_surfaces(&self.extent(), still, found.0, found.1);
        });
    }

    /// Returns the covariance of the point at a pixel on a surface, or on the floor. `sigma` is the standard
    /// deviation of each coordinate, in pixels of the stream. See [`SurfaceProjector::covariance`].
    #[must_use]
    pub fn covariance(&self, pixel: Pixel, sigma: f64, surface: Option<usize>) -> Option<FloorCovariance> {
        let still = Pixel { u: self.map.to_image(0, pixel.u), v: self.map.to_image(1, pixel.v) };
        let projector = SurfaceProjector::new(self.camera(), 0.0, &self.surfaces);
        projector.covariance(still, sigma * self.map.max_pixel_size(), surface)
    }

    /// Maps at most [`CHUNK`] pixels of the calibrated image to points. Each point is `height` metres above the plane
    /// or floor that the ray of its pixel meets first.
    fn to_surfaces(&self, height: f64, still: [&[f64]; 2], [x, y]: [&mut [f64]; 2], status: &mut [Status]) {
        let mut points = [None; CHUNK];
        let points = &mut points[..status.len()];
        let projector = SurfaceProjector::new(self.camera(), height, &self.surfaces);
        projector.pixels_to_surfaces(&self.extent(), still, points, status);
        for ((point, x), y) in points.iter().zip(x).zip(y) {
            (*x, *y) = point.map_or((f64::NAN, f64::NAN), |point| (point.at.x, point.at.y));
        }
    }

    /// Maps pixels like [`Self::to_floor`], but without a status. The point of a pixel above the horizon or outside
    /// the lens is NaN.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn to_floor_points(&self, height: f64, pixels: [&[f64]; 2], [x, y]: [&mut [f64]; 2]) {
        let plane = self.plane(height);
        if self.surfaces.is_empty() && self.map == StreamMap::STILL {
            // Chunks are not needed if the stream has the size of the calibrated image and the floor is the only
            // plane.
            return plane.pixels_to_floor(pixels[0], pixels[1], x, y);
        }
        self.each_image_chunk(pixels, |range, [u, v]| {
            let (x, y) = (&mut x[range.clone()], &mut y[range]);
            if self.surfaces.is_empty() {
                plane.pixels_to_floor(u, v, x, y);
            } else {
                self.to_surfaces(height, [u, v], [x, y], &mut [Status::Ok; CHUNK][..u.len()]);
            }
        });
    }

    /// Computes the covariances of the points that [`Self::to_floor`] returns for these pixels, as xx, xy, yx, yy
    /// in square metres. The pixel part and the calibration part are separate. `sigma` is the standard deviation of
    /// each coordinate, in pixels of the stream.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn covariances(
        &self,
        height: f64,
        pixels: [&[f64]; 2],
        sigma: f64,
        [pixel, calibration]: [&mut [[f64; 4]]; 2],
    ) {
        let (plane, sigma) = (self.plane(height), sigma * self.map.max_pixel_size());
        assert!(pixel.len() == pixels[0].len(), "columns of equal length");
        self.each_image_chunk(pixels, |range, still| {
            let (pixel, calibration) = (&mut pixel[range.clone()], &mut calibration[range.clone()]);
            if !self.surfaces.is_empty() {
                let surfaces = SurfaceProjector::new(self.camera(), height, &self.surfaces);
                return surfaces.covariances(still, sigma, [pixel, calibration]);
            }
            let mut found = [[[0.0; CHUNK]; 3]; 2];
            let columns =
                found.each_mut().map(|part| part.each_mut().map(|column| &mut column[..range.len()]));
            plane.floor_covariances(still, sigma, columns);
            for (part, [xx, xy, yy]) in [pixel, calibration].into_iter().zip(&found) {
                part.iter_mut().enumerate().for_each(|(i, of)| *of = [xx[i], xy[i], xy[i], yy[i]]);
            }
        });
    }

    /// Computes, for every pixel, the Jacobian of its floor point (height 0) with respect to the camera parameters:
    /// the row of x, then the row of y. NaN without a floor point.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn floor_jacobians(&self, pixels: [&[f64]; 2], of: &mut [[[f64; Covariance::SIZE]; 2]]) {
        assert!(of.len() == pixels[0].len(), "columns of equal length");
        self.each_image_chunk(pixels, |range, [u, v]| {
            for ((of, &u), &v) in of[range].iter_mut().zip(u).zip(v) {
                let found = self.camera().floor_jacobian(Pixel { u, v });
                let columns = found.unwrap_or([[f64::NAN; 2]; Covariance::SIZE]);
                *of = [0, 1].map(|row| columns.map(|column| column[row]));
            }
        });
    }

    /// Maps world points, in metres, to pixels, with a status for each.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn to_pixels(&self, [x, y, z]: [&[f64]; 3], [u, v]: [&mut [f64]; 2], status: &mut [u8]) {
        assert!(
            x.len() == y.len() && x.len() == z.len() && x.len() == status.len(),
            "columns of equal length"
        );
        assert!(x.len() == u.len() && x.len() == v.len(), "columns of equal length");
        let (projector, extent) = (PointProjector::new(self.camera()), self.extent());
        for first in (0..x.len()).step_by(CHUNK) {
            let range = first..x.len().min(first + CHUNK);
            let (u, v, status) = (&mut u[range.clone()], &mut v[range.clone()], &mut status[range.clone()]);
            projector.points_to_pixels([x, y, z].map(|values| &values[range.clone()]), [&mut *u, &mut *v]);
            for (i, ((u, v), status)) in u.iter_mut().zip(v).zip(status).enumerate() {
                let pixel = Pixel { u: *u, v: *v };
                *status = if pixel.is_finite() {
                    extent.status_of_pixel(pixel)
                } else {
                    let at = first + i;
                    extent.to_pixel(self.camera(), WorldPoint { x: x[at], y: y[at], z: z[at] }).1
                } as u8;
                (*u, *v) = (self.map.to_stream(0, *u), self.map.to_stream(1, *v));
            }
        }
    }

    /// Computes the unit vectors of the rays of pixels, in world axes.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn rays(&self, pixels: [&[f64]; 2], directions: &mut [[f64; 3]]) {
        assert!(directions.len() == pixels[0].len(), "columns of equal length");
        self.each_image_chunk(pixels, |range, [u, v]| {
            for ((direction, &u), &v) in directions[range].iter_mut().zip(u).zip(v) {
                let ray = self.camera().pixel_to_ray(Pixel { u, v });
                *direction = ray.map_or([f64::NAN; 3], |ray| ray.direction);
            }
        });
    }

    /// Maps pixels to undistorted pixels of the stream.
    ///
    /// # Panics
    /// If the columns differ in length.
    pub fn undistort(&self, pixels: [&[f64]; 2], [u, v]: [&mut [f64]; 2]) {
        self.each_image_chunk(pixels, |range, [raw_u, raw_v]| {
            let (u, v) = (&mut u[range.clone()], &mut v[range]);
            self.floor.undistort_pixels(raw_u, raw_v, u, v);
            if self.map != StreamMap::STILL {
                u.iter_mut().for_each(|u| *u = self.map.to_stream(0, *u));
                v.iter_mut().for_each(|v| *v = self.map.to_stream(1, *v));
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use crate::floor::efov::default_efov;
    use crate::floor::stream::StreamFit;
    use proptest::prelude::*;

    const SIZE: [f64; 2] = [1920.0, 1080.0];

    /// Returns the bits of all values; all NaN values have the same bits.
    fn bits(x: &[f64], y: &[f64]) -> Vec<u64> {
        let bits = |value: &f64| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
        x.iter().chain(y).map(bits).collect()
    }

    proptest! {
        #[test]
        fn stream_pixels_map_like_calibrated_image_pixels(
            camera in any_camera(), height in -0.5..1.5_f64,
            at in proptest::collection::vec((-50.0..700.0_f64, -50.0..700.0_f64), 1..1200),
        ) {
            prop_assume!((height - camera.position.z).abs() > 0.2);
            let still = CameraView::new(&camera, SIZE, default_efov(&camera, SIZE).polygon);
            let (size, fit) = (Some([640, 640]), Some(StreamFit::Letterbox));
            let crop = Some([160.0, 90.0, 1600.0, 900.0]);
            let stream = Stream { origin: PixelOrigin::Centre, size, fit, crop };
            let view = still.with_stream(stream).unwrap();
            let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
            let map = stream.map(SIZE).unwrap();
            let in_still: [Vec<f64>; 2] = [(0, &u), (1, &v)]
                .map(|(axis, values)| values.iter().map(|&value| map.to_image(axis, value)).collect());
            let mapped = |view: &CameraView, u: &[f64], v: &[f64]| {
                let (mut x, mut y, mut status) = (vec![0.0; u.len()], vec![0.0; u.len()], vec![0; u.len()]);
                view.to_floor(height, [u, v], [&mut x, &mut y], &mut status);
                let bits = bits(&x, &y);
                (bits, status)
            };
            prop_assert_eq!(mapped(&view, &u, &v), mapped(&still, &in_still[0], &in_still[1]));
            let (mut a, mut b) = (vec![0.0; u.len()], vec![0.0; u.len()]);
            view.to_floor_points(height, [&u, &v], [&mut a, &mut b]);
            prop_assert_eq!(bits(&a, &b), mapped(&view, &u, &v).0);
            view.undistort([&u, &v], [&mut a, &mut b]);
            // The view counts pixels from the centre of the first pixel. The lens counts them from its corner.
            let (lens, shown) = view.lens_in_stream().unwrap();
            let in_stream = view.camera_in_stream().unwrap();
            let (mut x, mut y, mut status) = (vec![0.0; u.len()], vec![0.0; u.len()], vec![0; u.len()]);
            view.to_floor(height, [&u, &v], [&mut x, &mut y], &mut status);
            prop_assert_eq!(shown, [640.0, 640.0]);
            for i in 0..u.len() {
                let by_lens = lens.undistort(Pixel::new(u[i] + 0.5, v[i] + 0.5));
                let off = by_lens.map_or(0.0, |p| (p.u - 0.5 - a[i]).hypot(p.v - 0.5 - b[i]));
                prop_assert!(a[i].is_nan() || off < 1e-6 * (1.0 + a[i].hypot(b[i])), "{off}");
                let straight = camera.undistort(Pixel::new(in_still[0][i], in_still[1][i]));
                prop_assert_eq!(straight.is_none(), a[i].is_nan());
                let floor = in_stream.pixel_to_floor(Pixel::new(u[i], v[i]), height);
                prop_assert_eq!(floor.is_none(), x[i].is_nan());
                let range = floor.map_or(0.0, |floor| floor.distance(camera.position.on_floor()));
                let off = floor.map_or(0.0, |floor| (floor.x - x[i]).hypot(floor.y - y[i]));
                prop_assert!(off < 1e-9 * (1.0 + range).powi(2), "{off} at {range}");
                let off = straight.map_or(0.0, |s| (map.to_image(0, a[i]) - s.u).hypot(map.to_image(1, b[i]) - s.v));
                prop_assert!(off < 1e-6, "{off}");
            }
        }

        #[test]
        fn pixels_map_to_first_plane_on_ray(
            camera in any_camera(), at in proptest::collection::vec((0.0..1920.0_f64, 300.0..1080.0_f64), 1..700),
        ) {
            let foot = camera.position.on_floor();
            let corner = |dx: f64, dy: f64| FloorPoint { x: foot.x + dx, y: foot.y + dy };
            let region = vec![corner(-40.0, -40.0), corner(40.0, -40.0), corner(40.0, 40.0), corner(-40.0, 40.0)];
            let plane = crate::camera::Plane::level(0.7);
            let deck = Surface { plane, covariance: [[4e-4, 0.0, 0.0], [0.0; 3], [0.0; 3]], region };
            let view = CameraView::new(&camera, SIZE, default_efov(&camera, SIZE).polygon).with_surfaces(vec![deck]);
            let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
            let (mut x, mut y, mut status) = (vec![0.0; u.len()], vec![0.0; u.len()], vec![0; u.len()]);
            view.to_floor(0.0, [&u, &v], [&mut x, &mut y], &mut status);
            let (mut pixel, mut calibration) = (vec![[0.0; 4]; u.len()], vec![[0.0; 4]; u.len()]);
            view.covariances(0.0, [&u, &v], 0.0, [&mut pixel, &mut calibration]);
            let (mut shown, mut of_shown) = (vec![None; u.len()], vec![Status::Ok; u.len()]);
            view.to_surfaces_with_status(0.0, [&u, &v], &mut shown, &mut of_shown);
            for i in 0..u.len() {
                let at = shown[i].map_or([f64::NAN; 2], |shown| [shown.at.x, shown.at.y]);
                prop_assert_eq!(bits(&at[..1], &at[1..]), bits(&x[i..=i], &y[i..=i]));
                prop_assert_eq!(of_shown[i] as u8, status[i]);
                let covariance = shown[i].and_then(|shown| view.covariance(Pixel { u: u[i], v: v[i] }, 0.0, shown.surface));
                let [_, rows] = covariance.unwrap_or(FloorCovariance::NAN).rows();
                prop_assert_eq!(bits(&rows, &[]), bits(&calibration[i], &[]));
                let Some(deck) = camera.pixel_to_floor(Pixel { u: u[i], v: v[i] }, 0.7) else { continue };
                if deck.distance(foot) > 39.0 {
                    continue;
                }
                prop_assert!((deck.x - x[i]).hypot(deck.y - y[i]) < 1e-7, "{deck:?}");
                // A height error of 2 cm moves the point along its ray.
                let along = 0.02 * deck.distance(foot) / (camera.position.z - 0.7);
                // The whole error is along the ray, so the trace is its only variance.
                let variance = calibration[i][0] + calibration[i][3];
                prop_assert!(variance.is_nan() || (variance.sqrt() - along).abs() < 1e-6);
            }
        }

        #[test]
        fn fractions_map_like_pixels_of_the_stream(
            camera in any_camera(),
            boxes in proptest::collection::vec([0.0..1.0_f64, 0.0..1.0_f64, 0.0..0.5_f64, 0.0..0.5_f64], 1..600),
            centre in proptest::bool::ANY,
        ) {
            let still = CameraView::new(&camera, SIZE, default_efov(&camera, SIZE).polygon);
            let (size, fit) = (Some([640, 640]), Some(StreamFit::Letterbox));
            let origin = if centre { PixelOrigin::Centre } else { PixelOrigin::Corner };
            let view = still.with_stream(Stream { origin, size, fit, crop: None }).unwrap();
            let shift = if centre { 0.5 } else { 0.0 };
            let in_pixels: Vec<[f64; 4]> = boxes
                .iter()
                .map(|[x, y, w, h]| [640.0 * x - shift, 640.0 * y - shift, 640.0 * w, 640.0 * h])
                .collect();
            let mapped = |form, boxes: &[[f64; 4]]| {
                let (mut x, mut y, mut status) = (vec![0.0; boxes.len()], vec![0.0; boxes.len()], vec![0; boxes.len()]);
                view.boxes_to_floor(0.0, (form, boxes), [&mut x, &mut y], &mut status);
                (x, y, status)
            };
            let (x, y, status) = mapped(BoxForm::Fractions, &boxes);
            let (a, b, expected) = mapped(BoxForm::CentreSize, &in_pixels);
            prop_assert_eq!(&status, &expected);
            for i in 0..x.len() {
                let scale = 1.0 + a[i].hypot(b[i]).powi(2);
                prop_assert!(x[i].is_nan() == a[i].is_nan());
                prop_assert!(x[i].is_nan() || (x[i] - a[i]).hypot(y[i] - b[i]) < 1e-7 * scale);
            }
        }

        #[test]
        fn floor_points_map_back_to_stream_pixels(camera in any_camera(), u in 0.0..1280.0_f64, v in 0.0..720.0_f64) {
            let still = CameraView::new(&camera, SIZE, Vec::new());
            let stream = Stream { origin: PixelOrigin::Centre, size: Some([1280, 720]), ..Stream::default() };
            let view = still.with_stream(stream).unwrap();
            let [mut x, mut y, mut a, mut b] = [[0.0]; 4];
            let mut status = [0];
            view.to_floor(0.0, [&[u], &[v]], [&mut x, &mut y], &mut status);
            prop_assume!(x[0].is_finite() && x[0].hypot(y[0]) < 1e4);
            view.to_pixels([&x, &y, &[0.0]], [&mut a, &mut b], &mut status);
            prop_assert!((a[0] - u).hypot(b[0] - v) < 1e-6);
            prop_assert!(status[0] == Status::Ok as u8 || status[0] == Status::OutsideImage as u8);
            let mut direction = [[0.0; 3]];
            view.rays([&[u], &[v]], &mut direction);
            let reach = -camera.position.z / direction[0][2];
            prop_assert!((camera.position.x + reach * direction[0][0] - x[0]).abs() < 1e-6 * (1.0 + reach * reach));
        }
    }
}
