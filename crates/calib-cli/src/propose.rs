//! `calib propose`: the calibration that stills propose by themselves, or none.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use calib_core::{Annotation, ImageCircle};
use calib_image::{Group, Proposal, Still, Verdict, image_circle, line_segments};
use calib_report::{few, is_fitted, overlay, straight_down};
use calib_site::{Options, Site, SiteCamera};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};

use crate::files::ThreadsArgs;
use crate::files::{self, say};
use crate::painting::draw_on;
use crate::picture;
use crate::site_file;
use crate::site_file::beside;
use crate::solve::Format;
use crate::stop::Stop;
use crate::stop::visible;

/// Which proposals are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Accept {
    /// Those that may be used as they are
    Sure,
    /// Those that want a look, too
    Check,
    /// Whatever was found
    All,
}

impl Accept {
    fn takes(self, proposal: &Proposal) -> bool {
        match self {
            Self::Sure => proposal.verdict == Verdict::Sure,
            Self::Check => proposal.verdict != Verdict::None,
            Self::All => proposal.solution.is_some(),
        }
    }
}

/// Arguments of `calib propose`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Stills (PNG, JPEG), or folders of them
    #[arg(required = true, value_name = "STILL")]
    stills: Vec<PathBuf>,
    /// Write the site here (- is stdout)
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Which proposals are taken into the site
    #[arg(long, value_enum, default_value = "check")]
    accept: Accept,
    /// Draw what is proposed on every still, into this folder
    #[arg(long, value_name = "DIR")]
    render: Option<PathBuf>,
    /// How to report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Overwrite the output file and pictures
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadsArgs,
}

/// A still with what it proposes.
struct Proposed {
    path: PathBuf,
    size: [u32; 2],
    /// Of a fisheye, in raw pixels.
    image_circle: Option<ImageCircle>,
    proposal: Proposal,
    is_taken: bool,
}

/// Proposes, writes, reports.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    let stills = site_file::listed(&args.stills)?;
    let ids = ids(&stills);
    let mut progress = Steps::new(stills.len());
    let proposed =
        args.threads.run(stills, |path| of_still(path, args.accept), |still| progress.done(&still.path))?;
    drop(progress);
    let output = args.output.as_deref().unwrap_or("-");
    let cameras = proposed.iter().zip(ids).map(|(still, id)| camera(still, id, output)).collect();
    let site = solved(Site { cameras, ..Site::new() }, &proposed);
    if let Some(output) = &args.output {
        files::write(output, site.to_json().as_bytes(), args.force)?;
        tell_what_is_outside(&site, output);
    }
    if let Some(folder) = &args.render {
        draw(&site, &proposed, folder, args.force)?;
    }
    report(args, &site, &proposed)?;
    unaccepted(&site, &proposed)
}

/// Tells of stills that other commands will not read from this site without being told to.
fn tell_what_is_outside(site: &Site, output: &str) {
    let is_outside = |image: &str| Path::new(image).is_absolute() || Path::new(image).starts_with("..");
    let outside =
        site.cameras.iter().filter(|camera| camera.image.as_deref().is_some_and(is_outside)).count();
    if outside > 0 && output != "-" {
        say(format_args!(
            "calib: stills outside the folder of {output}: {outside} of {}; other commands read them with \
             --allow-outside, and without it where the site is written beside them",
            site.cameras.len()
        ));
    }
}

/// What one still proposes.
fn of_still(path: PathBuf, accept: Accept) -> Result<Proposed, Stop> {
    let image = site_file::read(&path)?;
    let size = [image.width(), image.height()];
    let image_circle = image_circle(&image);
    let principal_point = image_circle.map(ImageCircle::centre);
    let still = Still::new(line_segments(&image), size);
    let proposal = Proposal::new(&Still { principal_point, image_circle, ..still });
    let is_taken = accept.takes(&proposal);
    Ok(Proposed { path, size, image_circle, proposal, is_taken })
}

