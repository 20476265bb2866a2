//! Mapping of a table and its output columns.
//!
//! For a site with planes other than the floor, the output also contains the plane and the height of each
//! point. Standard deviations are added in two parts: one of the pixel and one of the calibration. The error of
//! the calibration is common to all detections of a camera, so averaging them does not reduce it.

use std::sync::Arc;

use arrow_array::builder::StringBuilder;
use arrow_array::{ArrayRef, Float64Array, RecordBatch, RecordBatchOptions};
use arrow_schema::{Field, Schema};
use calib_core::floor::{Geographic, StreamMap, SurfacePoint, TangentPlane};
use calib_core::{FloorCovariance, FloorPoint, Pixel, Status, SurfaceProjector, WorldPoint};
use calib_site::{CoordinateSystem, GeoreferenceSolution};

use crate::boxes::{BOXES, BoxColumns, BoxValues, Boxes, FEET_OR_BOXES};
use crate::calibrations::{Calibration, Calibrations, Choice, Planes};
use crate::columns::{BadCells, RowName, names, numbers};
use crate::table_error::TableError;

/// Names of the uncertainty columns: standard deviations (metres) and correlation of x and y, first from the
/// pixel noise, then from the calibration.
const SIGMA_COLUMNS: [&str; 6] =
    ["sigma_x_m", "sigma_y_m", "rho", "calibration_sigma_x_m", "calibration_sigma_y_m", "calibration_rho"];

/// Names of the standard deviations toward east and north (metres), from the pixel noise and from the
/// calibration.
const GEOGRAPHIC_SIGMA_COLUMNS: [[&str; 2]; 2] =
    [["sigma_east_m", "sigma_north_m"], ["calibration_sigma_east_m", "calibration_sigma_north_m"]];

/// Values of [`SIGMA_COLUMNS`]; NaN for a missing point or an unknown uncertainty.
pub(crate) struct Sigmas([Vec<f64>; SIGMA_COLUMNS.len()]);

impl Sigmas {
    pub(crate) fn unknown(rows: usize) -> Self {
        Self(std::array::from_fn(|_| vec![f64::NAN; rows]))
    }

    /// Computes the uncertainty of the points at pixels of the image. `sigma` is the standard deviation of a
    /// detection, in pixels of the stream. `covariance` returns the covariance of a row's point, for a standard
    /// deviation in image pixels.
    pub(crate) fn from_pixels(
        calibration: &Calibration,
        [u, v]: [&[f64]; 2],
        sigma: f64,
        covariance: impl Fn(usize, Pixel, f64) -> Option<FloorCovariance>,
    ) -> Self {
        let sigma = sigma * calibration.stream.max_pixel_size();
        let mut sigmas = Self::unknown(u.len());
        for (row, (&u, &v)) in u.iter().zip(v).enumerate() {
            let Some(found) = covariance(row, Pixel { u, v }, sigma) else { continue };
            let known = found.calibration.map(sigmas_and_correlation);
            let parts = sigmas_and_correlation(found.pixel).into_iter().chain(known.unwrap_or([f64::NAN; 3]));
            put(&mut sigmas.0, row, parts);
        }
        sigmas
    }

    pub(crate) fn put(&mut self, rows: &[usize], some: &Self) {
        for (all, some) in self.0.iter_mut().zip(&some.0) {
            rows.iter().zip(some).for_each(|(&row, &value)| all[row] = value);
        }
    }

    pub(crate) fn columns(self) -> impl Iterator<Item = (&'static str, Vec<f64>)> {
        SIGMA_COLUMNS.into_iter().zip(self.0)
    }
}

fn put(columns: &mut [Vec<f64>], row: usize, values: impl Iterator<Item = f64>) {
    columns.iter_mut().zip(values).for_each(|(column, value)| column[row] = value);
}

/// Returns the standard deviations and the correlation of a covariance; the correlation is zero if a variance
/// is zero.
fn sigmas_and_correlation([[xx, xy], [_, yy]]: [[f64; 2]; 2]) -> [f64; 3] {
    let [x, y] = [xx, yy].map(|variance| variance.max(0.0).sqrt());
    [x, y, if x > 0.0 && y > 0.0 { (xy / (x * y)).clamp(-1.0, 1.0) } else { 0.0 }]
}

