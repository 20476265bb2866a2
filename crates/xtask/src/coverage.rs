//! Whether what is stated holds: errors on real data beside their sigmas, and the share inside intervals.

use calib_core::{Camera, Covariance, Options, Pixel, Site};
use serde_json::Value;

use crate::workspace;

/// Levels of intervals whose coverage is plotted.
const LEVELS: [f64; 9] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.95];

/// Errors of one quantity on one set of data.
struct Errors {
    name: &'static str,
    /// Error in per cent, and error over sigma.
    each: Vec<(f64, f64)>,
}

/// Prints the table as Markdown and draws the plot.
pub(crate) fn run() -> anyhow::Result<()> {
    let real = workspace::root().join("../shared/real");
    if !real.is_dir() {
        println!("skipped: {} is not there", real.display());
        return Ok(());
    }
    let road = real.join("road");
    let sets = [
        rooms(&real.join("rooms"))?,
        roads("motorways: ratios of distances", &road, &["s1_center.json", "s1_right.json"])?,
        roads("motorways, two cameras jointly", &road, &["joint_s1.json"])?,
    ];
    println!(
        "| data | results | mean error | median | 90th | > 20 % off | 50 % holds | 80 % holds | 95 % holds |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    sets.iter().for_each(print_row);
    let plot = workspace::root().join(".github/coverage.svg");
    std::fs::write(&plot, svg(&sets))?;
    println!("\n{}", plot.display());
    Ok(())
}

fn print_row(set: &Errors) {
    let mut errors: Vec<f64> = set.each.iter().map(|(error, _)| error.abs()).collect();
    errors.sort_by(f64::total_cmp);
    let at =
        |share: f64| errors.get((share * (errors.len() as f64 - 1.0)) as usize).copied().unwrap_or(f64::NAN);
    let gross = errors.iter().filter(|error| **error > 20.0).count() as f64 / errors.len() as f64;
    let [half, most, nearly] = [0.5, 0.8, 0.95].map(|level| 100.0 * coverage(set, level));
    println!(
        "| {} | {} | {:.2} % | {:.2} % | {:.1} % | {:.1} % | {half:.0} % | {most:.0} % | {nearly:.1} % |",
        set.name,
        errors.len(),
        errors.iter().sum::<f64>() / errors.len() as f64,
        at(0.5),
        at(0.9),
        100.0 * gross,
    );
}

/// Share of the results whose interval of this level holds the truth.
fn coverage(set: &Errors, level: f64) -> f64 {
    let bound = normal_quantile(0.5 + 0.5 * level);
    let held = set.each.iter().filter(|(_, z)| z.abs() <= bound).count();
    held as f64 / set.each.len() as f64
}

/// The quantile of the standard normal distribution (Abramowitz and Stegun 1964, 26.2.23, to 5e-4).
fn normal_quantile(probability: f64) -> f64 {
    let t = (-2.0 * (1.0 - probability).ln()).sqrt();
    let above = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let below = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    t - above / below
}

fn solved(path: &std::path::Path) -> anyhow::Result<Site> {
    let site = Site::from_json(&std::fs::read_to_string(path)?)?;
    Ok(site.calibrate(&Options::default()).write_into(&site))
}

/// Photographs of rooms, lines by hand: the focal against that of a chessboard calibration.
fn rooms(folder: &std::path::Path) -> anyhow::Result<Errors> {
    const TRUE_FOCAL: f64 = 519.16;
    let site = solved(&folder.join("rooms.json"))?;
    let error = |camera: Camera| {
        let sigma = camera.covariance.sigma(Covariance::FOCAL)?;
        let relative = (camera.focal / TRUE_FOCAL).ln();
        Some((100.0 * (camera.focal / TRUE_FOCAL - 1.0), relative * camera.focal / sigma))
    };
    let cameras = site.cameras.iter().filter_map(|entry| entry.solution.as_ref()?.camera());
    Ok(Errors { name: "rooms: focal", each: cameras.filter_map(error).collect() })
}

/// Motorways: ratios of measured distances.
fn roads(name: &'static str, folder: &std::path::Path, files: &[&str]) -> anyhow::Result<Errors> {
    let truth: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("truth.json"))?)?;
    let mut each = Vec::new();
    for file in files {
        let site = solved(&folder.join(file))?;
        for entry in &site.cameras {
            let measured = truth["distances"][&entry.id].as_array().into_iter().flatten();
            let Some(camera) = entry.solution.as_ref().and_then(|solution| solution.camera()) else {
                continue;
            };
            let distances: Vec<Distance> = measured.filter_map(Distance::read).collect();
            let pairs = (0..distances.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
            each.extend(pairs.filter_map(|(i, j)| ratio_error(&camera, [&distances[i], &distances[j]])));
        }
    }
    Ok(Errors { name, each })
}

/// A distance measured on the road.
struct Distance {
    ends: [Pixel; 2],
    metres: f64,
}

