//! SQL views that map detections to the floor: a table of coefficients, and the expression that uses them.
//! Every engine with double precision evaluates it. Pixels count from the corner of the image.
//!
//! (u, v) is a pixel, (cx, cy) the principal point, and fx and fy are the focal lengths in pixels. The raw
//! position is (a, b) = ((u - cx) / fx, (v - cy) / fy), with r^2 = a^2 + b^2. The distortion is the quotient
//! q = 1 + d1 r^2 + d2 r^4 + d3 r^6, and the undistorted position is (a / q, b / q).
//! The homogeneous floor point is G (a, b, q), with a 3 x 3 matrix G. This is exact without distortion
//! (q = 1) and for the division model (d2 = d3 = 0). For other lenses d1, d2 and d3 are fitted, and the
//! largest error is reported.

use calib_core::floor::TangentPlane;
use calib_core::{Distortion, Extent, FloorPoint, Pixel, UndistortedPixel, WorldPoint};

use crate::export::{Export, MAX_NEGLIGIBLE_ERROR_PX, Scene, round_up, wide_lens_advice};
use crate::tree::digits;
use crate::view::{View, solve_3x3};

/// Safety factor of the reported error: upper bound of the error between sample points, divided by the
/// largest error at the sample points.
const SAMPLING_SAFETY_FACTOR: f64 = 1.01;

/// Table row of one camera.
struct Row<'a> {
    view: &'a View,
    /// Focal lengths fx, fy, in pixels of the stream.
    focal: [f64; 2],
    /// Coefficients d1, d2, d3 of q.
    coefficients: [f64; 3],
    /// Largest error of the fit over the image, in undistorted pixels, and over the EFOV, in metres.
    max_error: [f64; 2],
}

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let rows: Vec<Row<'_>> = scene.views.iter().map(Row::of).collect();
    for row in &rows {
        let [pixels, metres] = row.rounded_error();
        let what = format!(
            "the fit of its distortion for SQL has an error of at most {pixels:.3} px, and {metres:.4} m on the floor of the EFOV"
        );
        if row.max_error[0] > MAX_NEGLIGIBLE_ERROR_PX {
            let windows = wide_lens_advice(row.view).map_or(String::new(), |windows| format!("; {windows}"));
            export.add_loss(row.view, format!("its exact distortion: {what}{windows}"));
        } else if pixels > 0.0 {
            export.notes.push(format!("camera {:?}: {what}", row.view.id));
        }
    }
    let terms =
        (0..3).rev().find(|&i| rows.iter().any(|row| row.coefficients[i] != 0.0)).map_or(0, |i| i + 1);
    let has_periods = scene.views.iter().any(|view| view.valid_from.is_some() || view.valid_to.is_some());
    let seen_at = if has_periods { ", seen_at" } else { "" };
    let map = scene.site.tangent_plane().map_or_else(String::new, |plane| map_view(&plane));
    export.push("floor.sql", text(&rows, terms, has_periods) + &map);
    export.notes.push(format!("floor.sql needs a table or view detections(camera_id, u, v{seen_at})"));
}

impl<'a> Row<'a> {
    fn of(view: &'a View) -> Self {
        let own = view.scale.map(|scale| scale * view.camera.lens.focal);
        match view.camera.lens.distortion {
            Distortion::Division { lambda } => {
                Self { view, focal: own, coefficients: [lambda, 0.0, 0.0], max_error: [0.0; 2] }
            }
            _ if !view.is_distorted() => {
                Self { view, focal: view.focal(), coefficients: [0.0; 3], max_error: [0.0; 2] }
            }
            _ => {
                let coefficients = fit_coefficients(view);
                let row = Self { view, focal: view.focal(), coefficients, max_error: [0.0; 2] };
                Self { max_error: row.compute_max_error(), ..row }
            }
        }
    }

    /// Returns the matrix G, which maps (a, b, q) to the homogeneous floor point.
    fn floor_from_lens(&self) -> [[f64; 3]; 3] {
        let ([cx, cy], [fx, fy]) = (self.view.centre(), self.focal);
        self.view.floor_from_pixel().map(|[h0, h1, h2]| [h0 * fx, h1 * fy, h0 * cx + h1 * cy + h2])
    }

    fn floor(&self, [a, b]: [f64; 2]) -> Option<[f64; 2]> {
        let q = quotient(self.coefficients, a * a + b * b);
        let [x, y, w] = self.floor_from_lens().map(|row| row[0] * a + row[1] * b + row[2] * q);
        (q > 0.0 && w > 0.0).then_some([x / w, y / w])
    }