/// A name for every still: that of its file, numbered where it is taken.
fn ids(stills: &[PathBuf]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let mut id = |path: &PathBuf| {
        let stem =
            path.file_stem().map_or_else(|| "still".into(), |stem| stem.to_string_lossy().into_owned());
        let numbered = (2..).map(|number| format!("{stem}-{number}"));
        let mut names = std::iter::once(stem.clone()).chain(numbered);
        let name = names.find(|name| !taken.contains(name)).unwrap_or(stem);
        taken.insert(name.clone());
        name
    };
    stills.iter().map(&mut id).collect()
}

/// The camera of a still, with what is proposed if it is taken.
fn camera(still: &Proposed, id: String, output: &str) -> SiteCamera {
    let drawn = still.proposal.camera.clone().filter(|_| still.is_taken);
    let mut drawn = drawn.unwrap_or_else(|| SiteCamera::new(String::new(), still.size));
    if still.is_taken {
        // They say nothing while the lens is given; without it they tell it.
        drawn.annotations.extend(still.proposal.straight.iter().cloned().map(Annotation::of_points));
    }
    if still.image_circle.is_some() {
        let lens = drawn.lens.get_or_insert_default();
        // Its middle is the principal point, until the lens is fitted with one.
        (lens.image_circle_px, lens.principal_point_px) = (still.image_circle, None);
    }
    SiteCamera { id, image: Some(beside(&still.path, output)), ..drawn }
}

/// The site with every camera solved whose proposal is taken.
fn solved(site: Site, proposed: &[Proposed]) -> Site {
    let cameras = site.cameras.iter().zip(proposed).filter(|(_, proposed)| proposed.is_taken);
    let cameras: Vec<String> = cameras.map(|(camera, _)| camera.id.clone()).collect();
    if cameras.is_empty() {
        return site;
    }
    site.calibrate(&Options { cameras: Some(cameras), ..Options::default() }).write_into(&site)
}

/// A picture of every still with what is proposed on it, taken or not.
fn draw(site: &Site, proposed: &[Proposed], folder: &Path, force: bool) -> Result<(), Stop> {
    std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    for (camera, proposed) in site.cameras.iter().zip(proposed) {
        let Proposed { path, proposal, .. } = proposed;
        let shown = SiteCamera {
            annotations: proposal.groups.iter().map(|group| group.annotation.clone()).collect(),
            solution: camera.solution.clone().or_else(|| proposal.solution.clone()),
            ..camera.clone()
        };
        let alone = Site { cameras: vec![shown], ..Site::new() };
        let shown = &alone.cameras[0];
        let picture = draw_on(&overlay(&alone, shown, is_fitted(shown)), &site_file::read(path)?)?;
        let name = folder.join(format!("{}.png", camera.id)).to_string_lossy().into_owned();
        files::write(&name, &picture::encoded(&picture, &name)?, force)?;
    }
    Ok(())
}

/// stdout is the site where it is asked for there: the report goes where messages go.
fn report(args: &Args, site: &Site, proposed: &[Proposed]) -> Result<(), Stop> {
    let to_stdout = args.output.as_deref() == Some("-");
    match args.format {
        Format::Text if to_stdout => say(text(site, proposed)),
        Format::Text => files::print(&visible(&text(site, proposed)))?,
        Format::Json if to_stdout => {}
        Format::Json => files::print(&json(site, proposed)?)?,
    }
    Ok(())
}

