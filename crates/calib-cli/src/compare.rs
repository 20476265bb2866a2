//! `calib compare`: what became of cameras, by a newer still of each.
//!
//! Cameras that moved, calibrated anew from what was drawn on their old stills.
//!
//! A newer still with the places of the old one: where they are found again, and where they are not.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use calib_core::{Camera, Pixel};
use calib_image::{Became, Comparison, OtherSize, drawn_edges, recovered};
use calib_report::{decimals, few};
use calib_site::{NewStill, Site, SiteCamera};
use image::{Rgb, RgbImage};
use jiff::Timestamp;

use crate::args::SiteArgs;
use crate::files::ThreadsArgs;
use crate::files::say;
use crate::progress::Pulse;
use crate::site_file::{SiteFile, beside};
use crate::solve::Format;
use crate::stop::Stop;
use crate::stop::visible;
use crate::{files, picture, site_file};

/// Arguments of `calib compare`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Compare this camera; without it a still is of the camera that its name begins with
    #[arg(long, value_name = "ID")]
    camera: Option<String>,
    /// Newer stills (PNG, JPEG), or folders of them, in the order of the times in their names (2026-05-01T0830, UTC) or their EXIF data
    #[arg(long = "still", required = true, num_args = 1.., value_name = "FILE")]
    stills: Vec<PathBuf>,
    /// How to report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Draw every newest still with the places that are found again and those that are not, into this folder
    #[arg(long, value_name = "DIR")]
    render: Option<PathBuf>,
    /// Carry what was drawn to the new still, and solve the cameras that moved from it
    #[arg(long, requires = "output", conflicts_with = "at")]
    recover: bool,
    /// Write the site with the cameras that were recovered here
    #[arg(short, long, value_name = "FILE", requires = "recover")]
    output: Option<String>,
    /// Since when the new calibrations hold (RFC 3339); without it since the first still that shows the camera moved
    #[arg(long, value_name = "TIME", requires = "recover")]
    since: Option<Timestamp>,
    /// Overwrite the output file and pictures
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadsArgs,
}

/// A still of a camera, compared.
pub(crate) struct Seen {
    pub(crate) path: PathBuf,
    pub(crate) time: Option<Timestamp>,
    pub(crate) comparison: Comparison,
}

/// A camera with its newer stills, the oldest first.
pub(crate) struct Compared {
    /// Of its entry in the site.
    pub(crate) index: usize,
    pub(crate) id: String,
    pub(crate) camera: Camera,
    pub(crate) seen: Vec<Seen>,
}

impl Compared {
    /// What is to be said of it: by its newest still.
    pub(crate) fn last(&self) -> Option<&Seen> {
        self.seen.last()
    }

    /// The first still that shows it as the newest does, and after which none shows it unchanged.
    pub(crate) fn since(&self) -> Option<&Seen> {
        let last = self.last()?.comparison.became;
        let still = self.seen.iter().rposition(|seen| seen.comparison.became == Became::Unchanged);
        let after = &self.seen[still.map_or(0, |index| index + 1)..];
        after.iter().find(|seen| seen.comparison.became.name() == last.name())
    }
}

/// Compares, reports, recovers.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    let file = args.site.read()?;
    let mut compared = Vec::new();
    for (index, taken) in of_cameras(args, &file)? {
        let pulse = Pulse::new("comparing");
        compared.push(compare(&file, index, taken, args.threads)?);
        drop(pulse);
    }
    report(args, &compared)?;
    if let Some(folder) = &args.render {
        draw(&file, &compared, folder, args.force)?;
    }
    if let Some(output) = args.output.as_deref().filter(|_| args.recover) {
        write_recovered(&file, &compared, args.since, output, args.force)?;
    }
    let changed: Vec<&str> = compared.iter().filter(|of| has_changed(of)).map(|of| of.id.as_str()).collect();
    if changed.is_empty() {
        return Ok(());
    }
    Err(Stop::Unsolved(format!("not as calibrated, or not known to be: {}", few(changed))))
}

fn has_changed(of: &Compared) -> bool {
    of.last().is_some_and(|seen| seen.comparison.became != Became::Unchanged)
}

/// A still, by when it was taken.
type Taken = (Option<Timestamp>, PathBuf);

