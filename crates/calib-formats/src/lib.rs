//! Camera calibrations as other programs have them: bytes in, bytes out.
//!
//! [`FORMATS`] is the list; [`export()`] writes a site in one of them and says what it cannot hold,
//! [`import()`] reads one into a site. No files, no clock: the caller has the folders.
//!
//! # Conventions
//!
//! Ours are those of [`calib_core`]: z up, metres, a camera's axes right, down, forward, and pixels
//! counted from the corner of the image. Every format converts at its own border, and says there what
//! its readers count from.

mod error;
mod file;
mod rotation;
mod tree;
mod view;
mod export;
mod given;
mod remap;
mod opencv;
mod ros;
mod colmap;
mod nerfstudio;
mod nvidia;
mod scenescape;
mod wildtrack;
mod table;
mod sql;
mod geojson;
mod svg;
mod frigate;
mod nvdsanalytics;
mod blender;
mod kalibr;
mod caliscope;
mod fspy;
mod worldfile;

use std::collections::HashSet;

use calib_core::{DistortionModel, Site};

use crate::export::Scene;

pub use error::{FormatError, Problem};
pub use export::{Export, Loss};
pub use file::{File, MAX_BYTES, MAX_FILES};
pub use given::Imported;
pub use table::runs_in_spreadsheets;
pub use view::{ExportOptions, PlanPicture};

type Write = fn(&Scene, &mut Export);
type Read = fn(&[File]) -> Result<Imported, FormatError>;

/// A format of calibrations.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    /// By which it is asked for.
    pub name: &'static str,
    /// Who reads it.
    pub about: &'static str,
    /// Of its files, without the dot; the first is what is written if nothing else is asked for.
    pub extensions: &'static [&'static str],
    /// What of a calibrated camera it holds.
    pub holds: &'static str,
    /// What it has no place for.
    pub lacks: &'static str,
    /// The lens models it holds as they are; others are fitted by the nearest Brown-Conrady terms, or lost.
    pub lenses: &'static [DistortionModel],
    /// Whether its readers take from it where cameras stand, so that one that nobody placed misleads.
    pub holds_place: bool,
    /// Whether it tells the periods of a camera apart.
    pub holds_periods: bool,
    /// Whether it shows the plan, and [`ExportOptions::plan`] is asked for.
    pub shows_plan: bool,
    /// Whether it is a table whose JSON a program that can may write as Parquet.
    pub is_table: bool,
    /// Whether what it says is how the plan lies, and not a camera.
    pub is_of_plan: bool,
    /// Names of files of which one brings the others that lie beside it.
    pub companions: &'static [&'static str],
    write: Option<Write>,
    read: Option<Read>,
}

impl Format {
    /// What rows of [`FORMATS`] are unless they say otherwise: poses without lenses, neither written nor read.
    const PLAIN: Self = Self {
        name: "",
        about: "",
        extensions: &[],
        holds: "",
        lacks: NOT_SIGMAS,
        lenses: &[],
        holds_place: true,
        holds_periods: false,
        shows_plan: false,
        is_table: false,
        is_of_plan: false,
        companions: &[],
        write: None,
        read: None,
    };

    /// Whether it can be written.
    #[must_use]
    pub const fn exports(&self) -> bool {
        self.write.is_some()
    }

    /// Whether it can be read.
    #[must_use]
    pub const fn imports(&self) -> bool {
        self.read.is_some()
    }
}

const NOT_SIGMAS: &str = "standard deviations, EFOV";
/// The models of most programs.
const RADIAL_OR_FISHEYE: &[DistortionModel] =
    &[DistortionModel::BrownConrady, DistortionModel::KannalaBrandt];

