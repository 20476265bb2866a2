//! `calib demo`: writes, solves and renders the demonstration site, and compares the result with ground
//! truth.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context as _;
use calib_core::camera::StraightDown;
use calib_core::{Camera, Covariance, Pixel};
use calib_demo::{DemoSite, Walk};
use calib_site::{Options, Sigmas, Site, SiteCamera, Stage};
use indicatif::{ProgressBar, ProgressStyle};

use crate::files::{self, print_message};
use crate::painting::draw_on;
use crate::picture;
use crate::plan_ground::plan_view;
use crate::progress::Pulse;
use crate::render::{Extras, camera_view};
use crate::site_file::SiteFile;
use crate::solve::Format;
use crate::stop::CommandError;

/// Name of the file that marks a folder written by this command.
const MARKER_FILE: &str = ".calib-demo";

/// Arguments of `calib demo`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder to write to
    #[arg(value_name = "DIR", default_value = "calib-demo")]
    folder: String,
    /// Write the site without a plan; only links and marks connect the cameras
    #[arg(long)]
    no_plan: bool,
    /// Also write images from one month later to the subfolder `later`: one camera rotated, one zoomed, a
    /// shelf moved, different people and light
    #[arg(long)]
    moved: bool,
    /// Output format of the errors
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Write to a folder that this command did not create, and overwrite its files
    #[arg(long)]
    force: bool,
}

/// Writes, solves, renders and compares the demonstration site.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    let folder = Path::new(&args.folder);
    prepare_folder(folder, args.force)?;
    let demo = if args.no_plan { calib_demo::demo_site_without_plan() } else { calib_demo::demo_site() };
    let steps = demo.site.cameras.len() * if args.moved { 3 } else { 2 } + 2;
    let _pulse = Pulse::unless_terminal("rendering the demonstration");
    let progress = ProgressBar::new(steps as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
        progress.set_style(style);
    }
    for (camera, (id, truth)) in demo.site.cameras.iter().zip(&demo.truth) {
        progress.set_message(format!("rendering {id}"));
        let image = calib_demo::render(truth, camera.size_px);
        let name = camera.image.as_deref().unwrap_or("image.png");
        files::write_atomically(&folder.join(name), &picture::encode(&image, name)?)?;
        progress.inc(1);
    }
    let stale = folder.join("plan.png");
    match demo.site.plan.as_ref().and_then(|plan| plan.image.as_deref()) {
        Some(plan) => {
            files::write_atomically(&folder.join(plan), &picture::png(&calib_demo::render_plan())?)?;
        }
        // A plan left by an earlier run would seem to belong to this site.
        None if stale.exists() => {
            std::fs::remove_file(&stale).context("cannot remove the plan of an earlier run")?;
        }
        None => {}
    }
    progress.inc(1);
    let site = folder.join("site.json");
    files::write_atomically(&site, demo.site.to_json().as_bytes())?;
    let solved = demo.site.calibrate(&Options::default()).write_into(&demo.site);
    files::write_atomically(&folder.join("solved.json"), solved.to_json().as_bytes())?;
    files::write_atomically(&folder.join("detections.csv"), detections(&demo).as_bytes())?;
    draw(folder, &progress)?;
    if args.moved {
        write_later(&demo, folder, &progress)?;
    }
    progress.finish_and_clear();
    files::print(&comparison(&demo, &solved, args.format))?;
    print_message(format_args!(
        "\nWrote {}: site.json (annotations only), solved.json, detections.csv (foot positions of people who walk through the shop), and the images overlay-*.png, sigma-*.png and overlay-plan.png.",
        folder.display()
    ));
    if args.moved {
        let folder = folder.display();
        print_message(format_args!(
            "To find the cameras that moved, run: calib compare {folder}/solved.json --still {folder}/later"
        ));
    }
    let cameras: Vec<&SiteCamera> = solved.cameras.iter().collect();
    crate::solve::check_all_solved(&cameras)
}

/// Writes the images from one month later, named by camera and time.
fn write_later(demo: &DemoSite, folder: &Path, progress: &ProgressBar) -> Result<(), CommandError> {
    let later = folder.join("later");
    files::create_folder(&later)?;
    for (entry, (id, truth)) in demo.site.cameras.iter().zip(&demo.truth) {
        progress.set_message(format!("rendering {id}, a month later"));
        let moved = calib_demo::changed_cameras();
        let turn = moved.iter().find(|(moved, _)| moved == id).map(|(_, turn)| *turn).unwrap_or_default();
        let image = calib_demo::render_later(&turn.apply_to(truth), entry.size_px);
        files::write_atomically(&later.join(format!("{id}_20260601_0900.png")), &picture::png(&image)?)?;
        progress.inc(1);
    }
    Ok(())
}