/// The stills of every camera that has some, in order of time, by its entry.
fn of_cameras(args: &Args, file: &SiteFile) -> Result<Vec<(usize, Vec<Taken>)>, Stop> {
    let mut of: Vec<(usize, Vec<Taken>)> = Vec::new();
    for path in site_file::listed(&args.stills)? {
        let id = match &args.camera {
            Some(id) => id.clone(),
            None => named(file, &path)?,
        };
        let time = site_file::time(&path)?;
        let index = entry(file, &id, time)?;
        match of.iter_mut().find(|(other, _)| *other == index) {
            Some((_, taken)) => taken.push((time, path)),
            None => of.push((index, vec![(time, path)])),
        }
    }
    of.iter_mut().for_each(|(_, taken)| taken.sort());
    of.sort_by_key(|(index, _)| *index);
    Ok(of)
}

/// The camera whose id the name of a still is, or begins with.
fn named(file: &SiteFile, path: &Path) -> Result<String, Stop> {
    let found = file.site.camera_of_name(&site_file::stem(path));
    found.map(str::to_owned).ok_or_else(|| {
        let what = format!(
            "{}: of which camera is this? Give --camera, or begin its name with one of {}",
            path.display(),
            few(file.site.cameras.iter().map(|camera| camera.id.as_str()))
        );
        Stop::Usage(what)
    })
}

/// The period of a camera that holds when a still was taken.
fn entry(file: &SiteFile, id: &str, time: Option<Timestamp>) -> Result<usize, Stop> {
    file.has_camera(id)?;
    let time = time.map(|time| time.to_string());
    file.site.entry_at(id, time.as_deref()).ok_or_else(|| {
        Stop::Usage(format!("--camera {id}: several periods have this id; choose one with --at TIME"))
    })
}

fn compare(file: &SiteFile, index: usize, taken: Vec<Taken>, threads: ThreadsArgs) -> Result<Compared, Stop> {
    let entry = &file.site.cameras[index];
    let not_calibrated =
        || Stop::Unsolved(format!("camera \"{}\" is not calibrated: solve it first", entry.id));
    let camera = entry.camera().ok_or_else(not_calibrated)?;
    let old = file.camera_image(entry)?;
    let drawn = drawn_edges(entry);
    let of_still = |(time, path): Taken| {
        let new = still(entry, &path)?;
        let comparison =
            Comparison::new(&camera, &drawn, &old, &new).map_err(|error| other_size(&path, entry, error))?;
        Ok::<_, Stop>(Seen { time, path, comparison })
    };
    let seen = threads.run(taken, of_still, |_| ())?;
    Ok(Compared { index, id: entry.id.clone(), camera, seen })
}

/// A picture of the newest still of every camera.
fn draw(file: &SiteFile, compared: &[Compared], folder: &Path, force: bool) -> Result<(), Stop> {
    std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    for (of, seen) in compared.iter().filter_map(|of| Some((of, of.last()?))) {
        let image = drawn(of, seen, still(&file.site.cameras[of.index], &seen.path)?);
        let name = folder.join(format!("{}.png", of.id)).to_string_lossy().into_owned();
        files::write(&name, &picture::encoded(&image, &name)?, force)?;
    }
    Ok(())
}

/// A newer still of a camera; one of another size is refused before it is decoded.
pub(crate) fn still(entry: &SiteCamera, path: &Path) -> Result<RgbImage, Stop> {
    let bytes = site_file::bytes(path)?;
    let wrong = |error| Stop::invalid(path.display(), error);
    let new = calib_input::size_of(&bytes).map_err(wrong)?;
    if new != entry.size_px {
        return Err(other_size(path, entry, OtherSize { old: entry.size_px, new }));
    }
    calib_input::decode(&bytes).map_err(wrong)
}

fn other_size(path: &Path, entry: &SiteCamera, error: OtherSize) -> Stop {
    Stop::invalid(path.display(), format!("camera \"{}\": {error}", entry.id))
}

fn report(args: &Args, compared: &[Compared]) -> Result<(), Stop> {
    // stdout is the site where it is asked for there.
    let to_stdout = args.output.as_deref() == Some("-");
    match args.format {
        Format::Text if to_stdout => say(text(compared)),
        Format::Text => files::print(&visible(&text(compared)))?,
        Format::Json if to_stdout => {}
        Format::Json => files::print(&format!("{:#}\n", json(args, compared)))?,
    }
    Ok(())
}