/// Names of the columns for the height of a point and the plane that it is on.
const PLANE_COLUMNS: [&str; 2] = ["z_m", "plane"];

/// Points on the floor or on planes, row by row; `None` if a pixel shows neither.
pub(crate) struct PlanePoints(Vec<Option<SurfacePoint>>);

impl PlanePoints {
    pub(crate) fn missing(rows: usize) -> Self {
        Self(vec![None; rows])
    }

    /// Maps image pixels to the nearest point of the floor or a plane along the viewing ray. Points are
    /// `height` metres above the floor or the plane.
    pub(crate) fn map(
        calibration: &Calibration,
        planes: &Planes,
        [u, v]: [&[f64]; 2],
        height: f64,
        sigma: Option<f64>,
    ) -> MappedPoints {
        let mut mapped = MappedPoints::uncalibrated(u.len(), false, true);
        let projector = SurfaceProjector::new(calibration.projector.camera(), height, &planes.surfaces);
        let mut points: Vec<Option<SurfacePoint>> = vec![None; u.len()];
        projector.pixels_to_surfaces(&calibration.extent(), [u, v], &mut points, &mut mapped.status);
        for ((point, x), y) in points.iter().zip(&mut mapped.x).zip(&mut mapped.y) {
            (*x, *y) = point.map_or((f64::NAN, f64::NAN), |SurfacePoint { at, .. }| (at.x, at.y));
        }
        mapped.sigmas = sigma.map(|sigma| {
            Sigmas::from_pixels(calibration, [u, v], sigma, |row, pixel, sigma| {
                points[row].and_then(|point| projector.covariance(pixel, sigma, point.surface))
            })
        });
        mapped.plane_points = Some(Self(points));
        mapped
    }

    pub(crate) fn put(&mut self, rows: &[usize], some: &Self) {
        rows.iter().zip(&some.0).for_each(|(&row, &point)| self.0[row] = point);
    }

    /// Returns the columns of height and plane. The plane is empty for a point on the floor; both are empty
    /// for a missing point.
    pub(crate) fn columns(self, planes: &Planes) -> [(&'static str, ArrayRef); 2] {
        let heights: Float64Array = self.0.iter().map(|point| point.map(|point| point.at.z)).collect();
        let mut ids = StringBuilder::new();
        for point in &self.0 {
            let surface = point.and_then(|point| point.surface);
            ids.append_option(surface.and_then(|surface| planes.ids.get(surface)));
        }
        let [height, plane] = PLANE_COLUMNS;
        [(height, Arc::new(heights)), (plane, Arc::new(ids.finish()))]
    }
}

/// Direction of the mapping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum To {
    /// Columns `u,v` (or boxes) to `x_m,y_m,status`; if planes of the site have regions, also
    /// `z_m` and `plane`, the id of the first plane that a pixel shows
    Floor,
    /// Columns `x_m,y_m,z_m` to `u,v,status`
    Pixel,
}

/// Type of the pixels in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Columns {
    /// Points if the columns `u` and `v` exist, otherwise boxes
    Auto,
    /// Points: `u,v`
    Points,
    /// Boxes: `x,y,w,h`, `x1,y1,x2,y2` or other usual names; the foot is the middle of the lower edge
    Boxes,
}

/// Information from the source about the rows of a batch.
#[derive(Clone, Copy)]
#[expect(missing_debug_implementations, reason = "closures have none")]
pub struct Rows<'a> {
    /// Function that names a row, for messages.
    pub row_name: RowName<'a>,
    /// Whether a row is incomplete.
    pub is_incomplete: &'a dyn Fn(usize) -> bool,
}

