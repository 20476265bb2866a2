//! Cameras of a site as an exporter needs them: at the size of one stream, with or without distortion.

use std::collections::HashSet;

use calib_core::{
    BrownConrady, Camera, Covariance, Distortion, DistortionModel, FloorPoint, Lens, Pixel, Plane,
    UndistortedPixel, WorldPoint,
};

use calib_site::{Georeference, Site, SiteCamera};

use crate::file::file_name;

/// Options of an export.
#[derive(Clone, Debug, Default)]
pub struct ExportOptions {
    /// Whether to export the camera of the undistorted image, with the map that produces this image.
    pub rectified: bool,
    /// Width and height of the stream, in pixels; absent: the size of the camera's image.
    pub rescale: Option<[u32; 2]>,
    /// Extension of the exported files, without the dot; absent: the first extension of the format.
    pub extension: Option<String>,
    /// Id of the only camera to export; absent: all cameras.
    pub camera: Option<String>,
    /// Image of the floor plan.
    pub plan: Option<PlanImage>,
    /// Whether images are embedded in the exported file instead of written as separate files, if the format
    /// allows it.
    pub embeds: bool,
}

/// Image of a floor plan.
#[derive(Clone, Debug)]
pub struct PlanImage {
    /// The image as PNG.
    pub png: Vec<u8>,
    /// Width and height, in pixels.
    pub size: [u32; 2],
}

/// Calibrated camera at the size of its stream.
#[derive(Clone, Debug)]
pub(crate) struct View {
    pub(crate) id: String,
    /// The id as a file name, unique among the views of an export.
    pub(crate) file: String,
    /// Path of the camera's image, as in the site; never a `data:` URI.
    pub(crate) image: Option<String>,
    /// Width and height of the stream, in pixels.
    pub(crate) size: [u32; 2],
    /// Width and height of the camera's image, in pixels.
    pub(crate) image_size: [u32; 2],
    /// Camera for square pixels: v of the camera's image is divided by the pixel aspect. Without distortion if the
    /// export is rectified.
    pub(crate) camera: Camera,
    /// Original lens for square pixels, with its distortion, also if `camera` has no distortion.
    pub(crate) raw_lens: Lens,
    /// Pixels of the stream per pixel of the image with square pixels, in x and y.
    pub(crate) scale: [f64; 2],
    /// EFOV in pixels of the stream: the annotated polygon, or the projection of its outline on the plan.
    pub(crate) efov_px: Vec<Pixel>,
    /// Corners of the EFOV on the plan, in metres.
    pub(crate) efov_m: Vec<FloorPoint>,
    /// EFOV projected to the floor along the viewing rays; differs from `efov_m` if the EFOV is on another
    /// plane.
    pub(crate) efov_on_floor: Vec<FloorPoint>,
    /// Plane of the EFOV.
    pub(crate) efov_plane: Plane,
    pub(crate) valid_from: Option<String>,
    pub(crate) valid_to: Option<String>,
    /// Whether the pose is known. Otherwise only the lens is, and `camera` is at the origin of the world.
    pub(crate) has_pose: bool,
    /// Whether the camera's position in the site is known.
    pub(crate) is_placed: bool,
    /// Note about an unknown scale of the camera.
    pub(crate) scale_note: Option<String>,
}

/// Distortion in the terms that most formats support.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Terms {
    None,
    BrownConrady(BrownConrady),
    Fisheye([f64; 4]),
    /// Rational terms in the order of `OpenCV`: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4.
    Rational([f64; 12]),
    /// Brown-Conrady approximation of another model, and its largest error in pixels.
    Fitted(BrownConrady, f64),
}

impl View {
    /// Returns the viewing direction, in degrees clockwise from north.
    pub(crate) fn azimuth_deg(&self, earth: &Georeference) -> f64 {
        (earth.x_axis_azimuth_deg - 90.0 - self.camera.yaw.to_degrees()).rem_euclid(360.0)
    }

