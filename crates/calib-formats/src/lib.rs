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

use calib_core::Site;

use crate::export::Scene;

pub use error::{FormatError, Problem};
pub use export::{Export, Loss};
pub use file::{File, MAX_BYTES, MAX_FILES};
pub use given::Imported;
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
    write: Option<Write>,
    read: Option<Read>,
}

impl Format {
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

/// The list is the registry.
pub const FORMATS: &[Format] = &[
    Format {
        name: "opencv",
        about: "OpenCV FileStorage, one file a camera",
        extensions: &["json", "yml", "yaml", "xml"],
        holds: "lens (Brown-Conrady or fisheye), pose",
        lacks: NOT_SIGMAS,
        write: Some(opencv::write),
        read: Some(opencv::read),
    },
    Format {
        name: "ros",
        about: "ROS camera_info, one file a camera",
        extensions: &["yaml", "yml"],
        holds: "lens (plumb_bob or equidistant)",
        lacks: "pose, standard deviations, EFOV",
        write: Some(ros::write),
        read: Some(ros::read),
    },
    Format {
        name: "colmap",
        about: "COLMAP text model: cameras.txt, images.txt, points3D.txt",
        extensions: &["txt"],
        holds: "lens (Brown-Conrady or fisheye), pose",
        lacks: NOT_SIGMAS,
        write: Some(colmap::write),
        read: Some(colmap::read),
    },
    Format {
        name: "nerfstudio",
        about: "nerfstudio transforms.json",
        extensions: &["json"],
        holds: "lens (Brown-Conrady or fisheye), pose",
        lacks: NOT_SIGMAS,
        write: Some(nerfstudio::write),
        read: None,
    },
    Format {
        name: "nvidia",
        about: "NVIDIA DeepStream and Metropolis: camInfo, calibration.json, transforms.yml, map.png",
        extensions: &["json", "yml"],
        holds: "pinhole, pose, EFOV, plan",
        lacks: "distortion, standard deviations",
        write: Some(nvidia::write),
        read: Some(nvidia::read),
    },
    Format {
        name: "scenescape",
        about: "Intel SceneScape cameras (JSON)",
        extensions: &["json"],
        holds: "lens (Brown-Conrady), pose",
        lacks: NOT_SIGMAS,
        write: Some(scenescape::write),
        read: None,
    },
    Format {
        name: "wildtrack",
        about: "WILDTRACK calibrations (XML), centimetres",
        extensions: &["xml"],
        holds: "pinhole, pose",
        lacks: "distortion, standard deviations, EFOV",
        write: Some(wildtrack::write),
        read: Some(wildtrack::read),
    },
    Format {
        name: "table",
        about: "a row of matrices for every camera, directions in the names",
        extensions: &["json", "csv"],
        holds: "everything but standard deviations",
        lacks: "standard deviations",
        write: Some(table::write),
        read: None,
    },
    Format {
        name: "sql",
        about: "SQL views that map detections to the floor",
        extensions: &["sql"],
        holds: "lens (exactly without distortion and as a division model, else fitted), floor homography, periods",
        lacks: "EFOV, heights above the floor, standard deviations",
        write: Some(sql::write),
        read: None,
    },
    Format {
        name: "geojson",
        about: "GeoJSON of EFOVs and cameras; *.local.geojson in metres without a georeference",
        extensions: &["geojson"],
        holds: "position, heading, EFOV",
        lacks: "lens, orientation, standard deviations",
        write: Some(geojson::write),
        read: None,
    },
    Format {
        name: "svg",
        about: "drawing of the plan and the EFOVs",
        extensions: &["svg"],
        holds: "position, heading, EFOV",
        lacks: "lens, orientation, standard deviations",
        write: Some(svg::write),
        read: None,
    },
    Format {
        name: "frigate",
        about: "Frigate zones with distances for speeds",
        extensions: &["yml", "yaml"],
        holds: "EFOV",
        lacks: "lens, pose, standard deviations",
        write: Some(frigate::write),
        read: None,
    },
    Format {
        name: "nvdsanalytics",
        about: "DeepStream nvdsanalytics regions of interest",
        extensions: &["txt", "ini"],
        holds: "EFOV",
        lacks: "lens, pose, standard deviations",
        write: Some(nvdsanalytics::write),
        read: None,
    },
    Format {
        name: "blender",
        about: "Blender script that makes the cameras",
        extensions: &["py"],
        holds: "pinhole, pose",
        lacks: "distortion, standard deviations, EFOV",
        write: Some(blender::write),
        read: None,
    },
    Format {
        name: "kalibr",
        about: "Kalibr camchain, lenses only",
        extensions: &["yaml", "yml"],
        holds: "lens (radtan or equidistant)",
        lacks: "pose",
        write: None,
        read: Some(kalibr::read),
    },
    Format {
        name: "caliscope",
        about: "caliscope, anipose and FreeMoCap camera arrays (TOML), lenses only",
        extensions: &["toml"],
        holds: "lens (Brown-Conrady or fisheye)",
        lacks: "pose",
        write: None,
        read: Some(caliscope::read),
    },
    Format {
        name: "fspy",
        about: "fSpy project",
        extensions: &["fspy"],
        holds: "pinhole, pose",
        lacks: "distortion",
        write: None,
        read: Some(fspy::read),
    },
    Format {
        name: "worldfile",
        about: "world file of a floor plan: the plan's scale and place",
        extensions: &["pgw", "jgw", "wld", "pngw", "jpgw"],
        holds: "plan",
        lacks: "cameras",
        write: None,
        read: Some(worldfile::read),
    },
];

/// The formats that tell the periods of a camera apart.
const PERIODS: [&str; 2] = ["table", "sql"];

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
    if !PERIODS.contains(&format.name) {
        let mut seen = HashSet::new();
        if let Some(view) = views.iter().find(|view| !seen.insert(&view.id)) {
            return Err(FormatError::new(format!("camera {:?}", view.id), Problem::SeveralPeriods));
        }
    }
    let mut export = Export { unsolved, ..Export::default() };
    if !format.lacks.contains("pose") {
        views.iter().filter(|view| !view.is_placed).for_each(|view| export.lose_place(site, view));
    }
    if options.rectified {
        for view in &views {
            remap::write(view, &mut export);
        }
    }
    write(&Scene { site, views, options, extension }, &mut export);
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