/// One camera that was asked for with one still is one object; else a list.
fn json(args: &Args, compared: &[Compared]) -> serde_json::Value {
    let of = |of: &Compared| {
        let stills: Vec<_> = of.seen.iter().map(|seen| of_still(of, seen)).collect();
        let mut value = stills.last().cloned().unwrap_or_default();
        value["since"] = of.since().and_then(|seen| seen.time).map(|time| time.to_string()).into();
        if stills.len() > 1 {
            value["stills"] = stills.into();
        }
        value
    };
    match compared {
        [only] if args.camera.is_some() => of(only),
        _ => serde_json::json!({ "cameras": compared.iter().map(of).collect::<Vec<_>>() }),
    }
}

fn of_still(of: &Compared, Seen { path, time, comparison }: &Seen) -> serde_json::Value {
    let became = comparison.became;
    let known = |value: f64| Some(value).filter(|value| became.is_aligned() && value.is_finite());
    let (turned, turned_sigma) = comparison.angle(&of.camera);
    let (zoom, zoom_sigma) = comparison.zoom();
    let movement = comparison.movement(&of.camera);
    let degrees = |index: usize| known(movement[index].0.to_degrees());
    let sigma = |index: usize| known(movement[index].1.to_degrees());
    serde_json::json!({
        "camera": of.id,
        "still": path.to_string_lossy(),
        "time": time.map(|time| time.to_string()),
        "verdict": became.name(),
        "shifted": became == Became::Shifted,
        "turned_deg": known(turned.to_degrees()),
        "turned_sigma_deg": known(turned_sigma.to_degrees()),
        "zoom": known(zoom),
        "zoom_sigma": known(zoom_sigma),
        "yaw_deg": degrees(0),
        "pitch_deg": degrees(1),
        "roll_deg": degrees(2),
        "sigma": { "yaw_deg": sigma(0), "pitch_deg": sigma(1), "roll_deg": sigma(2) },
        "sigmas_clear": known(comparison.clear),
        "moved_px": known(comparison.shift),
        "places": comparison.places,
        "found": comparison.found,
        "found_by_chance": comparison.by_chance,
        "reason": became.to_string(),
    })
}

fn text(compared: &[Compared]) -> String {
    let mut out = String::new();
    let names = compared.iter().map(|of| of.id.chars().count());
    let width = names.max().unwrap_or(0).max(6);
    let _ = writeln!(
        out,
        "{:width$}  {:11} {:>23} {:>22} {:>8} {:>8} {:>8} {:>6}",
        "camera", "verdict", "turned deg", "zoom", "yaw", "pitch", "roll", "found"
    );
    for of in compared {
        for seen in &of.seen {
            let _ = writeln!(out, "{:width$}  {}", of.id, row(of, &seen.comparison));
            let time = seen.time.map(|time| format!(" ({time})")).unwrap_or_default();
            let _ =
                writeln!(out, "{:width$}    {}{time}: {}", "", seen.path.display(), seen.comparison.became);
        }
    }
    out
}

/// A value and its standard deviation, to two digits of that.
fn with_sigma(value: f64, sigma: f64) -> String {
    /// Of a value that has none.
    const MOST: usize = 7;
    let decimals = if sigma > 0.0 { decimals(sigma) } else { MOST };
    format!("{value:.decimals$} \u{b1} {sigma:.decimals$}")
}

fn row(of: &Compared, comparison: &Comparison) -> String {
    let became = comparison.became;
    if !became.is_aligned() {
        return format!(
            "{:11} {:>23} {:>22} {:>8} {:>8} {:>8} {:>5.0}%",
            became.name(),
            "-",
            "-",
            "-",
            "-",
            "-",
            100.0 * comparison.found
        );
    }
    let (turned, turned_sigma) = comparison.angle(&of.camera);
    let (zoom, zoom_sigma) = comparison.zoom();
    let movement = comparison.movement(&of.camera);
    let [yaw, pitch, roll] = [0, 1, 2].map(|index| movement[index].0.to_degrees());
    format!(
        "{:11} {:>23} {:>22} {yaw:>+8.3} {pitch:>+8.3} {roll:>+8.3} {:>5.0}%",
        became.name(),
        with_sigma(turned.to_degrees(), turned_sigma.to_degrees()),
        with_sigma(zoom, zoom_sigma),
        100.0 * comparison.found,
    )
}