    /// Returns the view of a camera; `None` without a calibration. `allows_lenses` accepts a camera without a pose
    /// if its lens is known.
    pub(crate) fn new(
        site: &Site,
        entry: &SiteCamera,
        options: &ExportOptions,
        allows_lenses: bool,
    ) -> Option<Self> {
        let posed = entry.camera();
        let camera = posed.or_else(|| if allows_lenses { camera_at_origin(entry) } else { None })?;
        let calibrated = with_square_pixels(camera);
        let aspect = camera.lens.pixel_aspect;
        let size = options.rescale.unwrap_or(entry.size_px);
        let [across, down] = [0, 1].map(|i| f64::from(size[i]) / f64::from(entry.size_px[i]));
        let scale = [across, aspect * down];
        let mut camera = calibrated;
        if options.rectified {
            camera.lens = Lens::pinhole(calibrated.lens.principal_point);
        }
        let outline = site.efov_outline(entry);
        let shown = |pixel: Pixel| {
            let straight = calibrated.undistort(pixel)?;
            Some(if options.rectified { Pixel { u: straight.u, v: straight.v } } else { pixel })
        };
        let drawn: Vec<Pixel> = match &entry.efov_px {
            Some(corners) => {
                let square = |&Pixel { u, v }: &Pixel| shown(Pixel { u, v: v / aspect });
                corners.iter().filter_map(square).collect()
            }
            None => outline.iter().filter_map(|&at| camera.world_to_pixel(at)).collect(),
        };
        let image = entry.image.clone().filter(|image| !image.starts_with("data:"));
        let mut view = Self {
            id: entry.id.clone(),
            file: file_name(&entry.id),
            image,
            size,
            image_size: entry.size_px,
            camera,
            raw_lens: calibrated.lens,
            scale,
            efov_px: Vec::new(),
            efov_m: outline.into_iter().map(WorldPoint::on_floor).collect(),
            efov_on_floor: site.efov_on_floor(entry),
            efov_plane: site.efov_plane(entry),
            valid_from: entry.valid_from.clone(),
            valid_to: entry.valid_to.clone(),
            has_pose: posed.is_some(),
            is_placed: entry.is_placed(),
            scale_note: site.scale_note(entry),
        };
        view.efov_px = drawn.into_iter().map(|pixel| view.in_stream(pixel)).collect();
        Some(view)
    }

    /// Whether the aspect ratios of stream and image differ by more than rounding to whole pixels.
    pub(crate) fn is_stretched(&self) -> bool {
        let [w, h] = self.size.map(f64::from);
        let [still_w, still_h] = self.image_size.map(f64::from);
        (w - still_w * h / still_h).abs() >= 1.0 && (h - still_h * w / still_w).abs() >= 1.0
    }

    /// Converts a pixel of the image with square pixels to a pixel of the stream.
    pub(crate) fn in_stream(&self, pixel: Pixel) -> Pixel {
        Pixel { u: pixel.u * self.scale[0], v: pixel.v * self.scale[1] }
    }

    /// Returns the focal length in x and y, in pixels of the stream.
    pub(crate) fn focal(&self) -> [f64; 2] {
        self.scale.map(|scale| scale * self.camera.focal)
    }

    /// Returns the principal point, in pixels of the stream, counted from the corner of the image.
    pub(crate) fn centre(&self) -> [f64; 2] {
        self.in_stream(self.camera.lens.principal_point).into()
    }

    /// Returns the principal point, in pixels of the stream, counted from the centre of the first pixel.
    pub(crate) fn centre_from_pixel_centre(&self) -> [f64; 2] {
        self.centre().map(|c| c - 0.5)
    }