/// Creates the folder with a marker file. Without `force`, an existing folder must be empty or have the marker file.
fn prepare_folder(folder: &Path, force: bool) -> Result<(), CommandError> {
    let ours = folder.join(MARKER_FILE);
    let is_empty = std::fs::read_dir(folder).map_or(true, |mut entries| entries.next().is_none());
    if !is_empty && !ours.exists() && !force {
        let message = format!(
            "{} already exists and was not written by this command; add --force to overwrite its files",
            folder.display()
        );
        return Err(CommandError::Failed(anyhow::anyhow!(message)));
    }
    files::create_folder(folder)?;
    files::write_atomically(
        &ours,
        b"This folder was written by `calib demo`. Another run overwrites its files.\n",
    )
}

/// Returns the foot points of people who walk through the site, as a detector would report them in every
/// camera.
fn detections(demo: &DemoSite) -> String {
    let cameras: Vec<(Camera, [u32; 2])> = demo
        .truth
        .iter()
        .zip(&demo.site.cameras)
        .map(|((_, camera), entry)| (*camera, entry.size_px))
        .collect();
    let row = |seen: calib_demo::FootDetection| {
        let (at_s, id, Pixel { u, v }) =
            (seen.moment as f64 * Walk::STEP, &demo.truth[seen.camera].0, seen.pixel);
        format!("{at_s:.1},{id},{u:.1},{v:.1}\n")
    };
    let rows: String = calib_demo::walk(&cameras, 1).detections.into_iter().map(row).collect();
    format!("at_s,camera,u,v\n{rows}")
}

/// Writes overlays of every camera and of the plan, and images of the floor error.
fn draw(folder: &Path, progress: &ProgressBar) -> Result<(), CommandError> {
    let file = SiteFile::read(&folder.join("solved.json").to_string_lossy())?;
    for camera in &file.site.cameras {
        progress.set_message(format!("drawing {}", camera.id));
        for (sigma, prefix) in [(false, "overlay"), (true, "sigma")] {
            if sigma && camera.camera().is_none() {
                continue;
            }
            let (image, svg) = camera_view(&file, camera, Extras { sigma, ..Extras::default() })?;
            let path = folder.join(format!("{prefix}-{}.png", camera.id));
            files::write_atomically(&path, &picture::png(&draw_on(&svg, &image)?)?)?;
        }
        progress.inc(1);
    }
    let (ground, svg) = plan_view(&file.site, file.plan_image()?);
    files::write_atomically(&folder.join("overlay-plan.png"), &picture::png(&draw_on(&svg, &ground)?)?)?;
    progress.inc(1);
    Ok(())
}

/// Errors of one camera against ground truth, each with its predicted standard deviation.
struct Errors {
    roll_deg: (f64, Option<f64>),
    pitch_deg: (f64, Option<f64>),
    focal_percent: (f64, Option<f64>),
    yaw_deg: Option<(f64, Option<f64>)>,
    /// Position error and its standard deviation, in metres; absent if the position is unknown.
    position_m: Option<(f64, Option<f64>)>,
    floor_m: Option<f64>,
    /// Error and standard deviation, in degrees, of the heading of the image's top edge. It replaces roll and
    /// yaw for a camera that looks straight down, whose roll and yaw are one rotation.
    image_top_deg: Option<(f64, Option<f64>)>,
}

impl Errors {
    fn new(entry: &SiteCamera, truth: &Camera) -> Option<Self> {
        let (found, solution) = (entry.camera()?, entry.solution.as_ref()?);
        let sigma = |value: fn(&Sigmas) -> Option<f64>| solution.sigma.as_ref().and_then(value);
        let half = std::f64::consts::PI;
        let is_placed = solution.stage > Stage::Partial;
        let spread = |c: &Camera| {
            let axes = [Covariance::X, Covariance::Y, Covariance::Z];
            let sigmas: Vec<f64> = axes.iter().filter_map(|&axis| c.covariance.sigma(axis)).collect();
            (sigmas.len() == axes.len()).then(|| sigmas.iter().map(|s| s * s).sum::<f64>().sqrt())
        };
        let turn = |a: f64, b: f64| ((a - b + half).rem_euclid(2.0 * half) - half).to_degrees();
        let tops = [&found, truth].map(Camera::straight_down);
        let top = |[found, truth]: [StraightDown; 2]| {
            (turn(found.heading, truth.heading), found.heading_sigma.map(f64::to_degrees))
        };
        let tops = if let [Some(found), Some(truth)] = tops { Some([found, truth]) } else { None };
        Some(Self {
            image_top_deg: tops.filter(|_| is_placed).map(top),
            roll_deg: (turn(found.roll, truth.roll), sigma(|s| s.roll_deg)),
            pitch_deg: (turn(found.pitch, truth.pitch), sigma(|s| s.pitch_deg)),
            focal_percent: (
                100.0 * (found.focal / truth.focal - 1.0),
                sigma(|s| s.focal_px).map(|s| 100.0 * s / found.focal),
            ),
            yaw_deg: is_placed.then(|| (turn(found.yaw, truth.yaw), sigma(|s| s.yaw_deg))),
            position_m: is_placed.then(|| (found.position.distance(truth.position), spread(&found))),
            floor_m: floor_error(entry, &found, truth).filter(|_| is_placed),
        })
    }