/// The list is the registry.
pub const FORMATS: &[Format] = &[
    Format {
        name: "opencv",
        about: "OpenCV FileStorage, one file a camera",
        extensions: &["json", "yml", "yaml", "xml"],
        holds: "lens (Brown-Conrady or fisheye), pose",
        lenses: RADIAL_OR_FISHEYE,
        write: Some(opencv::write),
        read: Some(opencv::read),
        ..Format::PLAIN
    },
    Format {
        name: "ros",
        about: "ROS camera_info, one file a camera",
        extensions: &["yaml", "yml"],
        holds: "lens (plumb_bob or equidistant)",
        lacks: "pose, standard deviations, EFOV",
        lenses: RADIAL_OR_FISHEYE,
        holds_place: false,
        write: Some(ros::write),
        read: Some(ros::read),
        ..Format::PLAIN
    },
    Format {
        name: "colmap",
        about: "COLMAP text model: cameras.txt, images.txt, points3D.txt",
        extensions: &["txt"],
        holds: "lens (Brown-Conrady or fisheye), pose",
        lenses: RADIAL_OR_FISHEYE,
        companions: &["cameras.txt", "images.txt"],
        write: Some(colmap::write),
        read: Some(colmap::read),
        ..Format::PLAIN
    },
    Format {
        name: "nerfstudio",
        about: "nerfstudio transforms.json",
        extensions: &["json"],
        holds: "lens (Brown-Conrady or fisheye), pose",
        lenses: RADIAL_OR_FISHEYE,
        write: Some(nerfstudio::write),
        ..Format::PLAIN
    },
    Format {
        name: "nvidia",
        about: "NVIDIA DeepStream and Metropolis: camInfo, calibration.json, transforms.yml, map.png",
        extensions: &["json", "yml"],
        holds: "pinhole, pose, EFOV, plan",
        lacks: "distortion, standard deviations",
        shows_plan: true,
        write: Some(nvidia::write),
        read: Some(nvidia::read),
        ..Format::PLAIN
    },
    Format {
        name: "scenescape",
        about: "Intel SceneScape cameras (JSON)",
        extensions: &["json"],
        holds: "lens (Brown-Conrady), pose",
        lenses: &[DistortionModel::BrownConrady],
        write: Some(scenescape::write),
        ..Format::PLAIN
    },
    Format {
        name: "wildtrack",
        about: "WILDTRACK calibrations (XML), centimetres",
        extensions: &["xml"],
        holds: "pinhole, pose",
        lacks: "distortion, standard deviations, EFOV",
        write: Some(wildtrack::write),
        read: Some(wildtrack::read),
        ..Format::PLAIN
    },
    Format {
        name: "table",
        about: "a row of matrices for every camera, directions in the names",
        extensions: &["json", "csv"],
        holds: "everything but standard deviations",
        lacks: "standard deviations",
        lenses: &[DistortionModel::BrownConrady, DistortionModel::Division, DistortionModel::KannalaBrandt],
        holds_periods: true,
        is_table: true,
        write: Some(table::write),
        ..Format::PLAIN
    },
    Format {
        name: "sql",
        about: "SQL views that map detections to the floor",
        extensions: &["sql"],
        holds: "lens (exactly without distortion and as a division model, else fitted), floor homography, periods",
        lacks: "EFOV, heights above the floor, standard deviations",
        lenses: &[DistortionModel::Division],
        holds_periods: true,
        write: Some(sql::write),
        ..Format::PLAIN
    },
    Format {
        name: "geojson",
        about: "GeoJSON of EFOVs and cameras; *.local.geojson in metres without a georeference",
        extensions: &["geojson"],
        holds: "position, heading, EFOV",
        lacks: "lens, orientation, standard deviations",
        write: Some(geojson::write),
        ..Format::PLAIN
    },
    Format {
        name: "svg",
        about: "drawing of the plan and the EFOVs",
        extensions: &["svg"],
        holds: "position, heading, EFOV",
        lacks: "lens, orientation, standard deviations",
        shows_plan: true,
        write: Some(svg::write),
        ..Format::PLAIN
    },
    Format {
        name: "frigate",
        about: "Frigate zones with distances for speeds",
        extensions: &["yml", "yaml"],
        holds: "EFOV",
        lacks: "lens, pose, standard deviations",
        holds_place: false,
        write: Some(frigate::write),
        ..Format::PLAIN
    },
    Format {
        name: "nvdsanalytics",
        about: "DeepStream nvdsanalytics regions of interest",
        extensions: &["txt", "ini"],
        holds: "EFOV",
        lacks: "lens, pose, standard deviations",
        holds_place: false,
        write: Some(nvdsanalytics::write),
        ..Format::PLAIN
    },
    Format {
        name: "blender",
        about: "Blender script that makes the cameras",
        extensions: &["py"],
        holds: "pinhole, pose",
        lacks: "distortion, standard deviations, EFOV",
        write: Some(blender::write),
        ..Format::PLAIN
    },
    Format {
        name: "kalibr",
        about: "Kalibr camchain, lenses only",
        extensions: &["yaml", "yml"],
        holds: "lens (radtan or equidistant)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        holds_place: false,
        read: Some(kalibr::read),
        ..Format::PLAIN
    },
    Format {
        name: "caliscope",
        about: "caliscope, anipose and FreeMoCap camera arrays (TOML), lenses only",
        extensions: &["toml"],
        holds: "lens (Brown-Conrady or fisheye)",
        lacks: "pose",
        lenses: RADIAL_OR_FISHEYE,
        holds_place: false,
        read: Some(caliscope::read),
        ..Format::PLAIN
    },
    Format {
        name: "fspy",
        about: "fSpy project",
        extensions: &["fspy"],
        holds: "pinhole, pose",
        lacks: "distortion",
        read: Some(fspy::read),
        ..Format::PLAIN
    },
    Format {
        name: "worldfile",
        about: "world file of a floor plan: the plan's scale and place",
        extensions: &["pgw", "jgw", "wld", "pngw", "jpgw"],
        holds: "plan",
        lacks: "cameras",
        is_of_plan: true,
        read: Some(worldfile::read),
        ..Format::PLAIN
    },
];