/// An edge that is where it is told.
const FOUND: Rgb<u8> = Rgb([40, 220, 90]);
/// One that is not: something stands before it, or it moved by itself.
const LOST: Rgb<u8> = Rgb([255, 90, 40]);

/// The newer still with a dot at every place of an edge.
pub(crate) fn drawn(of: &Compared, seen: &Seen, mut still: RgbImage) -> RgbImage {
    let turned = seen.comparison.turn.at(&of.camera);
    for (place, found) in &seen.comparison.seen {
        if let (Some(found), Some(at)) = (found, turned.pixel(*place)) {
            dot(&mut still, at, if *found { FOUND } else { LOST });
        }
    }
    still
}

fn dot(image: &mut RgbImage, at: Pixel, colour: Rgb<u8>) {
    const HALF: i64 = 1;
    for (x, y) in (-HALF..=HALF).flat_map(|x| (-HALF..=HALF).map(move |y| (x, y))) {
        let (x, y) = (at.u as i64 + x, at.v as i64 + y);
        let pixel = u32::try_from(x).ok().zip(u32::try_from(y).ok());
        if let Some(pixel) = pixel.and_then(|(x, y)| image.get_pixel_mut_checked(x, y)) {
            *pixel = colour;
        }
    }
}

/// Writes the site with every camera that moved recovered; one that cannot be stays as it is, and is named.
pub(crate) fn write_recovered(
    file: &SiteFile,
    compared: &[Compared],
    since: Option<Timestamp>,
    output: &str,
    force: bool,
) -> Result<(), Stop> {
    // Paths are those of the file that is written.
    let mut site = file.seen_from(&file.site, output);
    let mut count = 0;
    let has_changed =
        |of: &&Compared| of.last().is_some_and(|seen| seen.comparison.became != Became::Unchanged);
    for of in compared.iter().filter(has_changed) {
        match of_camera(file, &site, of, since, output)? {
            Ok(with) => {
                site = with;
                count += 1;
            }
            Err(why) => say(format_args!("calib: camera \"{}\" is not recovered: {why}", of.id)),
        }
    }
    if count == 0 {
        say(format_args!("calib: no camera was recovered; {output} is not written"));
        return Ok(());
    }
    files::write(output, site.to_json().as_bytes(), force)
}

/// The site with one camera recovered, or why that would be a guess; an error where its stills cannot be read.
fn of_camera(
    file: &SiteFile,
    site: &Site,
    of: &Compared,
    since: Option<Timestamp>,
    output: &str,
) -> Result<Result<Site, String>, Stop> {
    let Some(seen) = of.last() else { return Ok(Err("it has no newer still".into())) };
    let Some(since) = since.or_else(|| of.since().and_then(|seen| seen.time)) else {
        return Ok(Err("the name of its still says no time; give --since TIME".into()));
    };
    let entry = &file.site.cameras[of.index];
    let (old, new) = (file.camera_image(entry)?, still(entry, &seen.path)?);
    let newer = NewStill { image: beside(&seen.path, output), since: since.to_string() };
    let pulse = Pulse::new("solving");
    let found = recovered(site, of.index, &seen.comparison, [&old, &new], &newer);
    drop(pulse);
    Ok(found.map_err(|refusal| refusal.to_string()).map(|found| {
        if !found.left_out.is_empty() {
            let names = few(found.left_out.iter().map(String::as_str));
            say(format_args!("calib: camera \"{}\": not on the new still, left out: {names}", of.id));
        }
        found.site
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sigma_has_two_digits_and_its_value_as_many_decimals() {
        assert_eq!(with_sigma(0.999_991_3, 0.000_003_24), "0.9999913 \u{b1} 0.0000032");
        assert_eq!(with_sigma(2.014_9, 0.031), "2.015 \u{b1} 0.031");
        assert_eq!(with_sigma(12.34, 25.0), "12 \u{b1} 25");
        assert_eq!(with_sigma(1.0, 0.0), "1.0000000 \u{b1} 0.0000000");
        assert_eq!(with_sigma(1.0, f64::NAN), "1.0000000 \u{b1} NaN");
    }
}
