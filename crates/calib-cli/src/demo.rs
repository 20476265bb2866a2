//! `calib demo`: the demonstration site, written, solved, rendered and compared with its truth.

use std::path::Path;

use anyhow::Context as _;
use calib_core::{Camera, Options, Site, SiteCamera};
use calib_demo::DemoSite;
use indicatif::{ProgressBar, ProgressStyle};

use crate::files::{self, SiteFile, say};
use crate::plan_view::plan_view;
use crate::render::camera_view;
use crate::stop::Stop;

/// By which a folder is known as one that this command wrote.
const STAMP: &str = ".calib-demo";

/// Arguments of `calib demo`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder to write to
    #[arg(value_name = "DIR", default_value = "calib-demo")]
    folder: String,
    /// Overwrite a folder that this command did not write
    #[arg(long)]
    force: bool,
}

/// Writes, solves, renders, compares.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    let folder = Path::new(&args.folder);
    claim(folder, args.force)?;
    let demo = calib_demo::demo_site();
    let steps = demo.site.cameras.len() * 2 + 2;
    let progress = ProgressBar::new(steps as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
        progress.set_style(style);
    }
    for (camera, (id, truth)) in demo.site.cameras.iter().zip(&demo.truth) {
        progress.set_message(format!("rendering {id}"));
        let image = calib_demo::render(truth, camera.size_px);
        let name = camera.image.as_deref().unwrap_or("image.png");
        files::write_atomically(&folder.join(name), &files::encoded(&image, name)?)?;
        progress.inc(1);
    }
    let plan = demo.site.plan.as_ref().and_then(|plan| plan.image.as_deref()).unwrap_or("plan.png");
    files::write_atomically(&folder.join(plan), &files::png(&demo.plan)?)?;
    progress.inc(1);
    let site = folder.join("site.json");
    files::write_atomically(&site, demo.site.to_json().as_bytes())?;
    let solved = demo.site.calibrate(&Options::default()).write_into(&demo.site);
    files::write_atomically(&folder.join("solved.json"), solved.to_json().as_bytes())?;
    draw(folder, &progress)?;
    progress.finish_and_clear();
    files::print(&comparison(&demo, &solved))?;
    say(format_args!(
        "\nWrote {}: site.json (as drawn), solved.json, and overlay-*.png, sigma-*.png and overlay-plan.png to look at.",
        folder.display()
    ));
    let cameras: Vec<&SiteCamera> = solved.cameras.iter().collect();
    crate::solve::unsolved(&cameras)
}

/// Makes the folder, or takes one that this command wrote before.
fn claim(folder: &Path, force: bool) -> Result<(), Stop> {
    let ours = folder.join(STAMP);
    let is_empty = std::fs::read_dir(folder).map_or(true, |mut entries| entries.next().is_none());
    if !is_empty && !ours.exists() && !force {
        let message =
            format!("{} exists and was not written by this command; --force overwrites it", folder.display());
        return Err(Stop::Failed(anyhow::anyhow!(message)));
    }
    std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    files::write_atomically(&ours, b"This folder was written by `calib demo`, which overwrites it.\n")
}

/// Overlays of every camera and of the plan, and the floor shaded by its error.
fn draw(folder: &Path, progress: &ProgressBar) -> Result<(), Stop> {
    let file = SiteFile::read(&folder.join("solved.json").to_string_lossy())?;
    for camera in &file.site.cameras {
        progress.set_message(format!("drawing {}", camera.id));
        for (sigma, prefix) in [(false, "overlay"), (true, "sigma")] {
            if sigma && camera.camera().is_none() {
                continue;
            }
            let (image, svg) = camera_view(&file, camera, sigma)?;
            let path = folder.join(format!("{prefix}-{}.png", camera.id));
            files::write_atomically(&path, &files::png(&svg.draw_on(&image)?)?)?;
        }
        progress.inc(1);
    }
    let (ground, svg) = plan_view(&file.site, file.plan_image()?);
    files::write_atomically(&folder.join("overlay-plan.png"), &files::png(&svg.draw_on(&ground)?)?)?;
    progress.inc(1);
    Ok(())
}

/// Every error against the truth, beside the sigma that was predicted for it.
fn comparison(demo: &DemoSite, solved: &Site) -> String {
    use std::fmt::Write as _;
    let mut out = String::from("Errors against the truth (\u{b1} the predicted sigma)\n");
    let _ = writeln!(
        out,
        "{:10} {:>16} {:>16} {:>18} {:>16} {:>12} {:>12}",
        "camera", "roll deg", "pitch deg", "focal %", "yaw deg", "position m", "floor m",
    );
    for (entry, (id, truth)) in solved.cameras.iter().zip(&demo.truth) {
        let (Some(found), Some(solution)) = (entry.camera(), &entry.solution) else {
            let _ = writeln!(out, "{id:10} not solved");
            continue;
        };
        let sigma = solution.sigma.as_ref();
        let cell = |error: f64, sigma: Option<f64>| match sigma {
            Some(sigma) => format!("{error:+.2} \u{b1} {sigma:.2}"),
            None => format!("{error:+.2}"),
        };
        let turn = |a: f64, b: f64| {
            ((a - b + 540_f64.to_radians()).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI)
                .to_degrees()
        };
        let focal_sigma = sigma.and_then(|s| s.focal_px).map(|s| 100.0 * s / found.focal);
        let _ = writeln!(
            out,
            "{id:10} {:>16} {:>16} {:>18} {:>16} {:>12.2} {:>12}",
            cell(turn(found.roll, truth.roll), sigma.and_then(|s| s.roll_deg)),
            cell(turn(found.pitch, truth.pitch), sigma.and_then(|s| s.pitch_deg)),
            cell(100.0 * (found.focal / truth.focal - 1.0), focal_sigma),
            cell(turn(found.yaw, truth.yaw), sigma.and_then(|s| s.yaw_deg)),
            found.position.distance(truth.position),
            floor_error(entry, &found, truth).map_or_else(|| "-".into(), |rms| format!("{rms:.2}")),
        );
    }
    out
}

/// Root mean square distance on the floor between what both cameras see at pixels of the EFOV.
fn floor_error(entry: &SiteCamera, found: &Camera, truth: &Camera) -> Option<f64> {
    let corners = entry.efov_px.as_ref()?;
    let centre = corners
        .iter()
        .fold([0.0, 0.0], |sum, p| [sum[0] + p.u, sum[1] + p.v])
        .map(|c| c / corners.len() as f64);
    let squares: Vec<f64> = corners
        .iter()
        .flat_map(|p| {
            [0.2, 0.5, 0.9].map(|t| {
                calib_core::Pixel::new(centre[0] + t * (p.u - centre[0]), centre[1] + t * (p.v - centre[1]))
            })
        })
        .filter_map(|p| Some(found.pixel_to_floor(p, 0.0)?.distance(truth.pixel_to_floor(p, 0.0)?).powi(2)))
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}