    /// Returns the intrinsic matrix `K` with this principal point.
    pub(crate) fn intrinsics(&self, [cx, cy]: [f64; 2]) -> [[f64; 3]; 3] {
        let [fx, fy] = self.focal();
        [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    }

    /// Returns `[R | t]`, world to camera (right, down, forward).
    pub(crate) fn extrinsics(&self) -> [[f64; 4]; 3] {
        let (r, t) = (self.camera.rotation(), self.camera.translation());
        std::array::from_fn(|i| [r[i][0], r[i][1], r[i][2], t[i]])
    }

    /// Returns `K [R | t]`: world to undistorted pixels of the stream; the third coordinate is positive in
    /// front of the camera.
    pub(crate) fn projection(&self, centre: [f64; 2]) -> [[f64; 4]; 3] {
        let (k, rt) = (self.intrinsics(centre), self.extrinsics());
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|m| k[i][m] * rt[m][j]).sum()))
    }

    /// Returns the homography from undistorted pixels of the stream to floor points. The third coordinate of the result
    /// is positive for pixels that show the floor. The last element of the matrix is 1 or -1, or nearly 0.
    pub(crate) fn floor_from_pixel(&self) -> [[f64; 3]; 3] {
        self.plane_from_pixel(&Plane::FLOOR)
    }

    /// Returns the homography from undistorted pixels of the stream to a plane, scaled as in
    /// [`Self::floor_from_pixel`].
    pub(crate) fn plane_from_pixel(&self, plane: &Plane) -> [[f64; 3]; 3] {
        let h = self.camera.homography_plane_from_pixel(plane);
        let h = h.map(|[a, b, c]| [a / self.scale[0], b / self.scale[1], c]);
        let last = h[2][2].abs();
        if last > 1e-12 { h.map(|row| row.map(|value| value / last)) } else { h }
    }

    /// Projects a world point to an undistorted pixel of the stream.
    pub(crate) fn project_undistorted(&self, point: WorldPoint) -> Option<UndistortedPixel> {
        let UndistortedPixel { u, v } = self.camera.world_to_undistorted(point)?;
        Some(UndistortedPixel { u: u * self.scale[0], v: v * self.scale[1] })
    }

    /// Projects an undistorted position to the floor. The position is relative to the principal point,
    /// divided by the focal length.
    pub(crate) fn floor_from_undistorted(&self, [a, b]: [f64; 2]) -> Option<FloorPoint> {
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let f = self.camera.focal;
        self.camera.undistorted_to_floor(UndistortedPixel { u: cu + f * a, v: cv + f * b }, 0.0)
    }

    pub(crate) fn is_distorted(&self) -> bool {
        !self.camera.lens.distortion.is_pinhole()
    }

    /// Returns the distortion for coordinates divided by the camera's focal length; `None` if it cannot be
    /// converted.
    pub(crate) fn distortion(&self) -> Option<Distortion> {
        let lens = self.camera.lens;
        lens.distortion.rescaled(self.camera.focal / lens.focal)
    }

    /// Returns the lens in the terms that most formats support; fisheye and rational terms only if `lenses`
    /// contains that model.
    pub(crate) fn terms(&self, lenses: &[DistortionModel]) -> Terms {
        if !self.is_distorted() {
            return Terms::None;
        }
        match self.distortion() {
            Some(Distortion::BrownConrady(brown)) => Terms::BrownConrady(brown),
            Some(Distortion::KannalaBrandt { k }) if lenses.contains(&DistortionModel::KannalaBrandt) => {
                Terms::Fisheye(k)
            }
            Some(Distortion::Rational(rational)) if lenses.contains(&DistortionModel::Rational) => {
                let ([k1, k2, k3, k4, k5, k6], [p1, p2]) = (rational.radial, rational.tangential);
                let [s1, s2, s3, s4] = rational.prism;
                Terms::Rational([k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4])
            }
            _ => {
                let (brown, off) = self.fit_brown_conrady();
                Terms::Fitted(brown, off)
            }
        }
    }

    /// Fits k1, k2 and k3 to the lens over the image, and returns the fit with its largest error in pixels.
    /// Minimises the squares of `r (k1 r^2 + k2 r^4 + k3 r^6) - (r_distorted - r)`. r is the undistorted
    /// radius and `r_distorted` the raw radius, both divided by the focal length.
    fn fit_brown_conrady(&self) -> (BrownConrady, f64) {
        let points = self.samples();
        let most = points.iter().map(|(s, _)| s[0].hypot(s[1])).fold(1e-9, f64::max);
        let mut normal = [[0.0; 4]; 3];
        for (straight, raw) in &points {
            let r = straight[0].hypot(straight[1]) / most;
            let along = (raw[0] * straight[0] + raw[1] * straight[1]) / (r * most).max(1e-12) / most;
            let row = [r.powi(3), r.powi(5), r.powi(7), along - r];
            for i in 0..3 {
                for j in 0..4 {
                    normal[i][j] += row[i] * row[j];
                }
            }
        }
        let [a, b, c] = solve_3x3(normal);
        let brown = BrownConrady {
            k1: a / most.powi(2),
            k2: b / most.powi(4),
            k3: c / most.powi(6),
            ..BrownConrady::default()
        };
        let model = Distortion::BrownConrady(brown);
        let focal = self.focal();
        let off = points.iter().map(|(straight, raw)| {
            model.distort(*straight).map_or(f64::INFINITY, |found| {
                ((found[0] - raw[0]) * focal[0]).hypot((found[1] - raw[1]) * focal[1])
            })
        });
        (brown, off.fold(0.0, f64::max))
    }

    /// Returns pairs of the undistorted and the raw position of a point, on a grid over the image. Positions
    /// are relative to the principal point, divided by the focal length.
    pub(crate) fn samples(&self) -> Vec<([f64; 2], [f64; 2])> {
        /// Number of samples across the image.
        const COLUMNS: usize = 33;
        /// Number of samples from top to bottom.
        const ROWS: usize = 25;
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let f = self.camera.focal;
        let length = |i: usize| f64::from(self.size[i]) / self.scale[i];
        let grid = (0..COLUMNS * ROWS).map(|i| Pixel {
            u: length(0) * (i % COLUMNS) as f64 / (COLUMNS - 1) as f64,
            v: length(1) * (i / COLUMNS) as f64 / (ROWS - 1) as f64,
        });
        grid.filter_map(|raw| {
            let straight = self.camera.undistort(raw)?;
            Some(([(straight.u - cu) / f, (straight.v - cv) / f], [(raw.u - cu) / f, (raw.v - cv) / f]))
        })
        .collect()
    }
}