/// Why a proposal is not sure; nothing where it is.
fn reason(proposal: &Proposal) -> String {
    proposal.reasons.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

fn text(site: &Site, proposed: &[Proposed]) -> String {
    let mut out = String::new();
    let width = site.cameras.iter().map(|camera| camera.id.chars().count()).max().unwrap_or(0).max(6);
    let _ = writeln!(
        out,
        "{:width$}  {:7} {:>7} {:>9} {:>10} {:>14} {:>8}",
        "camera", "verdict", "strokes", "roll deg", "pitch deg", "focal px", "sigma"
    );
    for (camera, Proposed { proposal, .. }) in site.cameras.iter().zip(proposed) {
        let strokes: usize = proposal.groups.iter().map(|group| group.probabilities.len()).sum();
        let _ = write!(out, "{:width$}  {:7} {strokes:>7}", camera.id, proposal.verdict.name());
        if let (Some(solution), Some(sigma)) = (&proposal.solution, proposal.focal_sigma_rel) {
            let angle = |angle: Option<f64>| angle.map_or_else(|| "-".into(), |angle| format!("{angle:.2}"));
            // Straight down roll is a part of where the image's top heads.
            let roll = solution.roll_deg.filter(|_| straight_down(solution).is_none());
            let (roll, pitch) = (angle(roll), angle(solution.pitch_deg));
            let _ =
                write!(out, " {roll:>9} {pitch:>10} {:>14.1} {:>6.1} %", solution.focal_px, 100.0 * sigma);
        }
        out.push('\n');
        for reason in &proposal.reasons {
            let _ = writeln!(out, "{:width$}    {reason}", "");
        }
    }
    out
}

fn json(site: &Site, proposed: &[Proposed]) -> Result<String, Stop> {
    let group = |(index, group): (usize, &Group)| {
        serde_json::json!({
            "annotation": index,
            "kind": group.annotation.kind.row().name,
            "probability": group.probability(),
            "segments": group.probabilities,
            "lies": group.lies,
        })
    };
    let of = |(camera, Proposed { proposal, is_taken, .. }): (&SiteCamera, &Proposed)| {
        let groups: Vec<_> = proposal.groups.iter().enumerate().map(group).collect();
        serde_json::json!({
            "id": camera.id,
            "verdict": proposal.verdict.name(),
            "reason": reason(proposal),
            "accepted": is_taken,
            "focal_px": proposal.solution.as_ref().map(|solution| solution.focal_px),
            "focal_sigma_rel": proposal.focal_sigma_rel,
            "groups": groups,
            "alternative": proposal.alternative.as_ref().map(|other| serde_json::json!({
                "focal_px": other.orientation.focal,
                "pitch_deg": other.orientation.pitch.to_degrees(),
                "roll_deg": other.orientation.roll.to_degrees(),
                "annotations": other.groups.iter().map(|group| &group.annotation).collect::<Vec<_>>(),
            })),
        })
    };
    let cameras: Vec<_> = site.cameras.iter().zip(proposed).map(of).collect();
    let mut text = serde_json::to_string_pretty(&serde_json::json!({ "cameras": cameras }))?;
    text.push('\n');
    Ok(text)
}

/// Exit 4 when a still has no proposal that is accepted, naming every one.
fn unaccepted(site: &Site, proposed: &[Proposed]) -> Result<(), Stop> {
    let without = site.cameras.iter().zip(proposed).filter(|(_, proposed)| !proposed.is_taken);
    let without: Vec<&str> = without.map(|(camera, _)| camera.id.as_str()).collect();
    if without.is_empty() {
        return Ok(());
    }
    Err(Stop::Unsolved(format!(
        "{} of {} stills have no proposal that is accepted: {}; draw on them, or look at what --accept all takes",
        without.len(),
        proposed.len(),
        few(without.iter().copied())
    )))
}

/// How far a batch is: a bar on a terminal, a line now and then elsewhere.
struct Steps {
    bar: ProgressBar,
    done: usize,
    all: usize,
    said: Instant,
}

impl Steps {
    /// Between two lines of a log.
    const LINES: Duration = Duration::from_secs(10);

    fn new(all: usize) -> Self {
        let bar = ProgressBar::new(all as u64);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}, {eta} left") {
            bar.set_style(style);
        }
        // Seen before the first still is done.
        bar.tick();
        Self { bar, done: 0, all, said: Instant::now() }
    }

    fn done(&mut self, still: &Path) {
        self.done += 1;
        self.bar.set_message(visible(&still.to_string_lossy()).into_owned());
        self.bar.set_position(self.done as u64);
        if self.bar.is_hidden() && self.said.elapsed() >= Self::LINES {
            self.said = Instant::now();
            say(format_args!("calib: {} of {} stills", self.done, self.all));
        }
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