    /// Returns [`Self::max_error`] rounded up to the digits of the message: a thousandth of a pixel and a
    /// tenth of a millimetre.
    fn rounded_error(&self) -> [f64; 2] {
        [round_up(self.max_error[0], 3), round_up(self.max_error[1], 4)]
    }

    /// Computes the largest error of the fit over the image, in undistorted pixels, and over the EFOV, in
    /// metres.
    fn compute_max_error(&self) -> [f64; 2] {
        let view = self.view;
        let extent = Extent { size: view.size.map(f64::from), efov: &view.efov_on_floor };
        let mut off = [0.0_f64; 2];
        for (straight, raw) in view.samples().into_iter().chain(along_rays(view)) {
            let q = quotient(self.coefficients, raw[0] * raw[0] + raw[1] * raw[1]);
            let (du, dv) = (raw[0] / q - straight[0], raw[1] / q - straight[1]);
            let pixels = if q > 0.0 { (du * self.focal[0]).hypot(dv * self.focal[1]) } else { f64::INFINITY };
            off[0] = off[0].max(pixels);
            let exact = view.floor_from_undistorted(straight).filter(|&floor| extent.contains(floor));
            let Some(exact) = exact else { continue };
            let metres = self.floor(raw).map_or(f64::INFINITY, |[x, y]| (x - exact.x).hypot(y - exact.y));
            off[1] = off[1].max(metres);
        }
        off[1] = off[1].max(self.max_border_error());
        off.map(|most| SAMPLING_SAFETY_FACTOR * most)
    }

    /// Computes the largest error along the border of the EFOV, in metres. A pixel covers the most floor at
    /// the far side.
    fn max_border_error(&self) -> f64 {
        /// Number of samples on each side of the EFOV.
        const STEPS: usize = 16;
        let (camera, corners) = (&self.view.camera, &self.view.efov_on_floor);
        let centre = camera.lens.principal_point;
        let mut most = 0.0_f64;
        for (i, a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            for step in 0..STEPS {
                let t = step as f64 / STEPS as f64;
                let point = FloorPoint { x: a.x + t * (b.x - a.x), y: a.y + t * (b.y - a.y) };
                let Some(pixel) = camera.world_to_pixel(point.at_height(0.0)) else { continue };
                let raw = [(pixel.u - centre.u) / camera.focal, (pixel.v - centre.v) / camera.focal];
                let found = self.floor(raw);
                most = most.max(found.map_or(0.0, |[x, y]| (x - point.x).hypot(y - point.y)));
            }
        }
        most
    }

    fn text(&self, has_periods: bool) -> String {
        // Times are written in UTC, because some engines drop an offset. The site has checked them already.
        let time = |time: &Option<String>| match time.as_ref().and_then(|time| time.parse().ok()) {
            Some(time) => format!(", TIMESTAMP '{}'", jiff::Timestamp::to_string(&time)),
            None => ", CAST(NULL AS TIMESTAMP)".into(),
        };
        let period = if has_periods {
            time(&self.view.valid_from) + &time(&self.view.valid_to)
        } else {
            String::new()
        };
        let g = self.floor_from_lens().concat();
        let numbers = [&self.view.centre()[..], &self.focal, &self.coefficients, &g].concat();
        let cells: Vec<String> = numbers.iter().map(|&value| double(value)).collect();
        format!("  ('{}'{period}, {})", self.view.id.replace('\'', "''"), cells.join(", "))
    }
}

