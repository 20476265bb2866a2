//! Registry of the formats and their properties.

use calib_core::DistortionModel;

use crate::export::{Export, Scene};
use crate::file::FormatError;
use crate::given::Imported;
use crate::input::Input;
use crate::planes::PlaneTreatment;
use crate::{
    basalt, blender, caliscope, camodocal, colmap, frigate, fspy, geojson, ground_points, kalibr, matlab,
    metashape, nerfstudio, nvdsanalytics, nvidia, ocamcalib, opencv, opensfm, ros, scenescape, sql, svg,
    table, wildtrack, worldfile,
};

type Write = fn(&Scene, &mut Export);
type Read = fn(&Input) -> Result<Imported, FormatError>;

/// Calibration format of another program.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    /// Name of the format on the command line.
    pub name: &'static str,
    /// Program or purpose that the format is for.
    pub about: &'static str,
    /// File extensions, without the dot; the first is the default.
    pub extensions: &'static [&'static str],
    /// Data of a calibrated camera that the format contains.
    pub contains: &'static str,
    /// Data that the format does not contain.
    pub lacks: &'static str,
    /// Treatment of planes other than the floor.
    pub planes: PlaneTreatment,
    /// Lens models that are written exactly. Other models are approximated by Brown-Conrady terms, or lost.
    /// The writer passes the models to `Export::terms`, which reports the loss. A format without distortion calls
    /// `Export::report_distortion`.
    pub lenses: &'static [DistortionModel],
    /// Whether the format contains camera positions. If so, an export reports every camera that was not placed.
    pub has_positions: bool,
    /// Whether the format is written for a camera without a pose if its lens is known.
    pub writes_lenses: bool,
    /// Whether the format needs the georeference of the site.
    pub needs_georeference: bool,
    /// Whether the format distinguishes the periods of a camera.
    pub has_periods: bool,
    /// Whether the format contains the plan, so that [`ExportOptions::plan`](crate::ExportOptions::plan) is
    /// needed.
    pub shows_plan: bool,
    /// Whether the format is a table, whose JSON can be converted to Parquet by programs that support it.
    pub is_table: bool,
    /// Whether the format describes the scale and position of the plan instead of cameras.
    pub describes_plan: bool,
    /// File names that identify one calibration: opening one of these files also opens the others in its
    /// folder.
    pub companions: &'static [&'static str],
    /// Whether programs that read the format find the file of a camera by the camera's id.
    pub names_files_by_id: bool,
    /// Pixel origin: the corner of the image, or the centre of the first pixel.
    pub pixels: &'static str,
    /// Units of length and angle.
    pub units: &'static str,
    /// Usual unit of imported poses, in metres; `None` if an import reads no poses.
    pub unit_m: Option<f64>,
    /// Axes, and the direction of the poses (world to camera or camera to world).
    pub axes: &'static str,
    /// Data in files of the format that an import ignores.
    pub ignored_by_import: &'static str,
    pub(crate) write: Option<Write>,
    pub(crate) read: Option<Read>,
}

impl Format {
    /// Default values of the entries of [`FORMATS`]: a format with camera poses but no lenses, and
    /// without export or import.
    const PLAIN: Self = Self {
        name: "",
        about: "",
        extensions: &[],
        contains: "",
        lacks: USUALLY_LACKING,
        planes: PlaneTreatment::LeftOut,
        lenses: &[],
        has_positions: true,
        writes_lenses: false,
        needs_georeference: false,
        has_periods: false,
        shows_plan: false,
        is_table: false,
        describes_plan: false,
        companions: &[],
        names_files_by_id: false,
        pixels: CORNER,
        units: "m",
        unit_m: None,
        axes: "",
        ignored_by_import: "",
        write: None,
        read: None,
    };

    /// Whether the format can be exported.
    #[must_use]
    pub const fn can_export(&self) -> bool {
        self.write.is_some()
    }

    /// Whether the format can be imported.
    #[must_use]
    pub const fn can_import(&self) -> bool {
        self.read.is_some()
    }
}

/// Pixel origin at the corner of the image, as in this library: the centre of the first pixel is (0.5, 0.5).
const CORNER: &str = "corner";
/// Pixel origin at the centre of the first pixel: our coordinates minus 0.5.
const CENTRE: &str = "centre of the first pixel";
/// Pixel origin one pixel before the centre of the first pixel: our coordinates plus 0.5.
const CENTRE_ONE: &str = "centre of the first pixel is (1, 1)";
/// Axes and pose direction of `OpenCV`.
const OPENCV: &str = "world z up; camera right, down, forward; world to camera";
/// Axes and pose direction of OpenGL.
const OPENGL: &str = "world z up; camera right, up, back; camera to world";
/// Data that most formats lack.
const USUALLY_LACKING: &str = "standard deviations, EFOV, planes other than the floor";
/// Lens models that most programs support.
const RADIAL_OR_FISHEYE: &[DistortionModel] =
    &[DistortionModel::BrownConrady, DistortionModel::KannalaBrandt];