impl Distance {
    fn read(value: &Value) -> Option<Self> {
        let pixel = |key: &str| Some(Pixel::new(value[key][0].as_f64()?, value[key][1].as_f64()?));
        Some(Self { ends: [pixel("p1")?, pixel("p2")?], metres: value["m"].as_f64()? })
    }

    /// Log of the length that a camera sees.
    fn log_length(&self, camera: &Camera, moved: Option<(usize, usize)>) -> Option<f64> {
        let mut ends = self.ends;
        match moved {
            Some((end, 0)) => ends[end].u += STEP,
            Some((end, _)) => ends[end].v += STEP,
            None => {}
        }
        let [a, b] = ends.map(|pixel| camera.pixel_to_floor(pixel, 0.0));
        let (a, b) = (a?, b?);
        Some((a.x - b.x).hypot(a.y - b.y).ln())
    }
}

/// Step of differences, in pixels, radians and thousandths of the focal.
const STEP: f64 = 1e-4;

/// The error of the ratio of two distances in per cent, and over its sigma: that of roll, pitch and focal, and
/// 1 px for each click of the truth.
fn ratio_error(camera: &Camera, pair: [&Distance; 2]) -> Option<(f64, f64)> {
    let [a, b] = pair;
    let log_ratio = |camera: &Camera| Some(a.log_length(camera, None)? - b.log_length(camera, None)?);
    let here = log_ratio(camera)?;
    let error = here - (a.metres / b.metres).ln();
    let of = [Covariance::ROLL, Covariance::PITCH, Covariance::FOCAL];
    let mut gradient = [0.0; 3];
    for (k, slot) in gradient.iter_mut().enumerate() {
        let mut nudged = *camera;
        let step = match k {
            0 => &mut nudged.roll,
            1 => &mut nudged.pitch,
            _ => &mut nudged.focal,
        };
        let size = if k == 2 { STEP * camera.focal } else { STEP };
        *step += size;
        *slot = (log_ratio(&nudged)? - here) / size;
    }
    let mut variance = 0.0;
    for (i, x) in gradient.iter().enumerate() {
        for (j, y) in gradient.iter().enumerate() {
            variance += x * y * camera.covariance.0[of[i]][of[j]];
        }
    }
    for distance in pair {
        for click in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let slope =
                (distance.log_length(camera, Some(click))? - distance.log_length(camera, None)?) / STEP;
            variance += slope * slope;
        }
    }
    Some((100.0 * (error.exp() - 1.0), error / variance.sqrt()))
}

/// Coverage over level, one line a set; the diagonal is what was promised.
fn svg(sets: &[Errors]) -> String {
    let colours = ["#0b6bcb", "#c2410c", "#15803d"];
    let place = |x: f64, y: f64| format!("{:.1},{:.1}", 50.0 + 300.0 * x, 330.0 - 300.0 * y);
    let mut text = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 620 380\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"620\" height=\"380\" fill=\"#fff\"/>\n",
    );
    for tick in 0..=5 {
        let share = f64::from(tick) / 5.0;
        let (x, y) = (50.0 + 300.0 * share, 330.0 - 300.0 * share);
        text += &format!(
            "<path d=\"M{x:.0} 30V330M50 {y:.0}H350\" stroke=\"#e5e7eb\"/><text x=\"{x:.0}\" y=\"348\" text-anchor=\"middle\" fill=\"#4b5563\">{:.0}</text><text x=\"44\" y=\"{:.0}\" text-anchor=\"end\" fill=\"#4b5563\">{:.0}</text>\n",
            100.0 * share,
            y + 4.0,
            100.0 * share,
        );
    }
    text += &format!(
        "<path d=\"M{} L{}\" stroke=\"#9ca3af\" stroke-dasharray=\"4 4\" fill=\"none\"/>\n",
        place(0.0, 0.0),
        place(1.0, 1.0)
    );
    text += "<text x=\"200\" y=\"369\" text-anchor=\"middle\" fill=\"#111827\">level of the interval, %</text><text x=\"50\" y=\"18\" fill=\"#111827\">share of results that it holds, %</text>\n";
    for (index, set) in sets.iter().enumerate() {
        let points: Vec<String> = LEVELS.iter().map(|&level| place(level, coverage(set, level))).collect();
        let y = 60.0 + 24.0 * index as f64;
        text += &format!(
            "<path d=\"M{}\" stroke=\"{colour}\" stroke-width=\"2.5\" fill=\"none\"/><path d=\"M370 {y}h24\" stroke=\"{colour}\" stroke-width=\"2.5\"/><text x=\"402\" y=\"{:.0}\" fill=\"#111827\">{} ({})</text>\n",
            points.join(" L"),
            y + 4.0,
            set.name,
            set.each.len(),
            colour = colours[index % colours.len()],
        );
    }
    text + "</svg>\n"
}