/// Returns undistorted and raw positions, as in [`View::samples`], along rays from the principal point to the
/// border of the image. They are evenly spaced in undistorted coordinates. Near the fold of a lens, where the
/// undistorted radius grows fastest, a tiny part of the image covers many undistorted pixels.
fn along_rays(view: &View) -> Vec<([f64; 2], [f64; 2])> {
    /// Number of rays.
    const RAYS: usize = 256;
    /// Number of samples on each ray.
    const STEPS: usize = 64;
    /// Number of bisections for the end of a ray.
    const HALVINGS: usize = 40;
    let (camera, centre) = (&view.camera, view.camera.lens.principal_point);
    let near = |[u, v]: [f64; 2]| [(u - centre.u) / camera.focal, (v - centre.v) / camera.focal];
    let mut found = Vec::with_capacity(RAYS * STEPS);
    for end in border(view, RAYS) {
        let at = |t: f64| Pixel::new(centre.u + t * (end.u - centre.u), centre.v + t * (end.v - centre.v));
        // Finds the part of the ray that the lens model can undistort.
        let (mut known, mut beyond) = (0.0, 1.0);
        if camera.undistort(end).is_some() {
            known = 1.0;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (known + beyond);
            *(if camera.undistort(at(middle)).is_some() { &mut known } else { &mut beyond }) = middle;
        }
        let Some(last) = camera.undistort(at(known)) else { continue };
        found.push((near([last.u, last.v]), near(at(known).into())));
        found.extend((1..STEPS).filter_map(|step| {
            let t = step as f64 / STEPS as f64;
            let [u, v] = [centre.u + t * (last.u - centre.u), centre.v + t * (last.v - centre.v)];
            let raw = camera.distort(UndistortedPixel::new(u, v))?;
            Some((near([u, v]), near(raw.into())))
        }));
    }
    found
}

/// Returns points on the border of the image, including its corners.
fn border(view: &View, count: usize) -> impl Iterator<Item = Pixel> {
    let [w, h] = [0, 1].map(|i| f64::from(view.size[i]) / view.scale[i]);
    let side = count / 4;
    (0..count).map(move |i| {
        let t = (i % side) as f64 / side as f64;
        match i / side {
            0 => Pixel::new(t * w, 0.0),
            1 => Pixel::new(w, t * h),
            2 => Pixel::new((1.0 - t) * w, h),
            _ => Pixel::new(0.0, (1.0 - t) * h),
        }
    })
}

/// Evaluates the quotient q = 1 + d1 r^2 + d2 r^4 + d3 r^6 at a squared radius r^2.
fn quotient([d1, d2, d3]: [f64; 3], square: f64) -> f64 {
    1.0 + square * (d1 + square * (d2 + square * d3))
}