/// Lens models of `OpenCV`.
const OPENCV_LENSES: &[DistortionModel] =
    &[DistortionModel::BrownConrady, DistortionModel::KannalaBrandt, DistortionModel::Rational];

/// All formats.
pub const FORMATS: &[Format] = &[
    Format {
        name: "opencv",
        about: "OpenCV FileStorage, one file per camera",
        extensions: &["json", "yml", "yaml", "xml"],
        contains: "lens (Brown-Conrady, fisheye or rational), pose",
        lenses: OPENCV_LENSES,
        writes_lenses: true,
        write: Some(opencv::write),
        read: Some(opencv::read),
        unit_m: Some(1.0),
        pixels: CENTRE,
        units: "m, rad",
        axes: OPENCV,
        ignored_by_import: "reprojection errors, covariances, poses of the board except the first",
        ..Format::PLAIN
    },
    Format {
        name: "ros",
        about: "ROS camera_info, one file per camera",
        extensions: &["yaml", "yml"],
        contains: "lens (plumb_bob, equidistant or rational_polynomial)",
        lacks: "pose, standard deviations, EFOV, planes other than the floor",
        lenses: OPENCV_LENSES,
        has_positions: false,
        writes_lenses: true,
        write: Some(ros::write),
        read: Some(ros::read),
        pixels: CENTRE,
        units: "-",
        axes: "-",
        ignored_by_import: "rectification (R, P), binning, region of interest",
        ..Format::PLAIN
    },
    Format {
        name: "colmap",
        about: "COLMAP model as text or binary: cameras, images; or cameras alone",
        extensions: &["txt", "bin"],
        contains: "lens (Brown-Conrady, rational or fisheye), pose",
        lenses: OPENCV_LENSES,
        companions: &["cameras.txt", "images.txt", "cameras.bin", "images.bin"],
        writes_lenses: true,
        write: Some(colmap::write),
        read: Some(colmap::read),
        unit_m: Some(1.0),
        axes: OPENCV,
        ignored_by_import: "points (points3D.txt) and the points of images",
        ..Format::PLAIN
    },
    Format {
        name: "nerfstudio",
        about: "nerfstudio transforms.json",
        extensions: &["json"],
        contains: "lens (Brown-Conrady or fisheye), pose",
        lenses: RADIAL_OR_FISHEYE,
        write: Some(nerfstudio::write),
        read: Some(nerfstudio::read),
        unit_m: Some(1.0),
        axes: OPENGL,
        ignored_by_import: "points, masks, depths, applied transforms",
        ..Format::PLAIN
    },
    Format {
        name: "nvidia",
        about: "NVIDIA DeepStream and Metropolis: camInfo, calibration.json, transforms.yml, map.png",
        extensions: &["json", "yml"],
        contains: "pinhole, pose, EFOV, plan",
        lacks: "distortion, standard deviations, planes other than the floor",
        shows_plan: true,
        planes: PlaneTreatment::Misleading,
        write: Some(nvidia::write),
        read: Some(nvidia::read),
        unit_m: Some(1.0),
        axes: OPENCV,
        ignored_by_import: "regions, tripwires, polygons of the field of view, places, frame rates, the map (transforms.yml, map.png)",
        names_files_by_id: true,
        ..Format::PLAIN
    },
    Format {
        name: "scenescape",
        about: "Intel SceneScape cameras (JSON)",
        extensions: &["json"],
        contains: "lens (Brown-Conrady), pose",
        lenses: &[DistortionModel::BrownConrady],
        write: Some(scenescape::write),
        pixels: CENTRE,
        axes: "world z up; camera right, down, forward; camera to world, quaternion w last",
        ..Format::PLAIN
    },
    Format {
        name: "wildtrack",
        about: "WILDTRACK calibrations (XML), centimetres",
        extensions: &["xml"],
        contains: "pinhole, pose",
        lacks: "distortion, standard deviations, EFOV, planes other than the floor",
        write: Some(wildtrack::write),
        read: Some(wildtrack::read),
        unit_m: Some(0.01),
        pixels: CENTRE,
        units: "cm, rad",
        axes: OPENCV,
        ..Format::PLAIN
    },
    Format {
        name: "table",
        about: "table with one row of matrices for each camera",
        extensions: &["json", "csv"],
        contains: "everything except standard deviations",
        lacks: "standard deviations",
        lenses: &[
            DistortionModel::BrownConrady,
            DistortionModel::Division,
            DistortionModel::KannalaBrandt,
            DistortionModel::Unified,
            DistortionModel::DoubleSphere,
            DistortionModel::Eucm,
            DistortionModel::Rational,
        ],
        has_periods: true,
        is_table: true,
        planes: PlaneTreatment::Written,
        write: Some(table::write),
        axes: OPENCV,
        ..Format::PLAIN
    },
    Format {
        name: "sql",
        about: "SQL views that map detections to the floor",
        extensions: &["sql"],
        contains: "lens (exact without distortion and for the division model, otherwise fitted), floor homography, periods",
        lacks: "EFOV, heights above the floor, planes other than the floor, standard deviations",
        lenses: &[DistortionModel::Division],
        has_periods: true,
        planes: PlaneTreatment::Misleading,
        write: Some(sql::write),
        axes: "floor x, y",
        ..Format::PLAIN
    },
    Format {
        name: "geojson",
        about: "GeoJSON of EFOVs, cameras and planes; *.local.geojson in metres without a georeference; imports points",
        extensions: &["geojson"],
        contains: "position and heading (on the map with standard deviations), EFOV, planes other than the floor",
        lacks: "lens, orientation",
        planes: PlaneTreatment::Written,
        write: Some(geojson::write),
        read: Some(ground_points::read_geojson),
        units: "degrees of WGS84, or m; degrees",
        axes: "longitude, latitude, or floor x, y; azimuth_deg clockwise from north, heading_deg counter-clockwise from +x",
        ignored_by_import: "lines, polygons, altitudes",
        ..Format::PLAIN
    },
    Format {
        name: "kml",
        about: "KML of cameras and EFOVs for maps; imports points",
        extensions: &["kml"],
        contains: "position, heading, EFOV",
        lacks: "lens, orientation, standard deviations, planes other than the floor",
        needs_georeference: true,
        write: Some(ground_points::write_kml),
        read: Some(ground_points::read_kml),
        units: "degrees of WGS84; m",
        axes: "longitude, latitude; azimuth clockwise from north",
        ignored_by_import: "lines, polygons, images, altitudes",
        ..Format::PLAIN
    },
    Format {
        name: "gpx",
        about: "GPX of cameras for navigation; imports waypoints",
        extensions: &["gpx"],
        contains: "position, heading",
        lacks: "lens, orientation, EFOV, standard deviations, planes other than the floor",
        needs_georeference: true,
        write: Some(ground_points::write_gpx),
        read: Some(ground_points::read_gpx),
        units: "degrees of WGS84; m",
        axes: "latitude, longitude; azimuth clockwise from north",
        ignored_by_import: "tracks, routes, altitudes",
        ..Format::PLAIN
    },
    Format {
        name: "points",
        about: "table of surveyed points: name, and lat_deg, lon_deg or easting, northing or x_m, y_m",
        extensions: &["csv", "tsv", "txt"],
        contains: "points",
        lacks: "cameras",
        has_positions: false,
        read: Some(ground_points::read_table),
        units: "degrees of WGS84, or the unit of the grid; m",
        axes: "latitude, longitude, or east, north, or floor x, y",
        ignored_by_import: "other columns",
        ..Format::PLAIN
    },
    Format {
        name: "svg",
        about: "image of the plan and the EFOVs",
        extensions: &["svg"],
        contains: "position, heading, EFOV",
        lacks: "lens, orientation, standard deviations, planes other than the floor",
        shows_plan: true,
        write: Some(svg::write),
        units: "pixels of the plan, or cm",
        axes: "x right, y down",
        ..Format::PLAIN
    },
    Format {
        name: "frigate",
        about: "Frigate zones with distances for speeds",
        extensions: &["yml", "yaml"],
        contains: "EFOV",
        lacks: "lens, pose, standard deviations, planes other than the floor",
        has_positions: false,
        write: Some(frigate::write),
        units: "fractions of the image; m",
        axes: "x right, y down",
        ..Format::PLAIN
    },
    Format {
        name: "nvdsanalytics",
        about: "DeepStream nvdsanalytics regions of interest",
        extensions: &["txt", "ini"],
        contains: "EFOV",
        lacks: "lens, pose, standard deviations, planes other than the floor",
        has_positions: false,
        write: Some(nvdsanalytics::write),
        units: "whole pixels",
        axes: "x right, y down",
        ..Format::PLAIN
    },
    Format {
        name: "blender",
        about: "Blender script that creates the cameras",
        extensions: &["py"],
        contains: "pinhole, pose",
        lacks: "distortion, standard deviations, EFOV, planes other than the floor",
        write: Some(blender::write),
        units: "m; sensor in mm",
        axes: OPENGL,
        ..Format::PLAIN
    },
    Format {
        name: "kalibr",
        about: "Kalibr camchain: lenses",
        extensions: &["yaml", "yml"],
        contains: "lens (radtan, equidistant, unified, double sphere or EUCM)",
        lacks: "positions in the world (relative poses are written), k3, standard deviations, EFOV, planes other than the floor",
        lenses: &[
            DistortionModel::BrownConrady,
            DistortionModel::KannalaBrandt,
            DistortionModel::Unified,
            DistortionModel::DoubleSphere,
            DistortionModel::Eucm,
        ],
        has_positions: false,
        writes_lenses: true,
        write: Some(kalibr::write),
        read: Some(kalibr::read),
        pixels: CENTRE,
        units: "-",
        axes: "-",
        ignored_by_import: "relative poses of cameras and IMU, time shifts",
        ..Format::PLAIN
    },
    Format {
        name: "ocamcalib",
        about: "OCamCalib calib_results.txt, Scaramuzza's polynomial",
        extensions: &["txt"],
        contains: "lens (as the nearest fisheye, with an error of at most 1 px)",
        lacks: "pose",
        has_positions: false,
        read: Some(ocamcalib::read),
        pixels: CENTRE,
        units: "-",
        axes: "-",
        ignored_by_import: "the inverse polynomial",
        ..Format::PLAIN
    },
    Format {
        name: "caliscope",
        about: "caliscope, anipose and FreeMoCap camera arrays (TOML), lenses only",
        extensions: &["toml"],
        contains: "lens (Brown-Conrady or fisheye)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        has_positions: false,
        read: Some(caliscope::read),
        pixels: CENTRE,
        units: "-",
        axes: "-",
        ignored_by_import: "poses (relative to a board, in an unknown unit)",
        ..Format::PLAIN
    },
    Format {
        name: "basalt",
        about: "Basalt calibrations, lenses only",
        extensions: &["json"],
        contains: "lens (Brown-Conrady, rational, fisheye, unified, double sphere or EUCM)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        has_positions: false,
        read: Some(basalt::read),
        pixels: CENTRE,
        units: "-",
        axes: "-",
        ignored_by_import: "poses relative to the IMU, IMU parameters, vignettes",
        ..Format::PLAIN
    },
    Format {
        name: "camodocal",
        about: "camodocal cameras (YAML), lenses only",
        extensions: &["yaml", "yml"],
        contains: "lens (Brown-Conrady, rational, fisheye or unified)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        has_positions: false,
        read: Some(camodocal::read),
        pixels: CENTRE,
        units: "-",
        axes: "-",
        ignored_by_import: "",
        ..Format::PLAIN
    },
    Format {
        name: "opensfm",
        about: "OpenSfM camera models (JSON), lenses only",
        extensions: &["json"],
        contains: "lens (Brown-Conrady or fisheye)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        has_positions: false,
        read: Some(opensfm::read),
        pixels: CORNER,
        units: "-",
        axes: "-",
        ignored_by_import: "shots and points (reconstruction.json)",
        ..Format::PLAIN
    },
    Format {
        name: "metashape",
        about: "Agisoft Metashape calibrations (XML), lenses only",
        extensions: &["xml"],
        contains: "lens (Brown-Conrady or fisheye)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        has_positions: false,
        read: Some(metashape::read),
        pixels: CORNER,
        units: "-",
        axes: "-",
        ignored_by_import: "cameras, markers, covariances",
        ..Format::PLAIN
    },
    Format {
        name: "matlab",
        about: "MATLAB camera parameters as JSON, lenses only",
        extensions: &["json"],
        contains: "lens (Brown-Conrady)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        has_positions: false,
        read: Some(matlab::read),
        pixels: CENTRE_ONE,
        units: "-",
        axes: "-",
        ignored_by_import: "poses of the board, errors",
        ..Format::PLAIN
    },
    Format {
        name: "fspy",
        about: "fSpy project, or its camera parameters as JSON",
        extensions: &["fspy", "json"],
        contains: "pinhole, pose, or lines as annotations",
        lacks: "distortion",
        read: Some(fspy::read),
        unit_m: Some(1.0),
        units: "arbitrary, rad",
        axes: OPENGL,
        ignored_by_import: "vanishing points, the origin, the reference distance, the image",
        ..Format::PLAIN
    },
    Format {
        name: "worldfile",
        about: "world file of a floor plan: the plan's scale and position",
        extensions: &["pgw", "jgw", "wld", "pngw", "jpgw"],
        contains: "plan",
        lacks: "cameras",
        describes_plan: true,
        read: Some(worldfile::read),
        pixels: CENTRE,
        units: "m (assumed)",
        axes: "plan: x right, y down",
        ..Format::PLAIN
    },
];

/// Returns the format with this name on the command line.
#[must_use]
pub fn format(name: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == name)
}
