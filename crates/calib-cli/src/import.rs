//! `calib import`: imports the cameras of another program as a site, or merges them into an existing site,
//! whose annotations, links and marks stay.

use std::path::Path;

use calib_formats::{File, Format, ImportOptions, MAX_BYTES, MAX_FILES, import_with};
use calib_report::shortened_list;
use calib_site::{GroundPoint, Plan, Site, SiteCamera};

use crate::args::{grid, size, unit};
use crate::export::{format_named, formats};
use crate::files;
use crate::files::print_message;
use crate::site_file::SiteFile;
use crate::stop::CommandError;

/// Merges imported cameras, plan and ground points into a site. Existing cameras and an existing plan are replaced if
/// `replaces` is set; otherwise, the merge fails.
pub(crate) fn merge(file: SiteFile, imported: Site, replaces: bool) -> Result<Site, CommandError> {
    let SiteFile { mut site, path, .. } = file;
    let (mut added, mut replaced) = (Vec::new(), Vec::new());
    for camera in imported.cameras {
        let mut of_id = site.cameras.iter_mut().filter(|entry| entry.id == camera.id);
        match (of_id.next(), of_id.next()) {
            (None, _) => {
                added.push(camera.id.clone());
                site.cameras.push(camera);
            }
            (Some(entry), None) => {
                replaced.push(camera.id.clone());
                replace_camera(entry, camera, &path)?;
            }
            (Some(_), Some(_)) => {
                let what = format!(
                    "camera \"{}\" has several calibration periods; copy the imported values into the correct one",
                    camera.id
                );
                return Err(CommandError::invalid(path, what));
            }
        }
    }
    let mut existing: Vec<String> = replaced.iter().map(|id| format!("camera \"{id}\"")).collect();
    if let Some(plan) = imported.plan {
        existing.extend(site.plan.is_some().then(|| "a plan".into()));
        site.plan = Some(keep_plan_image(plan, site.plan));
    }
    if !replaces && !existing.is_empty() {
        let what = format!(
            "already has {}; add --replace to replace the plan, and the lens and pose of existing cameras",
            list(&existing)
        );
        return Err(CommandError::invalid(path, what));
    }
    merge_ground_points(&mut site, imported.ground_points, imported.crs, &path)?;
    site.check()
        .map_err(|error| CommandError::invalid(&path, format!("not valid after the merge: {error}")))?;
    report_merge(&path, &added, &existing);
    Ok(site)
}

/// Adds the ground points, and replaces points with the same id. Refuses points in a grid other than the site's grid.
fn merge_ground_points(
    site: &mut Site,
    points: Vec<GroundPoint>,
    crs: Option<String>,
    path: &str,
) -> Result<(), CommandError> {
    if let (Some(known), Some(new)) = (&site.crs, &crs)
        && !known.eq_ignore_ascii_case(new)
    {
        let what = format!("the site has the grid {known}, not {new}; convert the points to {known} first");
        return Err(CommandError::invalid(path, what));
    }
    site.crs = site.crs.take().or(crs);
    points.into_iter().for_each(|point| site.set_ground_point(point));
    Ok(())
}

fn list(names: &[String]) -> String {
    shortened_list(names.iter().map(String::as_str))
}

fn report_merge(path: &str, added: &[String], replaced: &[String]) {
    if !added.is_empty() {
        print_message(format_args!("added to {path}: {}", list(added)));
    }
    if !replaced.is_empty() {
        print_message(format_args!(
            "replaced in {path}: {} (lens and pose of a camera; scale and position of a plan)",
            list(replaced)
        ));
    }
}