/// Options of the mapping of a table.
#[derive(Debug)]
pub struct Mapping {
    /// Direction of the mapping.
    pub to: To,
    /// Type of the pixels: points or boxes.
    pub columns: Columns,
    /// Reader of boxes.
    pub boxes: Boxes,
    /// Height above the floor of the plane that pixels are mapped to, in metres. It is also the z of 3D
    /// points in a table without the column `z_m`.
    pub height: f64,
    /// Standard deviation of a detection, in pixels of its stream; adds the columns of uncertainty.
    pub sigma: Option<f64>,
    /// Whether to add latitude and longitude. The site must have a georeference.
    pub is_geographic: bool,
    /// Grid in which east and north are added. The site must have a georeference.
    pub grid: Option<CoordinateSystem>,
    /// Whether output columns replace existing columns of the same name; otherwise these are an error.
    pub replaces: bool,
    /// Handling of invalid cells.
    pub bad: BadCells,
}

impl Mapping {
    /// Adds the mapped columns to a batch.
    ///
    /// # Errors
    ///
    /// Fails if an input column is missing, an output column exists already, or a cell is invalid. Also fails if
    /// geographic or grid columns are requested for a site without a georeference.
    pub fn map(
        &self,
        batch: &RecordBatch,
        calibrations: &mut Calibrations,
        Rows { row_name, is_incomplete }: Rows<'_>,
    ) -> Result<RecordBatch, TableError> {
        let mut points = self.points(batch, calibrations, row_name)?;
        for row in (0..batch.num_rows()).filter(|&row| is_incomplete(row)) {
            self.bad.count_incomplete_row();
            points.a[row] = f64::NAN;
        }
        let choice = calibrations.choose(batch, row_name, &self.bad)?;
        let mapped = points.mapped(self, calibrations, &choice);
        let schema = batch.schema();
        let mut fields: Vec<Arc<Field>> = schema.fields().iter().cloned().collect();
        let mut columns = batch.columns().to_vec();
        let geographic = match calibrations.tangent_plane {
            _ if !self.is_geographic && self.grid.is_none() => Vec::new(),
            Some(plane) => self.geographic_columns(&mapped, &plane, calibrations.georeference.as_ref()),
            None => return Err(self.no_georeference_error()),
        };
        for (name, column) in mapped.columns(self.to, &calibrations.planes).into_iter().chain(geographic) {
            let field = Arc::new(Field::new(name, column.data_type().clone(), true));
            match schema.index_of(name) {
                Ok(_) if !self.replaces => return Err(self.existing_column_error(batch, name)),
                Ok(index) => (fields[index], columns[index]) = (field, column),
                Err(_) => {
                    fields.push(field);
                    columns.push(column);
                }
            }
        }
        let schema = Schema::new(fields).with_metadata(calibrations.describe(&schema));
        let options = RecordBatchOptions::new().with_row_count(Some(batch.num_rows()));
        Ok(RecordBatch::try_new_with_options(Arc::new(schema), columns, &options)?)
    }

    fn no_georeference_error(&self) -> TableError {
        TableError::Usage(format!(
            "{}: the site has no georeference; add \"georeference\" with lat_deg, lon_deg and x_axis_azimuth_deg, or \
             two control points with lat_deg and lon_deg",
            self.bad.wording().name(if self.is_geographic { "geographic" } else { "crs" })
        ))
    }