/// Fits the coefficients d1, d2 and d3 of the quotient q to the lens over the image. It minimises the squared
/// error of the undistorted radius, `r_raw (1 / q - 1 / q_exact)`, to first order in q. `r_raw` is the raw
/// radius, and `q_exact` the quotient of the lens.
fn fit_coefficients(view: &View) -> [f64; 3] {
    let samples = view.samples();
    let most = samples.iter().map(|(_, raw)| raw[0].hypot(raw[1])).fold(1e-9, f64::max);
    let mut normal = [[0.0; 4]; 3];
    for (straight, raw) in &samples {
        let (raw_radius, radius) = (raw[0].hypot(raw[1]), straight[0].hypot(straight[1]));
        if radius < 1e-9 * most {
            continue;
        }
        let exact = raw_radius / radius;
        let weight = raw_radius / (exact * exact);
        let square = (raw_radius / most).powi(2);
        let row = [square, square.powi(2), square.powi(3), exact - 1.0].map(|value| value * weight);
        for i in 0..3 {
            for j in 0..4 {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    let [a, b, c] = solve_3x3(normal);
    [a / most.powi(2), b / most.powi(4), c / most.powi(6)]
}

/// Formats a number with an exponent, which every engine reads as a double. Some engines read plain decimals
/// with fewer digits.
fn double(value: f64) -> String {
    let text = digits(value);
    if text.contains('e') { text } else { text + "e0" }
}

/// Returns the text of the views; the lens terms after the first `terms` are zero in every row.
fn text(rows: &[Row<'_>], terms: usize, has_periods: bool) -> String {
    let (a, b) = ("((d.u - c.cx) / c.fx)", "((d.v - c.cy) / c.fy)");
    let square = format!("({a} * {a} + {b} * {b})");
    // Horner's scheme, from the last term.
    let series = (1..=terms).rev().fold(String::new(), |inner, i| match inner.as_str() {
        "" => format!("{square} * c.d{i}"),
        inner => format!("{square} * (c.d{i} + {inner})"),
    });
    let quotient = if terms == 0 { "1e0".into() } else { format!("(1e0 + {series})") };
    let row = |i: usize| format!("(c.g{i}1 * {a} + c.g{i}2 * {b} + c.g{i}3 * {quotient})");
    let (x, y, w) = (row(1), row(2), row(3));
    // With a positive d1 in the division model, the undistorted radius decreases again where q exceeds 2.
    let folds = rows.iter().any(|row| row.coefficients[0] > 0.0);
    let unfolded = if folds { format!("{quotient} <= 2e0 AND ") } else { String::new() };
    let shown = if terms == 0 { format!("{w} > 0") } else { format!("{quotient} > 0 AND {unfolded}{w} > 0") };
    let zone = if has_periods {
        "-- seen_at is in UTC. If its type has a time zone, set the time zone of the session to UTC.\n"
    } else {
        ""
    };
    let (columns, seen_at, during) = if has_periods {
        (
            "valid_from, valid_to, ",
            ", seen_at",
            "\n  AND (c.valid_from IS NULL OR d.seen_at >= c.valid_from) AND (c.valid_to IS NULL OR d.seen_at < c.valid_to)",
        )
    } else {
        ("", "", "")
    };
    let cameras: Vec<String> = rows.iter().map(|row| row.text(has_periods)).collect();
    format!(
        "-- Maps a table or view detections(camera_id, u, v{seen_at}). Pixels count from the corner of the image.\n\
         -- Boxes need u in their middle and v at their lower edge: x + w / 2 and y + h, or (x1 + x2) / 2 and y2,\n\
         -- or cx and cy + h / 2. Multiply fractions of the image by its width and height.\n\
         -- x_m and y_m are null above the horizon, outside the lens, and without a calibration.\n\
         {zone}{errors}CREATE OR REPLACE TEMPORARY VIEW calib_cameras AS\nSELECT * FROM (VALUES\n{cameras}\n) AS c\
         (camera_id, {columns}cx, cy, fx, fy, d1, d2, d3, g11, g12, g13, g21, g22, g23, g31, g32, g33);\n\n\
         CREATE OR REPLACE TEMPORARY VIEW calib_floor AS\nSELECT d.*,\n  \
         CASE WHEN {shown} THEN {x} / {w} END AS x_m,\n  CASE WHEN {shown} THEN {y} / {w} END AS y_m\n\
         FROM detections AS d LEFT JOIN calib_cameras AS c ON d.camera_id = c.camera_id{during};\n",
        errors = rows.iter().map(Row::comment).collect::<String>(),
        cameras = cameras.join(",\n"),
    )
}

/// Returns the text of the view with latitude and longitude.
///
/// Both are polynomials of second degree in x and y, from central differences of the exact conversion.
fn map_view(plane: &TangentPlane) -> String {
    /// Step of the differences, in metres. The third-order terms at this distance are below a millimetre.
    const STEP: f64 = 1000.0;
    let at = |x: f64, y: f64| {
        let at = plane.to_geographic(WorldPoint::new(x * STEP, y * STEP, 0.0));
        [at.latitude.to_degrees(), at.longitude.to_degrees()]
    };
    let columns = ["lat_deg", "lon_deg"].iter().enumerate().map(|(k, name)| {
        let at = |x: f64, y: f64| at(x, y)[k];
        let zero = at(0.0, 0.0);
        let [by_x, by_y] = [at(1.0, 0.0) - at(-1.0, 0.0), at(0.0, 1.0) - at(0.0, -1.0)].map(|by| by / (2.0 * STEP));
        let square = STEP * STEP;
        let by_xx = 0.5 * (at(1.0, 0.0) + at(-1.0, 0.0) - 2.0 * zero) / square;
        let by_yy = 0.5 * (at(0.0, 1.0) + at(0.0, -1.0) - 2.0 * zero) / square;
        let by_xy = 0.25 * (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / square;
        let [zero, by_x, by_y, by_xx, by_xy, by_yy] = [zero, by_x, by_y, by_xx, by_xy, by_yy].map(double);
        format!(
            "{zero} + x_m * ({by_x} + {by_xx} * x_m + {by_xy} * y_m) + y_m * ({by_y} + {by_yy} * y_m) AS {name}"
        )
    });
    format!(
        "\n-- Latitude and longitude (WGS84), within 1 cm up to 3 km from the origin of the site, except near the poles.\n\
         CREATE OR REPLACE TEMPORARY VIEW calib_map AS\nSELECT f.*,\n  {}\nFROM calib_floor AS f;\n",
        columns.collect::<Vec<_>>().join(",\n  ")
    )
}

impl Row<'_> {
    fn comment(&self) -> String {
        let [pixels, metres] = self.rounded_error();
        // A line break would end the SQL comment.
        let id = self.view.id.replace(|c: char| c.is_control(), " ");
        match pixels > 0.0 {
            true => format!(
                "-- {id}: fitted lens, with an error of at most {pixels:.3} px, and {metres:.4} m in the EFOV.\n"
            ),
            false => String::new(),
        }
    }
}
