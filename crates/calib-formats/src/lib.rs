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

mod file;
mod fisheye;
mod tree;
mod view;
mod export;
mod planes;
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
mod ocamcalib;
mod caliscope;
mod fspy;
mod worldfile;
mod registry;

use std::collections::HashSet;

use calib_site::Site;

use crate::export::Scene;

pub use export::{Export, Loss};
pub use file::{File, FormatError, MAX_BYTES, MAX_FILES, Problem};
pub use given::Imported;
pub use planes::OfPlanes;
pub use registry::{FORMATS, Format, format};
pub use remap::remap_npy;
pub use table::runs_in_spreadsheets;
pub use view::{ExportOptions, PlanPicture};

/// Writes the calibrated cameras of a site.
///
/// # Errors
/// When the format is not written, has not the extension asked for, or there is no calibrated camera.
pub fn export(format: &Format, site: &Site, options: &ExportOptions) -> Result<Export, FormatError> {
    let write = format.write.ok_or_else(|| FormatError::new(format.name, Problem::ReadOnly))?;
    let first = format.extensions.first().copied().unwrap_or_default();
    let asked = options.extension.as_deref().unwrap_or(first);
    let extension = format.extensions.iter().find(|known| **known == asked).ok_or_else(|| {
        FormatError::expected(format.name, file::quoted(asked), format.extensions.join(", "))
    })?;
    let (views, unsolved) = view::views(site, options);
    if views.is_empty() {
        return Err(FormatError::new("the site", Problem::NothingToExport));
    }
    if format.names_files_by_id
        && let Some(view) = views.iter().find(|view| view.file != view.id)
    {
        return Err(FormatError::new(format!("camera {:?}", view.id), Problem::NotAFileName));
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
    export.tell_of_planes(site, format.planes);
    views.iter().filter(|view| view.is_stretched()).for_each(|view| export.lose_proportion(view));
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