/// The format of a name.
#[must_use]
pub fn format(name: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == name)
}

/// Writes the calibrated cameras of a site.
///
/// # Errors
/// When the format is not written, has not the extension asked for, or there is no calibrated camera.
pub fn export(format: &Format, site: &Site, options: &ExportOptions) -> Result<Export, FormatError> {
    let write = format.write.ok_or_else(|| FormatError::new(format.name, Problem::ReadOnly))?;
    let first = format.extensions.first().copied().unwrap_or_default();
    let asked = options.extension.as_deref().unwrap_or(first);
    let extension = format.extensions.iter().find(|known| **known == asked).ok_or_else(|| {
        FormatError::expected(format.name, error::quoted(asked), format.extensions.join(", "))
    })?;
    let (views, unsolved) = view::views(site, options);
    if views.is_empty() {
        return Err(FormatError::new("the site", Problem::NothingToExport));
    }
    if !format.holds_periods {
        let mut seen = HashSet::new();
        if let Some(view) = views.iter().find(|view| !seen.insert(&view.id)) {
            return Err(FormatError::new(format!("camera {:?}", view.id), Problem::SeveralPeriods));
        }
    }
    let mut export = Export { unsolved, ..Export::default() };
    if format.holds_place {
        views.iter().filter(|view| !view.is_placed).for_each(|view| export.lose_place(site, view));
    }
    if options.rectified {
        for view in &views {
            remap::write(view, &mut export);
        }
    }
    write(&Scene { site, views, options, extension, lenses: format.lenses }, &mut export);
    Ok(export)
}

/// Reads files of a format that belong together.
///
/// # Errors
/// What is wrong with them, and where.
pub fn import(format: &Format, files: &[File]) -> Result<Imported, FormatError> {
    let read = format.read.ok_or_else(|| FormatError::new(format.name, Problem::WriteOnly))?;
    if files.len() > MAX_FILES {
        let found = format!("{} files", files.len());
        return Err(FormatError::expected(format.name, found, format!("at most {MAX_FILES}")));
    }
    if files.is_empty() {
        return Err(FormatError::new(format.name, Problem::NoFiles(format.extensions)));
    }
    read(files)
}
