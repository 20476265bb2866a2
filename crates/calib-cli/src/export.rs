//! `calib export`: the calibration as other programs have it, and what they cannot hold.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use calib_formats::{Export, ExportOptions, FORMATS, Format, PlanImage};
use clap::builder::{PossibleValue, PossibleValuesParser};

use crate::args::{SiteArgs, size};
use crate::files;
use crate::picture;
use crate::site_file::SiteFile;
use crate::stop::Stop;

/// A type of the table that the formats leave to this program: it has what writes it.
const PARQUET: &str = "parquet";

/// Arguments of `calib export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Which format
    #[arg(value_parser = formats(Format::exports))]
    format: String,
    #[command(flatten)]
    site: SiteArgs,
    /// Folder to write into, or a file where there is but one; - is stdout
    #[arg(short, long, value_name = "PATH")]
    output: String,
    /// Only this camera
    #[arg(long, value_name = "ID")]
    camera: Option<String>,
    /// Write even what the format cannot hold as it is
    #[arg(long)]
    allow_lossy: bool,
    /// The camera of the undistorted image, and the map that makes it (for cv2.remap)
    #[arg(long)]
    rectified: bool,
    /// For a stream of this size, in pixels
    #[arg(long, value_name = "WxH", value_parser = size)]
    rescale: Option<[u32; 2]>,
    /// One of the format's file types (a table may be parquet, too); by default that of PATH, or else the format's first
    #[arg(long, value_name = "EXTENSION")]
    file_type: Option<String>,
    /// Overwrite files that are there
    #[arg(long)]
    force: bool,
}

/// The names of the formats with what reads them, for the help.
pub(crate) fn formats(which: fn(&Format) -> bool) -> PossibleValuesParser {
    let known = FORMATS.iter().filter(|format| which(format));
    PossibleValuesParser::new(known.map(|format| PossibleValue::new(format.name).help(format.about)))
}

/// A format by a name that was checked already.
pub(crate) fn named(name: &str) -> Result<&'static Format, Stop> {
    calib_formats::format(name).ok_or_else(|| Stop::Usage(format!("{name}: no such format")))
}

/// Writes the files of a format, once nothing is lost or that is agreed to.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    let format = named(&args.format)?;
    let file = args.site.read()?;
    if let Some(id) = &args.camera {
        file.camera(id)?;
    }
    let mut options = options(args, format, &file)?;
    let is_parquet = format.is_table && options.extension.take_if(|asked| asked == PARQUET).is_some();
    let mut export = calib_formats::export(format, &file.site, &options).map_err(|error| {
        let nothing = file.site.cameras.iter().all(|camera| camera.camera().is_none());
        if nothing { Stop::Unsolved(error.to_string()) } else { Stop::Usage(error.to_string()) }
    })?;
    if is_parquet {
        for file in &mut export.files {
            (file.name, file.bytes) = ("cameras.parquet".into(), as_parquet(&file.bytes)?);
        }
    }
    agree(args, format, &export)?;
    let targets = targets(args, format, &export)?;
    for (path, file) in targets.iter().zip(&export.files) {
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
        }
        files::write(&path.to_string_lossy(), &file.bytes, args.force)?;
    }
    for note in &export.notes {
        files::say(note);
    }
    files::say(format_args!("{} holds {}; it has no place for: {}", format.name, format.holds, format.lacks));
    if !export.unsolved.is_empty() {
        let ids = export.unsolved.join(", ");
        return Err(Stop::Unsolved(format!("left out because they are not calibrated: {ids}")));
    }
    Ok(())
}

#[cfg(feature = "archives")]
use crate::project::encode as as_parquet;

#[cfg(not(feature = "archives"))]
fn as_parquet(_: &[u8]) -> Result<Vec<u8>, Stop> {
    Err(Stop::Usage("parquet: this program was built without its feature `archives`".into()))
}

fn options(args: &Args, format: &Format, file: &SiteFile) -> Result<ExportOptions, Stop> {
    let of_path = extension(&args.output).filter(|found| is_type(format, found));
    let plan = if format.shows_plan { file.plan_image()? } else { None };
    let plan = plan.map(|image| {
        Ok::<_, Stop>(PlanImage { size: [image.width(), image.height()], png: picture::png(&image)? })
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

/// Whether PATH is a file's name, or stdout, and no folder.
fn is_one_file(args: &Args, format: &Format) -> bool {
    let is_named = extension(&args.output).is_some_and(|found| is_type(format, &found));
    args.output == "-" || is_named && !Path::new(&args.output).is_dir()
}

/// Whether a format is written as files that end so.
fn is_type(format: &Format, extension: &str) -> bool {
    format.extensions.contains(&extension) || format.is_table && extension == PARQUET
}

fn extension(path: &str) -> Option<String> {
    Some(Path::new(path).extension()?.to_string_lossy().to_lowercase())
}

/// Refuses what would mislead, unless that is agreed to.
fn agree(args: &Args, format: &Format, export: &Export) -> Result<(), Stop> {
    if export.losses.is_empty() {
        return Ok(());
    }
    let list: Vec<String> = export.losses.iter().map(|loss| format!("  {loss}")).collect();
    let list = list.join("\n");
    if args.allow_lossy {
        files::say(format_args!("{} loses\n{list}", format.name));
        return Ok(());
    }
    Err(Stop::Lossy(format!("{} would lose\n{list}\n--allow-lossy writes it all the same", format.name)))
}

/// Where every file goes: PATH itself, if it is a file's name, else into the folder PATH.
fn targets(args: &Args, format: &Format, export: &Export) -> Result<Vec<PathBuf>, Stop> {
    let path = Path::new(&args.output);
    if is_one_file(args, format) {
        if let [_] = export.files[..] {
            return Ok(vec![path.to_owned()]);
        }
        let count = export.files.len();
        let one = if args.camera.is_none() { ", or choose one with --camera ID" } else { "" };
        let what = format!("--output {}: {count} files; give a folder{one}", args.output);
        return Err(Stop::Usage(what));
    }
    let targets: Vec<PathBuf> = export.files.iter().map(|file| path.join(&file.name)).collect();
    for target in &targets {
        files::check_free(&target.to_string_lossy(), args.force)?;
    }
    Ok(targets)
}
