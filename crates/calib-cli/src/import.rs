//! `calib import`: cameras of another program as a site.
//!
//! Cameras of another program in a site that is there: its lines, links and marks stay.

use std::path::Path;

use calib_formats::{File, Format, MAX_BYTES, MAX_FILES};
use calib_report::few;
use calib_site::{Plan, Site, SiteCamera};

use crate::export::{formats, named};
use crate::files;
use crate::files::say;
use crate::site_file::SiteFile;
use crate::stop::Stop;

/// The site with the cameras and the plan that were imported. What is there already is replaced only when that
/// is wanted.
pub(crate) fn merged(file: SiteFile, imported: Site, replaces: bool) -> Result<Site, Stop> {
    let SiteFile { mut site, path, .. } = file;
    let (mut added, mut taken) = (Vec::new(), Vec::new());
    for camera in imported.cameras {
        let mut of_id = site.cameras.iter_mut().filter(|entry| entry.id == camera.id);
        match (of_id.next(), of_id.next()) {
            (None, _) => {
                added.push(camera.id.clone());
                site.cameras.push(camera);
            }
            (Some(entry), None) => {
                taken.push(camera.id.clone());
                take(entry, camera, &path)?;
            }
            (Some(_), Some(_)) => {
                let what =
                    format!("several periods of camera \"{}\" are there; choose one by hand", camera.id);
                return Err(Stop::invalid(path, what));
            }
        }
    }
    let mut there: Vec<String> = taken.iter().map(|id| format!("camera \"{id}\"")).collect();
    if let Some(plan) = imported.plan {
        there.extend(site.plan.is_some().then(|| "a plan".into()));
        site.plan = Some(with_picture(plan, site.plan));
    }
    if !replaces && !there.is_empty() {
        let what =
            format!("has {} already; --replace takes lens and pose, or the plan, in its place", list(&there));
        return Err(Stop::invalid(path, what));
    }
    site.check().map_err(|error| Stop::invalid(&path, format!("merged, {error}")))?;
    tell(&path, &added, &there);
    Ok(site)
}

fn list(names: &[String]) -> String {
    few(names.iter().map(String::as_str))
}

fn tell(path: &str, added: &[String], replaced: &[String]) {
    if !added.is_empty() {
        say(format_args!("added to {path}: {}", list(added)));
    }
    if !replaced.is_empty() {
        say(format_args!("replaced in {path}: lens and pose, or scale and place, of {}", list(replaced)));
    }
}

/// What is drawn belongs to an image of one size.
fn take(entry: &mut SiteCamera, camera: SiteCamera, path: &str) -> Result<(), Stop> {
    if entry.size_px != camera.size_px {
        let ([w, h], [found_w, found_h]) = (entry.size_px, camera.size_px);
        let what = format!(
            "camera \"{}\" has {w} x {h} pixels, and what is imported {found_w} x {found_h}; scale it first",
            entry.id
        );
        return Err(Stop::invalid(path, what));
    }
    entry.lens = camera.lens;
    entry.solution = camera.solution.or(entry.solution.take());
    entry.error = None;
    entry.image = entry.image.take().or(camera.image);
    let is_new = |point: &calib_site::ControlPointEntry| !entry.control_points.contains(point);
    let new: Vec<_> = camera.control_points.into_iter().filter(is_new).collect();
    entry.control_points.extend(new);
    Ok(())
}

/// A world file names no picture that it knows to be there.
fn with_picture(plan: Plan, there: Option<Plan>) -> Plan {
    let Some(there) = there else { return plan };
    Plan { image: there.image.or(plan.image), georeference: plan.georeference.or(there.georeference), ..plan }
}

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
        say(note);
    }
    let site = match &args.into {
        None => {
            say("to merge this with a site, name it: --into SITE");
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
