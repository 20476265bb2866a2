//! Accuracy on real data: errors, their standard deviations, and the coverage of the reported intervals
//! (fraction of intervals that contain the true value).

use calib_core::{Annotation, Camera, Code, Covariance, DistortionModel, Kind, Pixel};

use calib_site::{DistortionEntry, LensEntry, Options, Site, SiteCamera, Solution};
use serde_json::Value;

use crate::workspace;

/// Probability levels of the intervals whose coverage is plotted.
const INTERVAL_LEVELS: [f64; 9] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.95];

/// Errors of one quantity on one data set.
struct Errors {
    name: &'static str,
    /// Unit of the error.
    unit: &'static str,
    /// Error of every result in `unit`, and the same error divided by its standard deviation.
    each: Vec<(f64, f64)>,
}

/// Prints the table of errors on real data as Markdown, and writes the plot of the coverage.
pub(crate) fn run() -> anyhow::Result<()> {
    let real = workspace::root().join("../shared/real");
    if !real.is_dir() {
        println!("skipped: {} does not exist", real.display());
        return Ok(());
    }
    let road = real.join("road");
    let rooms = read_site(&real.join("rooms/rooms.json"))?;
    let unknown_centre = solved(&without_principal_points(&rooms));
    let rooms = solved(&rooms);
    let sets = [
        focals("rooms: focal length", &rooms, |_| true),
        focals("rooms, principal point unknown", &unknown_centre, |_| true),
        roads("motorways: ratios of distances", &road, &["s1_center.json", "s1_right.json"])?,
        roads("motorways, two cameras jointly", &road, &["joint_s1.json"])?,
    ];
    let determined = [
        focals("rooms, focal length well determined", &rooms, determines_focal),
        focals("rooms, principal point unknown, well determined", &unknown_centre, determines_focal),
    ];
    let [focal, turns] = shelter(&real.join("meva/meva.json"))?;
    println!(
        "| data | results | mean error | median | 90th | > 20 % off | 50 % coverage | 80 % coverage | 95 % coverage |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    sets.iter().chain(&determined).chain([&focal, &turns]).for_each(print_row);
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
    let gross = match set.unit {
        "%" => {
            let gross = errors.iter().filter(|error| **error > 20.0).count() as f64 / errors.len() as f64;
            format!("{:.1} %", 100.0 * gross)
        }
        _ => String::new(),
    };
    let [half, most, nearly] = [0.5, 0.8, 0.95].map(|level| 100.0 * coverage(set, level));
    println!(
        "| {} | {} | {:.2} {unit} | {:.2} {unit} | {:.1} {unit} | {gross} | {half:.0} % | {most:.0} % | {nearly:.1} % |",
        set.name,
        errors.len(),
        errors.iter().sum::<f64>() / errors.len() as f64,
        at(0.5),
        at(0.9),
        unit = set.unit,
    );
}

/// Returns the fraction of results whose interval of this level contains the true value.
fn coverage(set: &Errors, level: f64) -> f64 {
    let bound = normal_quantile(0.5 + 0.5 * level);
    let held = set.each.iter().filter(|(_, z)| z.abs() <= bound).count();
    held as f64 / set.each.len() as f64
}

/// Returns the quantile of the standard normal distribution (Abramowitz and Stegun 1964, 26.2.23, to 5e-4).
fn normal_quantile(probability: f64) -> f64 {
    let t = (-2.0 * (1.0 - probability).ln()).sqrt();
    let above = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let below = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    t - above / below
}

fn read_site(path: &std::path::Path) -> anyhow::Result<Site> {
    Ok(Site::from_json(&std::fs::read_to_string(path)?)?)
}

fn solved(site: &Site) -> Site {
    site.calibrate(&Options::default()).write_into(site)
}

/// Returns the site without the entered principal points, so that they are unknown.
fn without_principal_points(site: &Site) -> Site {
    let mut unknown = site.clone();
    for lens in unknown.cameras.iter_mut().filter_map(|camera| camera.lens.as_mut()) {
        lens.principal_point_px = None;
    }
    unknown
}

/// Computes the focal length errors on photographs of rooms with manually annotated lines. The reference is a
/// chessboard calibration. `counts` selects the solutions that are included.
fn focals(name: &'static str, site: &Site, counts: impl Fn(&Solution) -> bool) -> Errors {
    /// Focal length of the chessboard calibration, in pixels.
    const TRUE_FOCAL_PX: f64 = 519.16;
    let error = |camera: Camera| {
        let sigma = camera.covariance.sigma(Covariance::FOCAL)?;
        let relative = (camera.focal / TRUE_FOCAL_PX).ln();
        Some((100.0 * (camera.focal / TRUE_FOCAL_PX - 1.0), relative * camera.focal / sigma))
    };
    let solutions = site.cameras.iter().filter_map(|entry| entry.solution.as_ref());
    let cameras = solutions.filter(|solution| counts(solution)).filter_map(Solution::camera);
    Errors { name, unit: "%", each: cameras.filter_map(error).collect() }
}

/// Whether the solution has no warning about an unobservable, ambiguous or contradictory focal length.
fn determines_focal(solution: &Solution) -> bool {
    let doubts = [Code::FocalUnobservable, Code::TwoSolutions, Code::Misfit];
    !solution.warnings.iter().any(|warning| doubts.contains(&warning.code))
}

/// Computes the errors of the surveillance cameras of a shelter. Each camera is solved separately from
/// manually annotated lines, with its true distortion.
///
/// Returns the focal length errors, and the pitch and roll errors together. The reference is a calibration by
/// surveyed points.
fn shelter(path: &std::path::Path) -> anyhow::Result<[Errors; 2]> {
    /// Standard deviation of the gravity direction in the reference calibration, in degrees.
    const GRAVITY_SIGMA_DEG: f64 = 0.8;
    let data: Value = serde_json::from_str(&std::fs::read_to_string(path)?)?;
    let (mut focals, mut turns) = (Vec::new(), Vec::new());
    for (id, camera) in data["cameras"].as_object().into_iter().flatten() {
        if camera["lines"].is_null() {
            continue;
        }
        let number = |key: &str| camera["truth"][key].as_f64().unwrap_or(f64::NAN);
        let site = Site { cameras: vec![annotated_shelter_camera(id, camera)?], ..Site::new() };
        let solved = site.calibrate(&Options::default()).write_into(&site);
        let Some(found) = solved.cameras[0].camera() else { continue };
        let sigma = |index: usize| found.covariance.sigma(index).unwrap_or(f64::INFINITY);
        let focal = found.focal / number("focal_px");
        focals.push((100.0 * (focal - 1.0), focal.ln() * found.focal / sigma(Covariance::FOCAL)));
        let angles =
            [(found.pitch, "pitch_down_deg", Covariance::PITCH), (found.roll, "roll_deg", Covariance::ROLL)];
        turns.extend(angles.map(|(angle, truth, index)| {
            let error = angle.to_degrees() - number(truth);
            (error, error / sigma(index).to_degrees().hypot(GRAVITY_SIGMA_DEG))
        }));
    }
    let focals = Errors { name: "surveillance cameras: focal length", unit: "%", each: focals };
    Ok([focals, Errors { name: "surveillance cameras: pitch and roll", unit: "\u{b0}", each: turns }])
}

/// Creates the site entry of a shelter camera, with its annotations and its true distortion. The focal length
/// stays unknown.
fn annotated_shelter_camera(id: &str, camera: &Value) -> anyhow::Result<SiteCamera> {
    let truth = |key: &str| camera["truth"][key].as_f64();
    let distortion = DistortionEntry {
        k1: truth("k1"),
        k2: truth("k2"),
        focal_px: truth("focal_px"),
        ..DistortionEntry::new(DistortionModel::BrownConrady)
    };
    let lens = LensEntry {
        principal_point_px: serde_json::from_value(camera["truth"]["principal_point"].clone())?,
        distortion: Some(distortion),
        ..LensEntry::default()
    };
    let lines = |kind, key: &str| -> anyhow::Result<Annotation> {
        let segments: Vec<Vec<Pixel>> = serde_json::from_value(camera["lines"][key].clone())?;
        Ok(Annotation::from_segments(kind, segments))
    };
    let along = Annotation { id: Some("along".into()), ..lines(Kind::Parallel, "floor_parallel")? };
    let across =
        Annotation { at_right_angles_to: along.id.clone(), ..lines(Kind::Parallel, "floor_perpendicular")? };
    let annotations = vec![lines(Kind::Vertical, "vertical")?, along, across];
    let size = serde_json::from_value(camera["size"].clone())?;
    Ok(SiteCamera { lens: Some(lens), annotations, ..SiteCamera::new(id, size) })
}

/// Computes the errors of ratios of measured distances on motorways.
fn roads(name: &'static str, folder: &std::path::Path, files: &[&str]) -> anyhow::Result<Errors> {
    let truth: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("truth.json"))?)?;
    let mut each = Vec::new();
    for file in files {
        let site = solved(&read_site(&folder.join(file))?);
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
    Ok(Errors { name, unit: "%", each })
}