    /// Returns latitude and longitude, in degrees, and east and north in the grid. If uncertainties are computed,
    /// also returns the standard deviations toward east and north, in metres: from the pixel noise, and from the
    /// calibration with the georeference.
    fn geographic_columns(
        &self,
        mapped: &MappedPoints,
        plane: &TangentPlane,
        georeference: Option<&GeoreferenceSolution>,
    ) -> Vec<(&'static str, ArrayRef)> {
        let points: Vec<Option<Geographic>> = mapped.geographic_points(plane, self.height).collect();
        let mut columns = Vec::new();
        let mut add = |names: [&'static str; 2], values: Vec<[f64; 2]>| {
            let (a, b): (Vec<f64>, Vec<f64>) = values.into_iter().map(<(f64, f64)>::from).unzip();
            columns.extend(names.into_iter().zip([nan_to_null(a), nan_to_null(b)]));
        };
        if self.is_geographic {
            let degrees = |at: Geographic| [at.latitude.to_degrees(), at.longitude.to_degrees()];
            let rows = points.iter().map(|at| at.map_or([f64::NAN; 2], degrees));
            add(["lat_deg", "lon_deg"], rows.collect());
        }
        if let Some(grid) = &self.grid {
            let east_north = |at: &Option<Geographic>| at.and_then(|at| grid.from_geographic(at));
            let rows = points.iter().map(|at| east_north(at).unwrap_or([f64::NAN; 2]));
            add(["easting", "northing"], rows.collect());
        }
        for (part, names) in GEOGRAPHIC_SIGMA_COLUMNS.into_iter().enumerate() {
            let Some(Sigmas(values)) = &mapped.sigmas else { break };
            let [x, y, rho] = [0, 1, 2].map(|index| &values[3 * part + index]);
            let of = |row: usize| {
                let own = plane.east_north_sigmas([x[row], y[row], rho[row]]);
                let at = FloorPoint { x: mapped.x[row], y: mapped.y[row] };
                match georeference.filter(|_| part == 1) {
                    Some(estimated) => {
                        let [[east, _], [_, north]] = estimated.covariance_at(at);
                        [own[0].hypot(east.max(0.0).sqrt()), own[1].hypot(north.max(0.0).sqrt())]
                    }
                    None => own,
                }
            };
            add(names, (0..x.len()).map(of).collect());
        }
        columns
    }

    fn existing_column_error(&self, batch: &RecordBatch, name: &str) -> TableError {
        TableError::Invalid(format!(
            "the table already has a column {name} (columns: \"{}\"); use {} to replace it, or rename it",
            names(batch),
            self.bad.wording().name("replace")
        ))
    }

    /// Reads the input points: pixels of the stream, or 3D points.
    fn points(
        &self,
        batch: &RecordBatch,
        calibrations: &Calibrations,
        row_name: RowName<'_>,
    ) -> Result<Points, TableError> {
        let schema = batch.schema();
        let has = |name: &str| schema.fields().iter().any(|field| field.name().eq_ignore_ascii_case(name));
        if self.to == To::Pixel {
            let [a, b] = numbers(batch, ["x_m", "y_m"], "x_m,y_m,z_m", row_name, &self.bad)?;
            let c = if has("z_m") {
                let [c] = numbers(batch, ["z_m"], "z_m", row_name, &self.bad)?;
                c
            } else {
                vec![self.height; a.len()]
            };
            return Ok(Points { a, b, c, are_fractions: false });
        }
        let columns = match self.columns {
            Columns::Points => None,
            Columns::Auto if has("u") && has("v") && !self.boxes.is_stated() => None,
            Columns::Auto | Columns::Boxes => self.boxes.columns(batch),
        };
        if let Some(columns) = columns {
            return self.feet(batch, &columns, calibrations, row_name);
        }
        let [a, b] = self.pixels(batch, row_name)?;
        Ok(Points { a, b, c: Vec::new(), are_fractions: false })
    }

    fn pixels(&self, batch: &RecordBatch, row_name: RowName<'_>) -> Result<[Vec<f64>; 2], TableError> {
        let (names, expected) = match self.columns {
            Columns::Points => (["u", "v"], "u,v"),
            Columns::Boxes => (["x", "y"], BOXES),
            Columns::Auto if self.boxes.is_stated() => (["x", "y"], BOXES),
            Columns::Auto => (["u", "v"], FEET_OR_BOXES),
        };
        if names == ["u", "v"] {
            return numbers(batch, names, expected, row_name, &self.bad);
        }
        // The columns of boxes are incomplete: `numbers` reports the missing ones.
        numbers(batch, ["x", "y", "w", "h"], expected, row_name, &self.bad).map(|[x, y, _, _]| [x, y])
    }

