//! Export and import of camera calibrations in the formats of other programs.
//!
//! [`export()`] writes a site in one format and lists the data that the format loses. [`import()`] reads one
//! format into a site. The crate works on bytes in memory: the caller reads and writes the files.
//!
//! # Conventions
//!
//! The conventions of [`calib_core`] apply: z up, metres, camera axes right, down, forward, pixel (0, 0) at
//! the corner of the image. Each format module converts between them and its format. Its header states the
//! format's axes, units and pixel origin.
//!
//! # Files
//!
//! - `file`: files in memory and their errors.
//! - `tree`: JSON, YAML, XML and TOML as one tree of values. `base64_array`: arrays of OpenCV in base64.
//! - `fisheye`: rotation formats, and the fit of a Kannala-Brandt lens.
//! - `view`, `export`, `planes`: the input of an export, and its losses and notes.
//! - `input`: files of an import with the caller's options. `given`: imported cameras and their conversion to a site.
//! - `ids`: ids of cameras whose files have the same name. `lens_keys`: keys and distortion of lenses in OpenCV's terms.
//! - `remap`: the undistortion map of `--rectified`.
//! - One file for each format, from `opencv` to `worldfile`. `ground_points` has GPX, KML and tables of points.
//! - `registry`: [`FORMATS`], the list of all formats.

mod file;
mod fisheye;
mod base64_array;
mod tree;
mod ids;
mod view;
mod export;
mod planes;
mod input;
mod given;
mod remap;
mod lens_keys;
mod opencv;
mod ros;
mod colmap_binary;
mod colmap;
mod nerfstudio;
mod nvidia;
mod scenescape;
mod wildtrack;
mod table;
mod sql;
mod geojson;
mod ground_points;
mod svg;
mod frigate;
mod nvdsanalytics;
mod blender;
mod kalibr;
mod ocamcalib;
mod caliscope;
mod basalt;
mod camodocal;
mod opensfm;
mod metashape;
mod matlab;
mod fspy;
mod worldfile;
mod registry;

use std::collections::HashSet;

use calib_site::Site;

use crate::export::Scene;
use crate::input::Input;

pub use export::{Export, Loss};
pub use file::{File, FormatError, MAX_BYTES, MAX_FILES, Problem};
pub use geojson::coverage_geojson;
pub use given::Imported;
pub use input::ImportOptions;
pub use planes::PlaneTreatment;
pub use registry::{FORMATS, Format, format};
pub use remap::remap_npy;
pub use table::is_spreadsheet_formula;
pub use view::{ExportOptions, PlanImage};

/// Writes the calibrated cameras of a site.
///
/// # Errors
/// Fails if the format or the requested extension cannot be written, or if no camera is calibrated. Fails if the
/// format needs unique ids, and two periods share an id. Fails if the format names files by id, and an id is no valid
/// file name. Fails if the format needs a georeference and the site has none.
pub fn export(format: &Format, site: &Site, options: &ExportOptions) -> Result<Export, FormatError> {
    let write = format.write.ok_or_else(|| FormatError::new(format.name, Problem::ReadOnly))?;
    let first = format.extensions.first().copied().unwrap_or_default();
    let asked = options.extension.as_deref().unwrap_or(first);
    let extension = format.extensions.iter().find(|known| **known == asked).ok_or_else(|| {
        FormatError::expected(format.name, file::quoted(asked), format.extensions.join(", "))
    })?;
    let (views, unsolved) = view::views(site, options, format.writes_lenses);
    if views.is_empty() {
        return Err(FormatError::new("the site", Problem::NothingToExport));
    }
    if format.needs_georeference && site.georeference().is_none() {
        return Err(FormatError::new("the site", Problem::NoGeoreference));
    }
    if format.names_files_by_id
        && let Some(view) = views.iter().find(|view| view.file != view.id)
    {
        return Err(FormatError::new(format!("camera {:?}", view.id), Problem::InvalidFileName));
    }
    if !format.has_periods {
        let mut seen = HashSet::new();
        if let Some(view) = views.iter().find(|view| !seen.insert(&view.id)) {
            return Err(FormatError::new(format!("camera {:?}", view.id), Problem::SeveralPeriods));
        }
    }
    let mut export = Export { unsolved, ..Export::default() };
    if format.has_positions {
        let unplaced = views.iter().filter(|view| view.has_pose && !view.is_placed);
        unplaced.for_each(|view| export.report_unplaced(site, view));
        export.notes.extend(views.iter().filter_map(|view| view.scale_note.clone()));
    }
    for view in views.iter().filter(|view| !view.has_pose && format.has_positions) {
        export.notes.push(format!("camera {:?} has no pose: only its lens is exported", view.id));
    }
    export.report_planes(site, format.planes);
    views.iter().filter(|view| view.is_stretched()).for_each(|view| export.report_aspect_ratio(view));
    if options.rectified {
        for view in &views {
            remap::write(view, &mut export);
        }
    }
    write(&Scene { site, views, options, extension, lenses: format.lenses }, &mut export);
    Ok(export)
}

/// Reads the files of one calibration with the default options; see [`import_with`].
///
/// # Errors
/// Fails if a file is invalid. The error names the file and the position in it.
pub fn import(format: &Format, files: &[File]) -> Result<Imported, FormatError> {
    import_with(format, files, &ImportOptions::default())
}

/// Reads the files of one calibration.
///
/// # Errors
/// Fails if a file is invalid. The error names the file and the position in it. Fails for an option that the
/// format does not support, and without files or with more than [`MAX_FILES`].
pub fn import_with(
    format: &Format,
    files: &[File],
    options: &ImportOptions,
) -> Result<Imported, FormatError> {
    let read = format.read.ok_or_else(|| FormatError::new(format.name, Problem::WriteOnly))?;
    if files.len() > MAX_FILES {
        let found = format!("{} files", files.len());
        return Err(FormatError::expected(format.name, found, format!("at most {MAX_FILES}")));
    }
    if files.is_empty() {
        return Err(FormatError::new(format.name, Problem::NoFiles(format.extensions)));
    }
    let imported = read(&Input::new(format.name, format.unit_m, files, options)?)?;
    if options.size.is_some() && imported.site.cameras.is_empty() {
        return Err(FormatError::new(format.name, Problem::NoCameras));
    }
    Ok(imported)
}