/// Distance measured on the road: end points in pixels, and length in metres.
struct Distance {
    ends: [Pixel; 2],
    metres: f64,
}

impl Distance {
    fn read(value: &Value) -> Option<Self> {
        let pixel = |key: &str| Some(Pixel::new(value[key][0].as_f64()?, value[key][1].as_f64()?));
        Some(Self { ends: [pixel("p1")?, pixel("p2")?], metres: value["m"].as_f64()? })
    }

    /// Computes the logarithm of the distance on the floor. Also computes its derivatives with respect to the
    /// camera parameters, and its variance for an annotation noise of 1 px.
    fn log_length(&self, camera: &Camera) -> Option<LogLength> {
        let [a, b] = self.ends.map(|pixel| camera.pixel_to_floor(pixel, 0.0));
        let (a, b) = (a?, b?);
        let length = a.distance(b);
        let along = [(a.x - b.x) / length, (a.y - b.y) / length];
        let (mut by, mut clicks) = ([0.0; Covariance::SIZE], 0.0);
        for (pixel, sign) in self.ends.into_iter().zip([1.0, -1.0]) {
            let jacobian = camera.floor_jacobian(pixel)?;
            for (by, [x, y]) in by.iter_mut().zip(jacobian) {
                *by += sign * (along[0] * x + along[1] * y) / length;
            }
            let [[xx, xy], [_, yy]] = camera.floor_covariance(pixel, 1.0)?.pixel;
            let [x, y] = along;
            clicks += (x * x * xx + 2.0 * x * y * xy + y * y * yy) / (length * length);
        }
        Some(LogLength { value: length.ln(), jacobian: by, click_variance: clicks })
    }
}