/// Returns a camera at the origin of the world with the lens of an entry; `None` if the focal length is not fixed, or
/// if the principal point or the distortion is unknown.
fn camera_at_origin(entry: &SiteCamera) -> Option<Camera> {
    let given = entry.lens_of_image()?;
    let focal = given.focal_px.filter(|focal| focal.fixed)?.value;
    given.principal_point_px.as_ref()?;
    if let Some(distortion) = &given.distortion {
        distortion.distortion()?;
    }
    let lens = entry.lens();
    let lens = if lens.distortion.is_pinhole() { Lens { focal, ..lens } } else { lens };
    let position = WorldPoint::new(0.0, 0.0, 0.0);
    Some(Camera { position, yaw: 0.0, pitch: 0.0, roll: 0.0, focal, lens, covariance: Covariance::UNKNOWN })
}

/// Returns the camera of the image with square pixels: v of every pixel is divided by the pixel aspect.
fn with_square_pixels(camera: Camera) -> Camera {
    let Lens { principal_point: Pixel { u, v }, pixel_aspect, .. } = camera.lens;
    let lens = Lens { principal_point: Pixel { u, v: v / pixel_aspect }, pixel_aspect: 1.0, ..camera.lens };
    Camera { lens, ..camera }
}

/// Solves three linear equations by Cramer's rule; returns zeros if they are singular. The last column of `m`
/// is the right-hand side.
pub(crate) fn solve_3x3(m: [[f64; 4]; 3]) -> [f64; 3] {
    let determinant = |c: [usize; 3]| {
        let at = |i: usize, j: usize| m[i][c[j]];
        at(0, 0) * (at(1, 1) * at(2, 2) - at(1, 2) * at(2, 1))
            - at(0, 1) * (at(1, 0) * at(2, 2) - at(1, 2) * at(2, 0))
            + at(0, 2) * (at(1, 0) * at(2, 1) - at(1, 1) * at(2, 0))
    };
    let all = determinant([0, 1, 2]);
    let roots = [determinant([3, 1, 2]) / all, determinant([0, 3, 2]) / all, determinant([0, 1, 3]) / all];
    if roots.iter().all(|root| root.is_finite()) { roots } else { [0.0; 3] }
}

/// Returns the views of a site, and the ids of the cameras without a calibration.
pub(crate) fn views(site: &Site, options: &ExportOptions, allows_lenses: bool) -> (Vec<View>, Vec<String>) {
    let wanted = site.cameras.iter().filter(|c| options.camera.as_ref().is_none_or(|id| *id == c.id));
    let (mut views, mut unsolved) = (Vec::new(), Vec::new());
    let mut taken = HashSet::new();
    for entry in wanted {
        match View::new(site, entry, options, allows_lenses) {
            Some(mut view) => {
                let plain = view.file.clone();
                // File names coincide for periods of one camera, and for ids that differ only in characters
                // that a file name cannot contain.
                for number in 2.. {
                    if taken.insert(view.file.to_lowercase()) {
                        break;
                    }
                    view.file = format!("{plain}-{number}");
                }
                views.push(view);
            }
            None => unsolved.push(entry.id.clone()),
        }
    }
    (views, unsolved)
}
