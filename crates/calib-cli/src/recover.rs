//! Cameras that moved, calibrated anew from what was drawn on their old stills.

use std::path::Path;

use calib_core::{Camera, Carrier, NewStill, Options, Pixel, Site, SiteCamera};
use calib_image::{Became, Carry};
use calib_report::few;
use jiff::Timestamp;

use crate::compare::{Compared, Seen, still};
use crate::files::{self, SiteFile, say};
use crate::propose::beside;
use crate::pulse::Pulse;
use crate::stop::Stop;

/// Less than this share of what was drawn is too little to calibrate by.
const LEAST: f64 = 0.5;
/// A solve farther than this from what the edges say of the turn contradicts them, in sigmas of the solve.
const APART: f64 = 4.0;

/// What leads from a camera's old still to its new one.
struct Carrying<'a>(Carry<'a>);

impl Carrier for Carrying<'_> {
    fn line(&self, points: &[Pixel], whole: bool) -> Option<Vec<Pixel>> {
        self.0.line(points, whole)
    }

    fn point(&self, old: Pixel) -> Option<Pixel> {
        self.0.point(old)
    }

    fn corner(&self, old: Pixel) -> Option<Pixel> {
        self.0.corner(old)
    }
}

/// Writes the site with every camera that moved recovered; one that cannot be stays as it is, and is named.
pub(crate) fn write(
    file: &SiteFile,
    compared: &[Compared],
    since: Option<Timestamp>,
    output: &str,
    force: bool,
) -> Result<(), Stop> {
    let mut site = file.site.clone();
    let mut recovered = 0;
    for of in
        compared.iter().filter(|of| of.last().is_some_and(|seen| seen.comparison.became != Became::Unchanged))
    {
        match of_camera(file, &site, of, since, output) {
            Ok(with) => {
                site = with;
                recovered += 1;
            }
            Err(Refusal::Because(why)) => {
                say(format_args!("calib: camera \"{}\" is not recovered: {why}", of.id));
            }
            Err(Refusal::Stop(stop)) => return Err(stop),
        }
    }
    if recovered == 0 {
        say(format_args!("calib: no camera was recovered; {output} is not written"));
        return Ok(());
    }
    files::write(output, site.to_json().as_bytes(), force)
}

/// Why a camera is not recovered.
enum Refusal {
    /// It would be a guess.
    Because(String),
    /// Its stills cannot be read.
    Stop(Stop),
}

impl From<Stop> for Refusal {
    fn from(stop: Stop) -> Self {
        Self::Stop(stop)
    }
}

fn of_camera(
    file: &SiteFile,
    site: &Site,
    of: &Compared,
    since: Option<Timestamp>,
    output: &str,
) -> Result<Site, Refusal> {
    let because = |why: &str| Refusal::Because(why.to_owned());
    let Some(seen) = of.last() else { return Err(because("it has no newer still")) };
    is_a_turn(seen.comparison.became)?;
    let entry = &site.cameras[of.index];
    if entry.annotations.is_empty() {
        return Err(because("nothing is drawn on it that could be carried; draw on the new still"));
    }
    let since = since.or_else(|| of.since().and_then(|seen| seen.time));
    let since = since.ok_or_else(|| because("the name of its still says no time; give --since TIME"))?;
    check_period(entry, since)?;
    let (old, new) = (file.camera_image(entry)?, still(entry, &seen.path)?);
    let carrying = Carrying(Carry::new(&of.camera, seen.comparison.turn, &old, &new));
    let folder = Path::new(output).parent().filter(|_| output != "-").unwrap_or(Path::new(""));
    let still = NewStill { image: beside(&seen.path, folder), since: since.to_string() };
    let carried = site.recovered(of.index, &seen.comparison.turn, &carrying, &still);
    let carried = carried.ok_or_else(|| because("it is not calibrated"))?;
    if !carried.left_out.is_empty() {
        let names = few(carried.left_out.iter().map(String::as_str));
        say(format_args!("calib: camera \"{}\": not on the new still, left out: {names}", of.id));
    }
    let all = carried.carried + carried.left_out.len();
    if (carried.carried as f64) < LEAST * all as f64 {
        let why = format!(
            "of {all} lines and points that were drawn the new still shows {}; draw on it",
            carried.carried
        );
        return Err(Refusal::Because(why));
    }
    solved(carried.site, of, seen)
}

/// Only a turn keeps the place.
fn is_a_turn(became: Became) -> Result<(), Refusal> {
    let advice = match became {
        Became::Moved => return Ok(()),
        Became::Shifted => "its old place is no longer its place; draw on the new still",
        _ => "take another still, or draw on this one",
    };
    Err(Refusal::Because(format!("{became}; {advice}")))
}

fn check_period(entry: &SiteCamera, since: Timestamp) -> Result<(), Refusal> {
    let time = since.to_string();
    let begins = entry.valid_from.as_deref().and_then(|from| from.parse::<Timestamp>().ok());
    let holds = entry.is_valid_at(&time).unwrap_or_default() && begins.is_none_or(|from| from < since);
    let why = || format!("its calibration does not hold at {time}: see its valid_from and valid_to");
    if holds { Ok(()) } else { Err(Refusal::Because(why())) }
}

/// The site with the new entry solved, and the others as they were.
fn solved(site: Site, of: &Compared, seen: &Seen) -> Result<Site, Refusal> {
    let pulse = Pulse::new("solving");
    let mut report = site.calibrate(&Options { cameras: Some(vec![of.id.clone()]), ..Options::default() });
    drop(pulse);
    report.cameras.retain(|(index, _)| *index == of.index);
    let site = report.write_into(&site);
    let entry = &site.cameras[of.index];
    let Some(found) = entry.camera() else {
        let why = entry.error.as_ref().map(|error| error.message.clone()).unwrap_or_default();
        return Err(Refusal::Because(format!("the lines that were carried do not solve it: {why}")));
    };
    let told = seen.comparison.turn.applied(&of.camera);
    match apart(&of.camera, &told, &found) {
        apart if apart < APART => Ok(site),
        apart => Err(Refusal::Because(format!(
            "solved from its carried lines it is {apart:.1} sigmas from where the edges of the image turned it; draw on the \
             new still"
        ))),
    }
}

/// How far a solve is from what the turn tells, in sigmas of both solves: those of the old one are in what it tells.
fn apart(old: &Camera, told: &Camera, found: &Camera) -> f64 {
    use calib_core::Covariance as Of;
    let off = [
        (Of::PITCH, told.pitch - found.pitch, 1.0),
        (Of::ROLL, told.roll - found.roll, 1.0),
        (Of::FOCAL, told.focal - found.focal, told.focal / old.focal),
    ];
    let sigmas = off.map(|(index, off, scale)| {
        let before = scale * old.covariance.sigma(index).unwrap_or_default();
        let sigma = found.covariance.sigma(index).unwrap_or_default().hypot(before);
        if sigma > 0.0 { off.abs() / sigma } else { 0.0 }
    });
    sigmas.into_iter().fold(0.0, f64::max)
}