    fn json(&self) -> serde_json::Value {
        let pair = |(error, sigma): (f64, Option<f64>)| serde_json::json!({ "error": error, "sigma": sigma });
        let mut json = serde_json::json!({
            "roll_deg": pair(self.roll_deg),
            "pitch_deg": pair(self.pitch_deg),
            "focal_percent": pair(self.focal_percent),
            "yaw_deg": self.yaw_deg.map(pair),
            "position_m": self.position_m.map(pair),
            "floor_m": self.floor_m,
        });
        if let Some(top) = self.image_top_deg {
            json["image_top_deg"] = pair(top);
        }
        json
    }

    fn row(&self, id: &str) -> String {
        let cell = |(error, sigma): (f64, Option<f64>)| match sigma {
            Some(sigma) => format!("{error:+.2} \u{b1} {sigma:.2}"),
            None => format!("{error:+.2}"),
        };
        let placed = |pair: Option<(f64, Option<f64>)>| pair.map_or_else(|| "-".into(), cell);
        let own_turn = |cell: String| if self.image_top_deg.is_some() { "-".into() } else { cell };
        let top = self.image_top_deg.map_or_else(String::new, |top| {
            format!("\n{id:10} looks straight down; heading error of the image's top edge: {} deg", cell(top))
        });
        format!(
            "{id:10} {:>16} {:>16} {:>18} {:>16} {:>16} {:>12}{top}",
            own_turn(cell(self.roll_deg)),
            cell(self.pitch_deg),
            cell(self.focal_percent),
            own_turn(placed(self.yaw_deg)),
            placed(self.position_m).trim_start_matches('+'),
            self.floor_m.map_or_else(|| "-".into(), |rms| format!("{rms:.2}")),
        )
    }
}

/// Formats the errors of all cameras against ground truth. A text report also contains the largest residuals of links
/// and marks. Standard deviations are missing for cameras that are placed by hand or fixed as reference.
fn comparison(demo: &DemoSite, solved: &Site, format: Format) -> String {
    let cameras = || {
        let pairs = solved.cameras.iter().zip(&demo.truth);
        pairs.map(|(entry, (id, truth))| (id, Errors::new(entry, truth)))
    };
    if format == Format::Json {
        let map: serde_json::Map<String, serde_json::Value> = cameras()
            .map(|(id, errors)| (id.clone(), errors.map_or(serde_json::Value::Null, |e| e.json())))
            .collect();
        return format!("{:#}\n", serde_json::Value::Object(map));
    }
    let head = format!(
        "Errors against ground truth (\u{b1} predicted standard deviation; missing for cameras placed by hand or fixed as reference)\n\
         {:10} {:>16} {:>16} {:>18} {:>16} {:>16} {:>12}\n",
        "camera", "roll deg", "pitch deg", "focal %", "yaw deg", "position m", "floor m",
    );
    let table = cameras().fold(head, |text, (id, errors)| {
        let row = errors.map_or_else(|| format!("{id:10} not solved"), |errors| errors.row(id));
        format!("{text}{row}\n")
    });
    table + &agreement(solved)
}

/// Formats the number of links and of marks, and the largest residual of each kind, in pixels.
fn agreement(solved: &Site) -> String {
    let links = solved.links.iter().filter_map(|link| Some(("links", link.solution.as_ref()?)));
    let marks = solved.marks.iter().filter_map(|mark| Some(("marks", mark.solution.as_ref()?)));
    let mut worst: BTreeMap<&str, (usize, f64)> = BTreeMap::new();
    for (what, solution) in links.chain(marks) {
        let (count, most) = worst.entry(what).or_default();
        *count += 1;
        *most = solution.residuals.iter().map(|seen| seen.px).fold(*most, f64::max);
    }
    worst.iter().fold(String::new(), |text, (what, (count, px))| {
        format!("{text}{count} {what} agree within {px:.1} px in all their views\n")
    })
}

/// Computes the RMS distance, in metres, between the floor points of the estimated and the true camera, at
/// sample pixels of the EFOV.
fn floor_error(entry: &SiteCamera, found: &Camera, truth: &Camera) -> Option<f64> {
    let corners = entry.efov_px.as_ref()?;
    let centre = corners
        .iter()
        .fold([0.0, 0.0], |sum, p| [sum[0] + p.u, sum[1] + p.v])
        .map(|c| c / corners.len() as f64);
    let squares: Vec<f64> = corners
        .iter()
        .flat_map(|p| {
            [0.2, 0.5, 0.9]
                .map(|t| Pixel::new(centre[0] + t * (p.u - centre[0]), centre[1] + t * (p.v - centre[1])))
        })
        .filter_map(|p| Some(found.pixel_to_floor(p, 0.0)?.distance(truth.pixel_to_floor(p, 0.0)?).powi(2)))
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}
