//! `calib export`: writes the calibration in formats of other programs, and reports the data that a format
//! loses.

use std::path::{Path, PathBuf};

use calib_formats::{Export, ExportOptions, FORMATS, Format, PlanImage};
use clap::builder::{PossibleValue, PossibleValuesParser};

use crate::args::{SiteArgs, size};
use crate::files;
use crate::picture;
use crate::site_file::SiteFile;
use crate::stop::CommandError;

/// File type of camera tables that this crate encodes, because `calib_formats` does not support it.
const PARQUET: &str = "parquet";

/// Arguments of `calib export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Format to export
    #[arg(value_parser = formats(Format::can_export))]
    format: String,
    #[command(flatten)]
    site: SiteArgs,
    /// Folder to write to, or a file if only one is written; - is stdout
    #[arg(short, long, value_name = "PATH")]
    output: String,
    /// Export only this camera
    #[arg(long, value_name = "ID")]
    camera: Option<String>,
    /// Export even if the format loses data
    #[arg(long)]
    allow_lossy: bool,
    /// Export the camera of the undistorted image, with the undistortion map (for cv2.remap)
    #[arg(long)]
    rectified: bool,
    /// Export for a stream of this size, in pixels
    #[arg(long, value_name = "WxH", value_parser = size)]
    rescale: Option<[u32; 2]>,
    /// File type of the format (a table may also be parquet); by default the extension of PATH, otherwise the
    /// format's first type
    #[arg(long, value_name = "EXTENSION")]
    file_type: Option<String>,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

/// Returns a parser for the names of the formats that `which` accepts; the help lists them with descriptions.
pub(crate) fn formats(which: fn(&Format) -> bool) -> PossibleValuesParser {
    let known = FORMATS.iter().filter(|format| which(format));
    PossibleValuesParser::new(known.map(|format| PossibleValue::new(format.name).help(format.about)))
}

/// Returns the format with this name on the command line; fails for an unknown name.
pub(crate) fn format_named(name: &str) -> Result<&'static Format, CommandError> {
    calib_formats::format(name).ok_or_else(|| CommandError::Usage(format!("{name}: unknown format")))
}

/// Writes the files of a format if it loses no data, or the loss is allowed.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    let format = format_named(&args.format)?;
    let file = args.site.read()?;
    if let Some(id) = &args.camera {
        file.camera(id)?;
    }
    let mut options = options(args, format, &file)?;
    let is_parquet = format.is_table && options.extension.take_if(|asked| asked == PARQUET).is_some();
    let mut export = calib_formats::export(format, &file.site, &options).map_err(|error| {
        let nothing = file.site.cameras.iter().all(|camera| camera.camera().is_none());
        if nothing {
            CommandError::Unsolved(error.to_string())
        } else {
            CommandError::Usage(error.to_string())
        }
    })?;
    if is_parquet {
        for file in &mut export.files {
            (file.name, file.bytes) = ("cameras.parquet".into(), as_parquet(&file.bytes)?);
        }
    }
    check_losses(args, format, &export)?;
    let targets = output_paths(args, format, &export)?;
    for (path, file) in targets.iter().zip(&export.files) {
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            files::create_folder(folder)?;
        }
        files::write(&path.to_string_lossy(), &file.bytes, args.force)?;
    }
    for note in &export.notes {
        files::print_message(note);
    }
    files::print_message(format_args!(
        "the {} export contains: {}; it does not contain: {}",
        format.name, format.contains, format.lacks
    ));
    if !export.unsolved.is_empty() {
        let ids = export.unsolved.join(", ");
        let what = format!(
            "cameras left out because they are not calibrated: {ids}; run calib solve to see the reasons"
        );
        return Err(CommandError::Unsolved(what));
    }
    Ok(())
}

#[cfg(feature = "archives")]
use crate::project::encode_parquet as as_parquet;

#[cfg(not(feature = "archives"))]
fn as_parquet(_: &[u8]) -> Result<Vec<u8>, CommandError> {
    Err(CommandError::Usage("parquet: not supported by this build (feature `archives` is off)".into()))
}

fn options(args: &Args, format: &Format, file: &SiteFile) -> Result<ExportOptions, CommandError> {
    let of_path = extension(&args.output).filter(|found| is_type(format, found));
    let plan = if format.shows_plan { file.plan_image()? } else { None };
    let plan = plan.map(|image| {
        Ok::<_, CommandError>(PlanImage { size: [image.width(), image.height()], png: picture::png(&image)? })
    });
    Ok(ExportOptions {
        rectified: args.rectified,
        rescale: args.rescale,
        extension: args.file_type.clone().or(of_path),
        camera: args.camera.clone(),
        plan: plan.transpose()?,
        embeds: is_one_file(args, format),
    })
}

/// Whether PATH is a file name or stdout, not a folder.
fn is_one_file(args: &Args, format: &Format) -> bool {
    let is_named = extension(&args.output).is_some_and(|found| is_type(format, &found));
    args.output == "-" || is_named && !Path::new(&args.output).is_dir()
}

/// Whether a format has files with this extension.
fn is_type(format: &Format, extension: &str) -> bool {
    format.extensions.contains(&extension) || format.is_table && extension == PARQUET
}

fn extension(path: &str) -> Option<String> {
    Some(Path::new(path).extension()?.to_string_lossy().to_lowercase())
}

/// Refuses a lossy export unless it is allowed.
fn check_losses(args: &Args, format: &Format, export: &Export) -> Result<(), CommandError> {
    if export.losses.is_empty() {
        return Ok(());
    }
    let list: Vec<String> = export.losses.iter().map(|loss| format!("  {loss}")).collect();
    let list = list.join("\n");
    if args.allow_lossy {
        files::print_message(format_args!("the {} export loses:\n{list}", format.name));
        return Ok(());
    }
    Err(CommandError::Lossy(format!(
        "the {} export would lose:\n{list}\nAdd --allow-lossy to export anyway.",
        format.name
    )))
}

/// Returns the path of every file: PATH itself if it is a file name, otherwise inside the folder PATH.
fn output_paths(args: &Args, format: &Format, export: &Export) -> Result<Vec<PathBuf>, CommandError> {
    let path = Path::new(&args.output);
    if is_one_file(args, format) {
        if let [_] = export.files[..] {
            return Ok(vec![path.to_owned()]);
        }
        let count = export.files.len();
        let one = if args.camera.is_none() { ", or choose one camera with --camera ID" } else { "" };
        let what = format!("--output {}: the export has {count} files; give a folder{one}", args.output);
        return Err(CommandError::Usage(what));
    }
    let targets: Vec<PathBuf> = export.files.iter().map(|file| path.join(&file.name)).collect();
    for target in &targets {
        files::check_free(&target.to_string_lossy(), args.force)?;
    }
    Ok(targets)
}