/// Replaces the lens of a camera, and its pose if the imported camera has one. Adds the imported control points.
/// The annotations belong to an image of one size, so another size is refused.
fn replace_camera(entry: &mut SiteCamera, camera: SiteCamera, path: &str) -> Result<(), CommandError> {
    if entry.size_px != camera.size_px {
        let ([w, h], [found_w, found_h]) = (entry.size_px, camera.size_px);
        let what = format!(
            "camera \"{}\" has {w} x {h} pixels, but the imported camera has {found_w} x {found_h}; \
             import it without --into, scale it with calib export --rescale {w}x{h}, and import the result",
            entry.id
        );
        return Err(CommandError::invalid(path, what));
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

/// Returns the imported plan with the existing image, page and layers. A world file does not prove that its image
/// exists. The existing georeference is kept if the imported plan has none.
fn keep_plan_image(plan: Plan, existing: Option<Plan>) -> Plan {
    let Some(existing) = existing else { return plan };
    Plan {
        image: existing.image.or(plan.image),
        page: existing.page,
        layers: existing.layers,
        georeference: plan.georeference.or(existing.georeference),
        ..plan
    }
}

/// Largest accepted total size of the files of a folder, in bytes.
const MAX_FOLDER_BYTES: usize = 512 << 20;
/// Largest depth of nested folders that are searched; deeper folders are ignored.
const MAX_DEPTH: usize = 4;

/// Arguments of `calib import`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Format to import
    #[arg(value_parser = formats(Format::can_import))]
    format: String,
    /// File, or a folder with the files of the format
    file: String,
    /// Site to merge the cameras or the plan into; its annotations are kept
    #[arg(long, value_name = "SITE")]
    into: Option<String>,
    /// With --into: replace the existing lens and pose, or the plan
    #[arg(long, requires = "into")]
    replace: bool,
    /// Projected grid of imported points that are given by easting and northing
    #[arg(long, value_name = "EPSG:CODE", value_parser = grid_name)]
    crs: Option<String>,
    /// Size of the images, if the size in the files is missing or wrong
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Unit of the poses, if it differs from the format's unit: mm, cm, m, in or ft
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    unit: Option<f64>,
    /// Mirror the y axis, for files with a left-handed world
    #[arg(long)]
    left_handed: bool,
    /// Site file to write; - is stdout
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    output: String,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Checks the name of a projected grid, and returns it in upper case.
fn grid_name(name: &str) -> Result<String, String> {
    grid(name).map(|_| name.to_uppercase())
}

/// Imports a file or folder and writes the site.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    let format = format_named(&args.format)?;
    files::check_free(&args.output, args.force)?;
    let path = Path::new(&args.file);
    let mut found = Vec::new();
    if path.is_dir() {
        collect_files(path, "", format, 0, &mut found)?;
    } else {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        found.push(read(path, name)?);
        add_companions(path, format, &mut found)?;
    }
    let options = ImportOptions { size: args.size, unit_m: args.unit, is_left_handed: args.left_handed };
    let mut imported =
        import_with(format, &found, &options).map_err(|error| CommandError::Invalid(error.to_string()))?;
    imported.site.crs.clone_from(&args.crs);
    for note in &imported.notes {
        print_message(note);
    }
    let site = match &args.into {
        None => {
            print_message("to merge the import into a site, add --into SITE");
            let checked = imported.site.check();
            checked.map_err(|error| CommandError::invalid(&args.file, error))?;
            imported.site
        }
        Some(into) => {
            let file = SiteFile::read(into)?.relative_to(&args.output);
            merge(file, imported.site, args.replace)?
        }
    };
    files::write(&args.output, site.to_json().as_bytes(), args.force)
}

fn read(path: &Path, name: String) -> Result<File, CommandError> {
    let read = calib_input::read(path, MAX_BYTES as u64);
    Ok(File { name, bytes: read.map_err(|error| CommandError::invalid(path.display(), error))? })
}

/// Adds the other files of the format from the same folder, such as `images.txt` to `cameras.txt` of COLMAP.
fn add_companions(path: &Path, format: &Format, found: &mut Vec<File>) -> Result<(), CommandError> {
    for name in format.companions {
        let other = path.with_file_name(name);
        if !path.ends_with(name) && other.exists() {
            found.push(read(&other, (*name).to_owned())?);
        }
    }
    Ok(())
}

/// Collects the files of a format in a folder and its subfolders, sorted by name.
fn collect_files(
    folder: &Path,
    prefix: &str,
    format: &Format,
    depth: usize,
    found: &mut Vec<File>,
) -> Result<(), CommandError> {
    let wrong = |error: std::io::Error| CommandError::invalid(folder.display(), error);
    let mut entries =
        std::fs::read_dir(folder).map_err(wrong)?.collect::<Result<Vec<_>, _>>().map_err(wrong)?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if path.is_dir() {
            if depth < MAX_DEPTH {
                collect_files(&path, &format!("{name}/"), format, depth + 1, found)?;
            }
            continue;
        }
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        // Binary files that the format does not need may be huge, such as the points of COLMAP.
        let is_extra = extension == "bin"
            && path.file_name().is_none_or(|name| !format.companions.iter().any(|other| name == *other));
        if !format.extensions.contains(&extension.as_str()) || is_extra {
            continue;
        }
        found.push(read(&path, name)?);
        let bytes: usize = found.iter().map(|file| file.bytes.len()).sum();
        if found.len() > MAX_FILES || bytes > MAX_FOLDER_BYTES {
            let most = MAX_FOLDER_BYTES >> 20;
            let what = format!(
                "contains more than {MAX_FILES} files or {most} MiB of data; import a smaller folder"
            );
            return Err(CommandError::invalid(folder.display(), what));
        }
    }
    Ok(())
}