    /// Reads boxes, and returns their foot points u, v: the middles of the lower edges.
    fn feet(
        &self,
        batch: &RecordBatch,
        columns: &BoxColumns,
        calibrations: &Calibrations,
        row_name: RowName<'_>,
    ) -> Result<Points, TableError> {
        let BoxValues { form, values, are_fractions } =
            self.boxes.read(batch, columns, calibrations, (row_name, &self.bad))?;
        let [mut a, mut b, c, d] = values;
        for row in 0..a.len() {
            [a[row], b[row]] = form.foot([a[row], b[row], c[row], d[row]]);
        }
        Ok(Points { a, b, c: Vec::new(), are_fractions })
    }
}

/// Input points, column by column: u, v in pixels of the stream, or x, y, z in metres; NaN for missing
/// values.
struct Points {
    a: Vec<f64>,
    b: Vec<f64>,
    /// Heights z of 3D points, in metres; empty for pixels.
    c: Vec<f64>,
    /// Whether pixels are given as fractions of the stream's width and height.
    are_fractions: bool,
}

/// Mapped points, column by column: x, y in metres, or u, v in pixels, and statuses.
pub(crate) struct MappedPoints {
    pub(crate) x: Vec<f64>,
    pub(crate) y: Vec<f64>,
    pub(crate) status: Vec<Status>,
    pub(crate) sigmas: Option<Sigmas>,
    /// Points on planes, for a site with planes other than the floor.
    pub(crate) plane_points: Option<PlanePoints>,
}

impl Points {
    fn mapped(&self, mapping: &Mapping, calibrations: &Calibrations, choice: &Choice) -> MappedPoints {
        let chosen = match choice {
            Choice::All(index) => {
                return self.map(mapping, &calibrations.list[*index as usize], &calibrations.planes);
            }
            Choice::Rows(chosen) => chosen,
        };
        let on_planes = mapping.to == To::Floor && !calibrations.planes.ids.is_empty();
        let mut all = MappedPoints::uncalibrated(self.a.len(), mapping.sigma.is_some(), on_planes);
        let mut of_each = vec![Vec::new(); calibrations.list.len() + 1];
        for (row, &index) in chosen.iter().enumerate() {
            of_each[index as usize].push(row);
        }
        let used = calibrations.list.iter().zip(&of_each).filter(|(_, rows)| !rows.is_empty());
        for (calibration, rows) in used {
            all.put(rows, &self.select_rows(rows).map(mapping, calibration, &calibrations.planes));
        }
        all
    }

    fn select_rows(&self, rows: &[usize]) -> Self {
        let pick = |values: &[f64]| match values {
            [] => Vec::new(),
            _ => rows.iter().map(|&row| values[row]).collect(),
        };
        Self { a: pick(&self.a), b: pick(&self.b), c: pick(&self.c), are_fractions: self.are_fractions }
    }

    /// Maps all points with one calibration.
    fn map(&self, mapping: &Mapping, calibration: &Calibration, planes: &Planes) -> MappedPoints {
        match mapping.to {
            To::Floor => self.to_floor(mapping, calibration, planes),
            To::Pixel => self.to_pixels(calibration),
        }
    }

    fn to_floor(&self, mapping: &Mapping, calibration: &Calibration, planes: &Planes) -> MappedPoints {
        let stream = calibration.stream;
        let in_still = |axis, values: &[f64]| -> Vec<f64> {
            let size = calibration.stream_size[axis];
            let to_image = |&value: &f64| match self.are_fractions {
                true => stream.corner_to_image(axis, size * value),
                false => stream.to_image(axis, value),
            };
            values.iter().map(to_image).collect()
        };
        let scaled = (self.are_fractions || stream != StreamMap::STILL)
            .then(|| [in_still(0, &self.a), in_still(1, &self.b)]);
        let [u, v] = scaled.as_ref().map_or([&self.a, &self.b], |[u, v]| [u, v]);
        if !planes.ids.is_empty() {
            return PlanePoints::map(calibration, planes, [u, v], mapping.height, mapping.sigma);
        }
        let mut mapped = MappedPoints::uncalibrated(self.a.len(), false, false);
        let MappedPoints { x, y, status, .. } = &mut mapped;
        calibration.projector.pixels_to_floor_within(&calibration.extent(), [u, v], [x, y], status);
        let camera = calibration.projector.camera();
        mapped.sigmas = mapping.sigma.map(|sigma| {
            Sigmas::from_pixels(calibration, [u, v], sigma, |_, pixel, sigma| {
                camera.plane_covariance(pixel, sigma, mapping.height)
            })
        });
        mapped
    }

