//! A scalar function of DataFusion that maps pixels of calibrated cameras to the floor.
//!
//! ```no_run
//! use calib_core::Site;
//! use calib_datafusion::calib_floor;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let site = Site::from_json(&std::fs::read_to_string("solved.json")?)?;
//! let function = calib_floor(&site)?;
//! // context.register_udf(function);
//! // SELECT id, calib_floor(camera_id, u, v)['x_m'] FROM detections
//! # Ok(())
//! # }
//! ```
//!
//! `calib_floor(camera_id, u, v)` is a struct of `x_m`, `y_m` and `status`, as of `calib project`, of a site whose
//! planes have regions also of `z_m` and `plane`; pixels count from the corner of the image. It is an expression like any other: DataFusion runs it on all of
//! its threads, and a program that embeds a distributed DataFusion registers it in every worker.

use std::collections::HashMap;
use std::hash::{Hash, Hasher};
use std::sync::Arc;

use calib_core::{Camera, Extent, FloorPoint, Site, Status, Surface, SurfacePoint, SurfaceProjector};
use datafusion_common::arrow::array::{
    Array, ArrayRef, AsArray as _, Float64Array, StringArray, StructArray,
};
use datafusion_common::arrow::datatypes::{DataType, Field, Fields, Float64Type};
use datafusion_common::{Result, exec_err};
use datafusion_expr::{ColumnarValue, ScalarFunctionArgs, ScalarUDF, ScalarUDFImpl, Signature, Volatility};

/// A calibrated camera.
#[derive(Debug)]
struct Calibrated {
    camera: Camera,
    size: [f64; 2],
    efov: Vec<FloorPoint>,
}

#[derive(Debug)]
struct FloorOf {
    signature: Signature,
    cameras: HashMap<String, Calibrated>,
    /// The planes besides the floor with their ids; none where none of them covers a part of the plan.
    surfaces: Vec<Surface>,
    planes: Vec<String>,
    /// The site, by which two of these are told apart.
    site: String,
}

/// The function of the cameras of a site.
///
/// # Errors
/// When an id has several periods of validity: leave out those that do not hold.
pub fn calib_floor(site: &Site) -> Result<ScalarUDF> {
    let mut cameras = HashMap::new();
    for entry in &site.cameras {
        let Some(camera) = entry.camera() else { continue };
        let calibrated = Calibrated { camera, size: entry.size(), efov: site.efov_on_floor(entry) };
        if cameras.insert(entry.id.clone(), calibrated).is_some() {
            return exec_err!("camera {:?} has several periods", entry.id);
        }
    }
    let kinds = vec![DataType::Utf8, DataType::Float64, DataType::Float64];
    let signature = Signature::exact(kinds, Volatility::Immutable);
    let surfaces = site.covering_surfaces();
    let planes = site.planes.iter().map(|plane| plane.id.clone()).take(surfaces.len()).collect();
    Ok(ScalarUDF::from(FloorOf { signature, cameras, surfaces, planes, site: site.to_json() }))
}

impl PartialEq for FloorOf {
    fn eq(&self, other: &Self) -> bool {
        self.site == other.site
    }
}

impl Eq for FloorOf {}

impl Hash for FloorOf {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.site.hash(state);
    }
}

fn fields(with_planes: bool) -> Fields {
    let mut fields = vec![
        Field::new("x_m", DataType::Float64, true),
        Field::new("y_m", DataType::Float64, true),
        Field::new("status", DataType::Utf8, false),
    ];
    if with_planes {
        fields.push(Field::new("z_m", DataType::Float64, true));
        fields.push(Field::new("plane", DataType::Utf8, true));
    }
    Fields::from(fields)
}

impl FloorOf {
    fn fields(&self) -> Fields {
        fields(!self.surfaces.is_empty())
    }

    /// Maps rows of one camera.
    fn map(
        &self,
        camera: &Calibrated,
        [u, v]: [&[f64]; 2],
        points: &mut [Option<SurfacePoint>],
        status: &mut [Status],
    ) {
        let extent = Extent { size: camera.size, efov: &camera.efov };
        let projector = SurfaceProjector::new(&camera.camera, 0.0, &self.surfaces);
        projector.pixels_to_surfaces(&extent, [u, v], points, status);
    }