/// Logarithm of a length on the floor, its derivatives with respect to the camera parameters, and its
/// variance from annotation noise of 1 px.
struct LogLength {
    value: f64,
    jacobian: [f64; Covariance::SIZE],
    click_variance: f64,
}

/// Computes the error of the ratio of two distances in per cent, and the error divided by its standard
/// deviation.
///
/// The variance includes the camera's covariance and a noise of 1 px for each end point of the reference
/// distances.
fn ratio_error(camera: &Camera, [a, b]: [&Distance; 2]) -> Option<(f64, f64)> {
    let (seen_a, seen_b) = (a.log_length(camera)?, b.log_length(camera)?);
    let error = seen_a.value - seen_b.value - (a.metres / b.metres).ln();
    let by: [f64; Covariance::SIZE] = std::array::from_fn(|k| seen_a.jacobian[k] - seen_b.jacobian[k]);
    let carried = |i: usize| (0..by.len()).map(|j| camera.covariance.0[i][j] * by[j]).sum::<f64>();
    let variance = (0..by.len()).map(|i| by[i] * carried(i)).sum::<f64>()
        + seen_a.click_variance
        + seen_b.click_variance;
    Some((100.0 * error.exp_m1(), error / variance.sqrt()))
}

/// Plots the coverage against the level of the intervals as SVG, one line per data set. On the diagonal the
/// coverage equals the level.
fn svg(sets: &[Errors]) -> String {
    let colours = ["#0b6bcb", "#7c3aed", "#c2410c", "#15803d"];
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
    text += "<text x=\"200\" y=\"369\" text-anchor=\"middle\" fill=\"#111827\">interval level, %</text><text x=\"50\" y=\"18\" fill=\"#111827\">intervals that contain the true value, %</text>\n";
    for (index, set) in sets.iter().enumerate() {
        let points: Vec<String> =
            INTERVAL_LEVELS.iter().map(|&level| place(level, coverage(set, level))).collect();
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