    fn to_pixels(&self, calibration: &Calibration) -> MappedPoints {
        let mut mapped = MappedPoints::uncalibrated(self.a.len(), false, false);
        let extent = calibration.extent();
        for i in 0..self.a.len() {
            let point = WorldPoint { x: self.a[i], y: self.b[i], z: self.c[i] };
            let (pixel, status) = extent.to_pixel(calibration.projector.camera(), point);
            mapped.status[i] = status;
            if let Some(Pixel { u, v }) = pixel {
                mapped.x[i] = calibration.stream.to_stream(0, u);
                mapped.y[i] = calibration.stream.to_stream(1, v);
            }
        }
        mapped
    }
}

impl MappedPoints {
    /// Creates results for rows without a calibration: no points, with the status no-calibration.
    pub(crate) fn uncalibrated(rows: usize, with_sigmas: bool, on_planes: bool) -> Self {
        let nothing = || vec![f64::NAN; rows];
        let sigmas = with_sigmas.then(|| Sigmas::unknown(rows));
        let plane_points = on_planes.then(|| PlanePoints::missing(rows));
        Self { x: nothing(), y: nothing(), status: vec![Status::NoCalibration; rows], sigmas, plane_points }
    }

    /// Copies mapped values into a subset of the rows. `rows` contains the row index of each value in `some`.
    fn put(&mut self, rows: &[usize], some: &Self) {
        for (i, &row) in rows.iter().enumerate() {
            (self.x[row], self.y[row], self.status[row]) = (some.x[i], some.y[i], some.status[i]);
        }
        if let (Some(all), Some(some)) = (&mut self.sigmas, &some.sigmas) {
            all.put(rows, some);
        }
        if let (Some(all), Some(some)) = (&mut self.plane_points, &some.plane_points) {
            all.put(rows, some);
        }
    }

    /// Returns the geographic coordinates of the points; `None` for a row without a point. `height` is the height of
    /// all points if the site has no planes, in metres.
    fn geographic_points(
        &self,
        plane: &TangentPlane,
        height: f64,
    ) -> impl Iterator<Item = Option<Geographic>> {
        let height_of = move |row: usize| match &self.plane_points {
            Some(points) => points.0[row].map_or(height, |point| point.at.z),
            None => height,
        };
        (0..self.x.len()).map(move |row| {
            let point = WorldPoint { x: self.x[row], y: self.y[row], z: height_of(row) };
            point.is_finite().then(|| plane.to_geographic(point))
        })
    }

    /// Returns the output columns with their names.
    fn columns(self, to: To, planes: &Planes) -> Vec<(&'static str, ArrayRef)> {
        let [x, y] = match to {
            To::Floor => ["x_m", "y_m"],
            To::Pixel => ["u", "v"],
        };
        let status = ("status", status_names(&self.status));
        let sigmas = self.sigmas.into_iter().flat_map(Sigmas::columns);
        let sigmas = sigmas.map(|(name, values)| (name, nan_to_null(values)));
        let on_planes = self.plane_points.into_iter().flat_map(|on| on.columns(planes));
        [(x, nan_to_null(self.x)), (y, nan_to_null(self.y)), status]
            .into_iter()
            .chain(on_planes)
            .chain(sigmas)
            .collect()
    }
}

/// Converts NaN to null.
fn nan_to_null(values: Vec<f64>) -> ArrayRef {
    if values.iter().all(|value| !value.is_nan()) {
        return Arc::new(Float64Array::from(values));
    }
    Arc::new(values.into_iter().map(|value| (!value.is_nan()).then_some(value)).collect::<Float64Array>())
}

fn status_names(status: &[Status]) -> ArrayRef {
    let mut names = StringBuilder::with_capacity(status.len(), 4 * status.len());
    status.iter().for_each(|status| names.append_value(status.name()));
    Arc::new(names.finish())
}