    /// The height of every point, and the plane that it is on.
    fn on_planes(&self, points: &[Option<SurfacePoint>]) -> [ArrayRef; 2] {
        let heights: Float64Array = points.iter().map(|point| point.map(|point| point.at.z)).collect();
        let plane = |point: &Option<SurfacePoint>| self.planes.get(point.as_ref()?.surface?);
        let planes: StringArray = points.iter().map(plane).collect();
        [Arc::new(heights), Arc::new(planes)]
    }
}

impl ScalarUDFImpl for FloorOf {
    fn name(&self) -> &str {
        "calib_floor"
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn return_type(&self, _arguments: &[DataType]) -> Result<DataType> {
        Ok(DataType::Struct(self.fields()))
    }

    fn invoke_with_args(&self, arguments: ScalarFunctionArgs) -> Result<ColumnarValue> {
        let arrays = ColumnarValue::values_to_arrays(&arguments.args)?;
        let [ids, u, v] = &arrays[..] else { return exec_err!("calib_floor takes camera_id, u and v") };
        let (u, v) = (numbers(u), numbers(v));
        let ids = ids.as_string::<i32>();
        let mut points = vec![None; u.len()];
        let mut status = vec![Status::NoCalibration; u.len()];
        // Rows of one camera that follow each other are mapped at once.
        let mut first = 0;
        while first < u.len() {
            let id = ids.is_valid(first).then(|| ids.value(first));
            let same =
                |&row: &usize| ids.is_valid(row) == id.is_some() && id.is_none_or(|id| ids.value(row) == id);
            let end = first + (first..u.len()).take_while(same).count();
            if let Some(camera) = id.and_then(|id| self.cameras.get(id)) {
                let run = first..end;
                let pixels = [&u[run.clone()], &v[run.clone()]];
                self.map(camera, pixels, &mut points[run.clone()], &mut status[run]);
            }
            first = end;
        }
        let of = |value: fn(SurfacePoint) -> f64| -> ArrayRef {
            Arc::new(points.iter().map(|point| point.map(value)).collect::<Float64Array>())
        };
        let names: StringArray = status.iter().map(|status| Some(status.name())).collect();
        let mut columns = vec![of(|point| point.at.x), of(|point| point.at.y), Arc::new(names) as ArrayRef];
        if !self.surfaces.is_empty() {
            columns.extend(self.on_planes(&points));
        }
        Ok(ColumnarValue::Array(Arc::new(StructArray::try_new(self.fields(), columns, None)?)))
    }
}

/// NaN where there is none.
fn numbers(column: &ArrayRef) -> Vec<f64> {
    column.as_primitive::<Float64Type>().iter().map(|value| value.unwrap_or(f64::NAN)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::Pixel;
    use datafusion_common::config::ConfigOptions;

    fn site() -> Site {
        let camera = |id: &str, yaw: f64, lens: &str| {
            format!(
                r#"{{"id": "{id}", "size_px": [1920, 1080], "solution": {{"method": "given", "stage": "placed",
                "position_m": [1.2, -0.4, 4.5], "yaw_deg": {yaw}, "pitch_deg": 31, "roll_deg": -1.5,
                "focal_px": 1486.2, "principal_point_px": [960, 540]{lens}}}}}"#
            )
        };
        let bent =
            r#", "distortion": {"model": "brown-conrady", "k1": -0.3, "k2": 0.1, "k3": 0, "p1": 0, "p2": 0}"#;
        let cameras = [camera("door", 12.0, bent), camera("till", 80.0, "")].join(",");
        Site::from_json(&format!(r#"{{"format": "calib-site", "version": 1, "cameras": [{cameras}]}}"#))
            .unwrap()
    }

    #[test]
    fn every_row_is_mapped_by_its_camera() {
        let site = site();
        let function = calib_floor(&site).unwrap();
        let rows = 1000;
        let ids: StringArray = (0..rows)
            .map(|i| [Some("door"), Some("door"), Some("till"), None, Some("nobody")][i % 5])
            .collect();
        let u: Float64Array = (0..rows).map(|i| (i % 7 != 0).then(|| i as f64 * 1.9)).collect();
        let v: Float64Array = (0..rows).map(|i| Some(1300.0 - 1.5 * i as f64)).collect();
        let arrays: [ArrayRef; 3] = [Arc::new(ids), Arc::new(u.clone()), Arc::new(v.clone())];
        let arguments = ScalarFunctionArgs {
            args: arrays.iter().map(|array| ColumnarValue::Array(Arc::clone(array))).collect(),
            arg_fields: arrays
                .iter()
                .map(|a| Arc::new(Field::new("a", a.data_type().clone(), true)))
                .collect(),
            number_rows: rows,
            return_field: Arc::new(Field::new("floor", DataType::Struct(fields(false)), true)),
            config_options: Arc::new(ConfigOptions::default()),
        };
        let ColumnarValue::Array(found) = function.invoke_with_args(arguments).unwrap() else {
            panic!("an array")
        };
        let found = found.as_struct();
        let (x, status) = (found.column(0).as_primitive::<Float64Type>(), found.column(2).as_string::<i32>());
        let mut mapped = 0;
        for row in 0..rows {
            let camera = match row % 5 {
                0 | 1 => site.camera("door"),
                2 => site.camera("till"),
                _ => None,
            };
            let Some(camera) = camera.and_then(|entry| entry.camera()) else {
                assert_eq!((x.is_null(row), status.value(row)), (true, "no-calibration"));
                continue;
            };
            let floor = u.is_valid(row).then(|| Pixel::new(u.value(row), v.value(row)));
            match floor.and_then(|pixel| camera.pixel_to_floor(pixel, 0.0)) {
                Some(floor) => {
                    mapped += 1;
                    assert!((floor.x - x.value(row)).abs() < 1e-8 * (1.0 + floor.x.abs().powi(2)), "{row}");
                }
                None => assert!(x.is_null(row) && status.value(row) != "ok"),
            }
        }
        assert!(mapped > 200, "{mapped}");
    }

    #[test]
    fn planes_have_fields_of_their_own() {
        let mut site = site();
        let platform =
            r#"[{"id": "deck", "height_m": 0.5, "region": [[-9, -9], [9, -9], [9, 19], [-9, 19]]}]"#;
        site.planes = serde_json::from_str(platform).unwrap();
        let function = calib_floor(&site).unwrap();
        let kind = function.return_type(&[]).unwrap();
        assert_eq!(kind, DataType::Struct(fields(true)));
        let arrays: [ArrayRef; 3] = [
            Arc::new(StringArray::from(vec!["till", "nobody"])),
            Arc::new(Float64Array::from(vec![960.0, 960.0])),
            Arc::new(Float64Array::from(vec![700.0, 700.0])),
        ];
        let arguments = ScalarFunctionArgs {
            args: arrays.iter().map(|array| ColumnarValue::Array(Arc::clone(array))).collect(),
            arg_fields: arrays
                .iter()
                .map(|a| Arc::new(Field::new("a", a.data_type().clone(), true)))
                .collect(),
            number_rows: 2,
            return_field: Arc::new(Field::new("floor", kind, true)),
            config_options: Arc::new(ConfigOptions::default()),
        };
        let ColumnarValue::Array(found) = function.invoke_with_args(arguments).unwrap() else {
            panic!("an array")
        };
        let found = found.as_struct();
        let (heights, planes) =
            (found.column(3).as_primitive::<Float64Type>(), found.column(4).as_string::<i32>());
        assert!((heights.value(0) - 0.5).abs() < 1e-12 && planes.value(0) == "deck");
        assert!(heights.is_null(1) && planes.is_null(1));
    }

    #[test]
    fn functions_of_different_sites_differ() {
        let (one, mut other) = (site(), site());
        other.cameras.pop();
        assert!(calib_floor(&one).unwrap() == calib_floor(&one).unwrap());
        assert!(calib_floor(&one).unwrap() != calib_floor(&other).unwrap());
        other.cameras.push(other.cameras[0].clone());
        assert!(calib_floor(&other).is_err());
    }
}
