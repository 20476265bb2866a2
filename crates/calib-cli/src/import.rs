//! `calib import`: cameras of another program as a site.

use std::path::Path;

use calib_formats::{File, Format, MAX_BYTES, MAX_FILES};

use crate::export::{formats, named};
use crate::files::{self, SiteFile};
use crate::merge::merged;
use crate::stop::Stop;

/// Most bytes that a folder may have in the files of a format.
const MAX_FOLDER_BYTES: usize = 512 << 20;
/// Folders in folders that are looked into.
const MAX_DEPTH: usize = 4;

/// Arguments of `calib import`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Which format
    #[arg(value_parser = formats(Format::imports))]
    format: String,
    /// File, or a folder with the files of the format
    file: String,
    /// Site that the cameras are merged into, or the plan; what is drawn there stays
    #[arg(long, value_name = "SITE")]
    into: Option<String>,
    /// With --into: take lens and pose, or the plan, in place of those that are there
    #[arg(long, requires = "into")]
    replace: bool,
    /// Site file to write; - is stdout
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    output: String,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Writes the site of what a file has.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    let format = named(&args.format)?;
    files::check_free(&args.output, args.force)?;
    let path = Path::new(&args.file);
    let mut found = Vec::new();
    if path.is_dir() {
        gather(path, "", format, 0, &mut found)?;
    } else {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        found.push(read(path, name)?);
        beside(path, format, &mut found)?;
    }
    let imported = calib_formats::import(format, &found).map_err(|error| Stop::Invalid(error.to_string()))?;
    for note in &imported.notes {
        files::say(note);
    }
    let site = match &args.into {
        None => {
            files::say("to merge this with a site, name it: --into SITE");
            imported.site
        }
        Some(into) => {
            let file = SiteFile::read(into)?.moved_to(&args.output);
            merged(file, imported.site, args.replace)?
        }
    };
    files::write(&args.output, site.to_json().as_bytes(), args.force)
}

fn read(path: &Path, name: String) -> Result<File, Stop> {
    let read = calib_input::read(path, MAX_BYTES as u64);
    Ok(File { name, bytes: read.map_err(|error| Stop::invalid(path.display(), error))? })
}

/// Of a model in several files one brings the others.
fn beside(path: &Path, format: &Format, found: &mut Vec<File>) -> Result<(), Stop> {
    for name in format.companions {
        let other = path.with_file_name(name);
        if !path.ends_with(name) && other.exists() {
            found.push(read(&other, (*name).to_owned())?);
        }
    }
    Ok(())
}

/// The files of a format in a folder and those below it, in the order of their names.
fn gather(
    folder: &Path,
    prefix: &str,
    format: &Format,
    depth: usize,
    found: &mut Vec<File>,
) -> Result<(), Stop> {
    let wrong = |error: std::io::Error| Stop::invalid(folder.display(), error);
    let mut entries =
        std::fs::read_dir(folder).map_err(wrong)?.collect::<Result<Vec<_>, _>>().map_err(wrong)?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if path.is_dir() {
            if depth < MAX_DEPTH {
                gather(&path, &format!("{name}/"), format, depth + 1, found)?;
            }
            continue;
        }
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if !format.extensions.contains(&extension.as_str()) {
            continue;
        }
        found.push(read(&path, name)?);
        let bytes: usize = found.iter().map(|file| file.bytes.len()).sum();
        if found.len() > MAX_FILES || bytes > MAX_FOLDER_BYTES {
            let most = MAX_FOLDER_BYTES >> 20;
            let what = format!("more than {MAX_FILES} files or {most} MiB, the most that is read");
            return Err(Stop::invalid(folder.display(), what));
        }
    }
    Ok(())
}
