//! Automatic calibrations of images, compared with the known cameras.
//!
//! The constants of the method were chosen on the rooms of even index; the assertions use the rooms of odd
//! index. `cargo xtask accuracy --proposals` prints the table.

use std::collections::BTreeMap;
use std::io::Read as _;

use calib_core::{BrownConrady, Camera, Distortion, Lens, Orientation, Pixel, WorldPoint};

use calib_core::single::Known;

use calib_demo::random::normal;
use calib_image::{
    AutomaticCalibration, Bars, Confidence, EdgeClass, EdgeImage, LineSegment, Reason, line_segments,
};
use calib_site::{LensEntry, Options, PrincipalPointEntry, Site, Solution};
use calib_tests::{Scratch, shared};
use image::{Rgb, RgbImage};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Error of one automatic calibration.
struct CalibrationError {
    confidence: Confidence,
    log_focal: f64,
    /// Predicted relative standard deviation of the focal length.
    sigma: f64,
    /// Error in degrees, if the truth is known.
    pitch: Option<f64>,
    roll: Option<f64>,
    /// Largest distance between the estimated and the true horizon within the image, in image heights.
    horizon: Option<f64>,
}

/// Automatic calibrations of one set of images.
struct Measured {
    name: &'static str,
    offered: usize,
    each: Vec<CalibrationError>,
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1) as f64;
    values.get((share * last).round() as usize).copied().unwrap_or(f64::NAN)
}

/// Returns the area under the cumulative distribution of the horizon error, up to a quarter of the image
/// height.
fn horizon_auc(errors: impl Iterator<Item = f64>, of: usize) -> f64 {
    const MOST: f64 = 0.25;
    errors.map(|error| (1.0 - error / MOST).max(0.0)).sum::<f64>() / of.max(1) as f64
}

impl Measured {
    fn answered(&self) -> Vec<&CalibrationError> {
        self.each.iter().filter(|off| off.confidence != Confidence::None).collect()
    }

    fn sure(&self) -> Vec<&CalibrationError> {
        self.each.iter().filter(|off| off.confidence == Confidence::Sure).collect()
    }

    fn focal(offs: &[&CalibrationError], share: f64) -> f64 {
        quantile(offs.iter().map(|off| off.log_focal.abs()).collect(), share)
    }

    fn gross(offs: &[&CalibrationError]) -> usize {
        offs.iter().filter(|off| off.log_focal.abs() > 0.2).count()
    }

    fn inside(offs: &[&CalibrationError]) -> f64 {
        let held = offs.iter().filter(|off| off.log_focal.abs() < 1.96 * off.sigma).count();
        held as f64 / offs.len().max(1) as f64
    }

    fn angle(offs: &[&CalibrationError], of: fn(&CalibrationError) -> Option<f64>) -> f64 {
        quantile(offs.iter().filter_map(|off| of(off)).map(f64::abs).collect(), 0.5)
    }

    fn row(&self) -> String {
        let (answered, sure) = (self.answered(), self.sure());
        let horizons: Vec<f64> = self.each.iter().filter_map(|off| off.horizon).collect();
        format!(
            "| {} | {} | {} sure, {} check | {:.1} % | {:.1} % | {:.2} | {:.2} | {} of {} | {} of {} | {:.0} % | {:.1} |",
            self.name,
            self.offered,
            sure.len(),
            answered.len() - sure.len(),
            100.0 * Self::focal(&answered, 0.5),
            100.0 * Self::focal(&answered, 0.9),
            Self::angle(&answered, |off| off.pitch),
            Self::angle(&answered, |off| off.roll),
            Self::gross(&sure),
            sure.len(),
            Self::gross(&answered),
            answered.len(),
            100.0 * Self::inside(&answered),
            100.0 * horizon_auc(horizons.iter().copied(), horizons.len()),
        )
    }
}

const HEAD: &str = "| images | count | answered | focal error median | 90th | pitch deg | roll deg | gross errors among sure | gross errors among answered | coverage of 95 % | horizon AUC |\n|---|---|---|---|---|---|---|---|---|---|---|";

/// Returns the v coordinate of the horizon at a u coordinate, both relative to the principal point.
fn horizon_at(at: &Orientation, x: f64) -> f64 {
    (-at.focal * at.pitch.tan() - x * at.roll.sin()) / at.roll.cos()
}

/// Returns the largest distance between two horizons over the image width, in image heights.
fn horizon_error(found: &Orientation, truth: &Orientation, centre: Pixel, size: [f64; 2]) -> f64 {
    let apart = |x: f64| (horizon_at(found, x) - horizon_at(truth, x)).abs();
    apart(-centre.u).max(apart(size[0] - centre.u)) / size[1]
}

fn orientation(solution: &Solution) -> Orientation {
    Orientation {
        roll: solution.roll_deg.unwrap().to_radians(),
        pitch: solution.pitch_deg.unwrap().to_radians(),
        focal: solution.focal_px,
    }
}

/// Detected line segments of one room, and its camera from manually annotated lines with the known focal length.
struct Room {
    segments: Vec<LineSegment>,
    truth: Option<Orientation>,
}

/// Returns the rooms with their focal length and principal point.
fn rooms() -> Option<(Vec<Room>, f64, Pixel)> {
    let mut text = String::new();
    let file = std::fs::File::open(shared("real/rooms/segments.json.gz")?).unwrap();
    flate2::read::GzDecoder::new(file).read_to_string(&mut text).unwrap();
    let data: Value = serde_json::from_str(&text).unwrap();
    let focal = data["focal_px"].as_f64().unwrap();
    let truths = truths(focal)?;
    let segment = |ends: &Value| {
        let [x1, y1, x2, y2]: [f64; 4] = serde_json::from_value(ends.clone()).unwrap();
        LineSegment::new([Pixel::new(x1, y1), Pixel::new(x2, y2)], LineSegment::DETECTOR_SIGMA_PX)
    };
    let room = |(id, image): (&String, &Value)| Room {
        segments: image["segments"].as_array().unwrap().iter().map(segment).collect(),
        truth: truths.get(id).copied(),
    };
    let rooms = data["images"].as_object().unwrap().iter().map(room).collect();
    Some((rooms, focal, serde_json::from_value(data["principal_point_px"].clone()).unwrap()))
}

/// Calibrates the rooms from manually annotated lines, with the true focal length fixed.
fn truths(focal: f64) -> Option<BTreeMap<String, Orientation>> {
    let text = std::fs::read_to_string(shared("real/rooms/rooms.json")?).unwrap();
    let mut site = Site::from_json(&text).unwrap();
    for lens in site.cameras.iter_mut().filter_map(|camera| camera.lens.as_mut()) {
        lens.focal_px = Some(Known::fixed(focal));
    }
    let report = site.calibrate(&Options::default());
    let solved = report.cameras.iter().filter_map(|(index, found)| {
        Some((site.cameras[*index].id.clone(), orientation(found.as_ref().ok()?)))
    });
    Some(solved.collect())
}

const ROOM: [f64; 2] = [640.0, 480.0];

fn measured_rooms(name: &'static str, half: usize) -> Option<(Measured, Measured)> {
    let (rooms, focal, centre) = rooms()?;
    let rooms: Vec<&Room> = rooms.iter().skip(half).step_by(2).collect();
    let off = |confidence, found: Orientation, sigma: f64, truth: Option<Orientation>| CalibrationError {
        confidence,
        log_focal: (found.focal / focal).ln(),
        sigma,
        pitch: truth.map(|truth| (found.pitch - truth.pitch).to_degrees()),
        roll: truth.map(|truth| (found.roll - truth.roll).to_degrees()),
        horizon: truth.map(|truth| horizon_error(&found, &truth, centre, ROOM)),
    };
    let proposed = rooms.iter().filter_map(|room| {
        let still = EdgeImage {
            known: LensEntry {
                principal_point_px: Some(PrincipalPointEntry::known(centre)),
                ..LensEntry::default()
            },
            ..EdgeImage::new(room.segments.clone(), [640, 480])
        };
        let proposal = AutomaticCalibration::new(&EdgeImage { lens: Some(Lens::pinhole(centre)), ..still });
        let solution = proposal.solution.as_ref()?;
        Some(off(proposal.confidence, orientation(solution), proposal.focal_sigma_rel?, room.truth))
    });
    let each = proposed.collect();
    let baseline = rooms.iter().filter_map(|room| {
        Some(off(Confidence::Check, ransac(&room.segments, centre)?, f64::NAN, room.truth))
    });
    let baseline = Measured { name: "the same, RANSAC", offered: rooms.len(), each: baseline.collect() };
    Some((Measured { name, offered: rooms.len(), each }, baseline))
}

/// Estimates the orientation with the usual baseline, RANSAC. Three times, it intersects 500 random pairs of edges,
/// selects the intersection with the most edges within 2 degrees, and removes these edges. The most vertical
/// intersection is the zenith. The other points count as horizontal directions: the first with a real focal length
/// determines the focal length.
fn ransac(segments: &[LineSegment], centre: Pixel) -> Option<Orientation> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let relative = |p: Pixel| [p.u - centre.u, p.v - centre.v];
    let mut left: Vec<[[f64; 2]; 2]> = segments.iter().map(|segment| segment.ends.map(relative)).collect();
    let mut points: Vec<[f64; 3]> = Vec::new();
    for _ in 0..3 {
        let best = (0..500)
            .filter_map(|_| {
                let [a, b] = [0, 0].map(|_| left[random.random_range(0..left.len())]);
                let point = meeting(a, b)?;
                Some((left.iter().filter(|line| passes(line, point)).count(), point))
            })
            .max_by_key(|(count, _)| *count)?;
        left.retain(|line| !passes(line, best.1));
        points.push(best.1);
        if left.len() < 2 {
            break;
        }
    }
    let lean = |p: &[f64; 3]| (p[0] / p[1]).abs();
    let down = points.iter().copied().min_by(|a, b| lean(a).total_cmp(&lean(b)))?;
    let square = |p: &[f64; 3]| -(p[0] * down[0] + p[1] * down[1]) / (p[2] * down[2]);
    let focal =
        points.iter().filter(|point| **point != down).map(square).find(|square| *square > 0.0)?.sqrt();
    let [x, y, w] = down.map(|c| c * down[1].signum());
    Some(Orientation { roll: x.atan2(y), pitch: (focal * w).atan2(x.hypot(y)), focal })
}

fn meeting([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> Option<[f64; 3]> {
    let through = |p: [f64; 2], q: [f64; 2]| [p[1] - q[1], q[0] - p[0], p[0] * q[1] - p[1] * q[0]];
    let (l, m) = (through(a, b), through(c, d));
    let point = [l[1] * m[2] - l[2] * m[1], l[2] * m[0] - l[0] * m[2], l[0] * m[1] - l[1] * m[0]];
    point.iter().any(|c| c.abs() > 1e-6).then_some(point)
}

fn passes([a, b]: &[[f64; 2]; 2], point: [f64; 3]) -> bool {
    let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let [s, t] = [point[0] - middle[0] * point[2], point[1] - middle[1] * point[2]];
    let (x, y) = (b[0] - a[0], b[1] - a[1]);
    (s * y - t * x).abs() < 2.0_f64.to_radians().sin() * s.hypot(t) * x.hypot(y)
}

#[test]
fn rooms_are_calibrated_or_abstain() {
    let Some((measured, baseline)) = measured_rooms("rooms, validation half", 1) else { return };
    let (answered, sure) = (measured.answered(), measured.sure());
    println!("{HEAD}\n{}\n{}", measured.row(), baseline.row());
    assert!(answered.len() * 5 > measured.offered * 2, "{}", measured.row());
    assert!(
        Measured::focal(&answered, 0.5) < 0.025 && Measured::focal(&answered, 0.9) < 0.09,
        "{}",
        measured.row()
    );
    assert!(Measured::angle(&answered, |off| off.pitch) < 0.6, "{}", measured.row());
    assert!(Measured::angle(&answered, |off| off.roll) < 0.25, "{}", measured.row());
    assert!(Measured::gross(&sure) * 100 <= sure.len(), "{}", measured.row());
    assert!(Measured::inside(&answered) > 0.9, "{}", measured.row());
    assert!(Measured::focal(&answered, 0.5) < 0.5 * Measured::focal(&baseline.answered(), 0.5));
}

fn proposal_of(image: &RgbImage) -> AutomaticCalibration {
    AutomaticCalibration::new(&EdgeImage::new(line_segments(image), [image.width(), image.height()]))
}

/// Returns the error of the automatic calibration of an image.
fn of_image(image: &RgbImage, truth: &Orientation) -> Option<CalibrationError> {
    off(&proposal_of(image), truth)
}

fn off(proposal: &AutomaticCalibration, truth: &Orientation) -> Option<CalibrationError> {
    let found = orientation(proposal.solution.as_ref()?);
    Some(CalibrationError {
        confidence: proposal.confidence,
        log_focal: (found.focal / truth.focal).ln(),
        sigma: proposal.focal_sigma_rel?,
        pitch: Some((found.pitch - truth.pitch).to_degrees()),
        roll: Some((found.roll - truth.roll).to_degrees()),
        horizon: None,
    })
}

/// Prints the errors per image and returns the number of gross errors with confidence "sure".
fn gross_among_sure(name: &str, offs: &[(String, Option<CalibrationError>)]) -> usize {
    for (id, off) in offs {
        match off {
            Some(off) => println!(
                "{name} {id}: {}, focal {:+.1} % +- {:.1} %, pitch {:+.2}, roll {:+.2} degrees",
                off.confidence.name(),
                100.0 * off.log_focal,
                100.0 * off.sigma,
                off.pitch.unwrap_or(f64::NAN),
                off.roll.unwrap_or(f64::NAN),
            ),
            None => println!("{name} {id}: no result"),
        }
    }
    let is_gross = |off: &CalibrationError| off.confidence == Confidence::Sure && off.log_focal.abs() > 0.2;
    offs.iter().filter(|(_, off)| off.as_ref().is_some_and(is_gross)).count()
}

#[test]
fn demonstration_has_no_gross_errors() {
    let demo = calib_demo::demo_site();
    let of = |(camera, (id, truth)): (&calib_site::SiteCamera, &(String, Camera))| {
        let at = Orientation { roll: truth.roll, pitch: truth.pitch, focal: truth.focal };
        (id.clone(), of_image(&calib_demo::render(truth, camera.size_px), &at))
    };
    let offs: Vec<(String, Option<CalibrationError>)> =
        demo.site.cameras.iter().zip(&demo.truth).map(of).collect();
    assert_eq!(gross_among_sure("demonstration", &offs), 0);
}

/// Calibrates the cameras of the demonstration except the fisheye, with a focal length that is `factor` times the
/// true one. Returns the results and the true focal lengths.
fn with_known_focal(factor: f64) -> Vec<(AutomaticCalibration, f64)> {
    let demo = calib_demo::demo_site();
    let flat = demo.site.cameras.iter().zip(&demo.truth).filter(|(_, (id, _))| id != "checkouts");
    let of = |(entry, (_, truth)): (&calib_site::SiteCamera, &(String, Camera))| {
        let focal = factor * truth.focal;
        let known = LensEntry { focal_px: Some(Known::prior(focal, 0.03 * focal)), ..LensEntry::default() };
        let image = calib_demo::render(truth, entry.size_px);
        let edges = EdgeImage { known, ..EdgeImage::new(line_segments(&image), entry.size_px) };
        (AutomaticCalibration::new(&edges), truth.focal)
    };
    flat.map(of).collect()
}

#[test]
fn known_focal_length_is_used_and_a_wrong_one_is_reported() {
    for (found, truth) in with_known_focal(1.03) {
        let focal = found.solution.unwrap().focal_px;
        let sigma = found.focal_sigma_rel.unwrap();
        assert_eq!(found.confidence, Confidence::Sure, "{:?}", found.reasons);
        assert!(sigma < 0.03 && (focal / truth).ln().abs() < 3.0 * sigma, "{focal} {truth} {sigma}");
        assert!(found.camera.unwrap().lens.unwrap().focal_px.is_some(), "the entry keeps the known value");
    }
    for (found, _) in with_known_focal(1.6) {
        assert_ne!(found.confidence, Confidence::Sure);
        assert!(found.reasons.contains(&Reason::FocalConflict), "{:?}", found.reasons);
    }
}

#[test]
fn solution_has_the_standard_deviation_of_the_confidence() {
    let demo = calib_demo::demo_site();
    let flat = demo.site.cameras.iter().zip(&demo.truth).filter(|(_, (id, _))| id != "checkouts");
    for (entry, (id, truth)) in flat {
        let found = proposal_of(&calib_demo::render(truth, entry.size_px));
        let solution = found.solution.unwrap();
        let of_solution = solution.sigma.unwrap().focal_px.unwrap() / solution.focal_px;
        let stated = found.focal_sigma_rel.unwrap();
        assert!((0.95..1.05).contains(&(of_solution / stated)), "{id}: {of_solution} {stated}");
        let drawn = found.camera.unwrap().annotations;
        let of_groups: Vec<_> = found.groups.iter().map(|group| group.annotation.clone()).collect();
        assert_eq!(drawn, of_groups);
    }
}

#[test]
fn a_known_roll_finds_cameras_upside_down_and_on_their_side() {
    let demo = calib_demo::demo_site();
    let (entry, (_, truth)) = (&demo.site.cameras[0], &demo.truth[0]);
    let image = calib_demo::render(truth, entry.size_px);
    let upright = proposal_of(&image);
    let expected = upright.solution.as_ref().unwrap();
    assert_ne!(upright.confidence, Confidence::None, "{:?}", upright.reasons);
    // An image that is rotated clockwise by 90 degrees has the nadir at its left side, and so the roll -90 degrees.
    let turned = [
        (-90.0, image::imageops::rotate90(&image)),
        (180.0, image::imageops::rotate180(&image)),
        (90.0, image::imageops::rotate270(&image)),
    ];
    for (roll, image) in turned {
        let known = LensEntry { roll_deg: Some(Known::prior(roll, 5.0)), ..LensEntry::default() };
        let edges = EdgeImage::new(line_segments(&image), image.dimensions().into());
        let still = EdgeImage { known, ..edges };
        let found = AutomaticCalibration::new(&still);
        assert_eq!(found.confidence, upright.confidence, "{roll}: {:?}", found.reasons);
        let solution = found.solution.as_ref().unwrap();
        let off = [
            (solution.focal_px / expected.focal_px).ln(),
            (solution.pitch_deg.unwrap() - expected.pitch_deg.unwrap()).to_radians(),
            ((solution.roll_deg.unwrap() - expected.roll_deg.unwrap() - roll + 180.0).rem_euclid(360.0)
                - 180.0)
                .to_radians(),
        ];
        // The detector finds slightly different edges in a rotated image.
        assert!(off.iter().all(|off| off.abs() < 0.01), "{roll}: {off:?}");
        let camera = found.camera.as_ref().unwrap();
        assert_eq!(camera.size_px, [image.width(), image.height()]);
        let inside = |at: &Pixel| {
            (-1.0..=f64::from(image.width()) + 1.0).contains(&at.u)
                && (-1.0..=f64::from(image.height()) + 1.0).contains(&at.v)
        };
        let drawn = camera.annotations.iter().flat_map(|drawn| drawn.segments.iter().flatten().flatten());
        assert!(drawn.clone().count() > 10 && drawn.clone().all(inside));
    }
    // A wrong roll is not accepted without a doubt.
    let known = LensEntry { roll_deg: Some(Known::prior(180.0, 5.0)), ..LensEntry::default() };
    let wrong = EdgeImage { known, ..EdgeImage::new(line_segments(&image), entry.size_px) };
    let found = AutomaticCalibration::new(&wrong);
    let is_doubted = found.reasons.iter().any(|reason| matches!(reason, Reason::MayBeUpsideDown { .. }));
    assert!(found.confidence != Confidence::Sure && is_doubted, "{:?}", found.reasons);
}

#[test]
fn round_image_needs_a_known_lens() {
    let demo = calib_demo::demo_site();
    let (id, camera) = demo.truth.last().unwrap();
    let entry = demo.site.cameras.last().unwrap();
    assert_eq!((id.as_str(), entry.id.as_str()), ("checkouts", "checkouts"));
    let image = calib_demo::render(camera, entry.size_px);
    let circle = calib_image::image_circle(&image);
    assert!(circle.is_some());
    let still = EdgeImage { image_circle: circle, ..EdgeImage::new(line_segments(&image), entry.size_px) };
    let proposal = AutomaticCalibration::new(&still);
    assert_eq!((proposal.confidence, &proposal.reasons[..]), (Confidence::None, &[Reason::RoundImage][..]));
    assert!(proposal.groups.is_empty() && proposal.reasons[0].to_string().contains("straight edges"));
}

/// Returns an image as sent by a camera: with another exposure, noise and compression.
fn sent(image: RgbImage, random: &mut ChaCha8Rng) -> RgbImage {
    let (gamma, noise) = (random.random_range(0.7..1.4_f64), random.random_range(0.0..4.0));
    let quality = random.random_range(40..=95);
    let mut image = image;
    for colour in image.iter_mut() {
        let exposed = 255.0 * (f64::from(*colour) / 255.0).powf(gamma);
        *colour = (exposed + noise * normal(random)).round().clamp(0.0, 255.0) as u8;
    }
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality);
    image.write_with_encoder(encoder).unwrap();
    image::load_from_memory(&bytes).unwrap().into_rgb8()
}

/// Returns a camera at the same horizontal position with another height, orientation and focal length.
fn with_another_mounting(camera: &Camera, random: &mut ChaCha8Rng) -> Camera {
    let mut off = |sigma: f64| sigma * normal(random);
    let position = WorldPoint { z: camera.position.z + off(0.2), ..camera.position };
    let (yaw, pitch, roll) = (camera.yaw + off(0.15), camera.pitch + off(0.07), off(0.03));
    let focal = camera.focal * off(0.15).exp();
    let lens =
        if camera.lens.distortion == Distortion::None { camera.lens } else { Lens { focal, ..camera.lens } };
    Camera { position, yaw, pitch, roll, focal, lens, ..*camera }
}

/// Counts the edges classified as on or above the floor. For each class: truly on the floor, partly, and not.
/// The truth is the visible surface on either side of the edge.
fn count_floor(
    proposal: &AutomaticCalibration,
    camera: &Camera,
    size: [u32; 2],
    counts: &mut [[usize; 3]; 2],
) {
    let is_floor = |pixel: Pixel| {
        let at = camera.pixel_to_floor(pixel, 0.0).map(|floor| floor.at_height(0.0));
        at.is_some_and(|at| calib_demo::visible(camera, size, at, 0.05))
    };
    for group in &proposal.groups {
        for (line, class) in group.annotation.polylines().zip(&group.classes) {
            let (a, b) = (line[0], line[line.len() - 1]);
            let (du, dv) = ((b.u - a.u) / a.distance(b), (b.v - a.v) / a.distance(b));
            let on_floor = |beside: f64| {
                let point = |tenth: u32| {
                    let along = 0.1 * f64::from(tenth) * a.distance(b);
                    Pixel::new(a.u + along * du - beside * dv, a.v + along * dv + beside * du)
                };
                (1..10).filter(|&tenth| is_floor(point(tenth))).count()
            };
            let seen = on_floor(5.0).max(on_floor(-5.0));
            let which = if seen >= 7 {
                0
            } else if seen > 2 {
                1
            } else {
                2
            };
            match class {
                EdgeClass::Floor => counts[0][which] += 1,
                EdgeClass::Above => counts[1][which] += 1,
                EdgeClass::Undetermined => {}
            }
        }
    }
}

#[test]
fn rendered_rooms_are_calibrated_or_abstain() {
    const STILLS: usize = 12;
    let demo = calib_demo::demo_site();
    let flat: Vec<_> =
        demo.site.cameras.iter().zip(&demo.truth).filter(|(_, (id, _))| id != "checkouts").collect();
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let (mut each, mut counts) = (Vec::new(), [[0; 3]; 2]);
    for still in 0..STILLS {
        let (entry, (_, base)) = flat[still % flat.len()];
        let camera = with_another_mounting(base, &mut random);
        let render = if still % 2 == 0 { calib_demo::render } else { calib_demo::render_later };
        let image = sent(render(&camera, entry.size_px), &mut random);
        let at = Orientation { roll: camera.roll, pitch: camera.pitch, focal: camera.focal };
        let proposal = proposal_of(&image);
        count_floor(&proposal, &camera, entry.size_px, &mut counts);
        each.extend(off(&proposal, &at));
    }
    let [floor, above] = counts;
    println!("edges classified as floor (on it, partly, not): {floor:?}; as above the floor: {above:?}");
    assert!(floor[2] * 10 <= floor.iter().sum::<usize>(), "{floor:?}");
    assert!(above[0] * 4 <= above.iter().sum::<usize>(), "{above:?}");
    let measured = Measured { name: "rooms, rendered", offered: STILLS, each };
    println!("{HEAD}\n{}", measured.row());
    let (answered, sure) = (measured.answered(), measured.sure());
    assert!(answered.len() * 2 > STILLS, "{}", measured.row());
    assert!(
        Measured::focal(&answered, 0.5) < 0.025 && Measured::focal(&answered, 0.9) < 0.09,
        "{}",
        measured.row()
    );
    assert!(Measured::angle(&answered, |off| off.pitch) < 0.6, "{}", measured.row());
    assert!(Measured::angle(&answered, |off| off.roll) < 0.2, "{}", measured.row());
    assert_eq!(Measured::gross(&sure), 0, "{}", measured.row());
    assert!(Measured::inside(&answered) > 0.9, "{}", measured.row());
}

/// Returns the brightness of a room at the first surface along a ray from inside. The floor has tiles of the size
/// `tile`, in metres; 0 for a plain floor. Doors are in all walls.
fn room_brightness(origin: WorldPoint, direction: [f64; 3], tile: f64) -> f64 {
    const LOW: [f64; 3] = [-4.5, -1.0, 0.0];
    const HIGH: [f64; 3] = [4.5, 9.0, 3.2];
    let from = [origin.x, origin.y, origin.z];
    let exit = |axis: usize| {
        let side = if direction[axis] > 0.0 { HIGH[axis] } else { LOW[axis] };
        (side - from[axis]) / direction[axis]
    };
    let axis = (0..3).min_by(|&a, &b| exit(a).total_cmp(&exit(b))).unwrap();
    let [x, y, z] = std::array::from_fn(|k| from[k] + exit(axis) * direction[k]);
    let joint = |at: f64| tile > 0.0 && (at - 0.13).rem_euclid(tile) < 0.012;
    if axis == 2 {
        return if z > 1.0 {
            215.0
        } else if joint(x) || joint(y) {
            70.0
        } else {
            140.0
        };
    }
    let along = (if axis == 0 { y } else { x } - 0.35).rem_euclid(1.9);
    match () {
        () if along < 0.9 && z < 2.0 && (0.08..0.82).contains(&along) && z < 1.92 => 110.0,
        () if along < 0.9 && z < 2.0 => 45.0,
        () if z < 0.08 => 80.0,
        () if axis == 0 => 185.0,
        () => 172.0,
    }
}

/// Renders a room with four samples a pixel.
fn render_room(camera: &Camera, [w, h]: [u32; 2], tile: f64) -> RgbImage {
    RgbImage::from_fn(w, h, |x, y| {
        let sample = |k: u32| {
            let (du, dv) = (0.25 + 0.5 * f64::from(k % 2), 0.25 + 0.5 * f64::from(k / 2));
            let ray = camera.pixel_to_ray(Pixel::new(f64::from(x) + du, f64::from(y) + dv));
            ray.map_or(0.0, |ray| room_brightness(ray.origin, ray.direction, tile))
        };
        Rgb([(0.25 * (0..4).map(sample).sum::<f64>()).round() as u8; 3])
    })
}

#[test]
fn tiled_rooms_have_the_lens_of_their_edges() {
    const SIZE: [u32; 2] = [1280, 720];
    const STILLS: usize = 8;
    let mut random = ChaCha8Rng::seed_from_u64(21);
    let mut each = Vec::new();
    for still in 0..STILLS {
        let focal = random.random_range(560.0..1100.0);
        let mut off = |sigma: f64| sigma * normal(&mut random);
        let principal_point = Pixel::new(640.0 + off(12.0), 360.0 + off(12.0));
        let k1 = [0.0, 0.0, -0.12, -0.3][still % 4];
        let brown = BrownConrady { k1, k2: 0.65 * k1 * k1, ..BrownConrady::default() };
        let distortion = if k1 == 0.0 { Distortion::None } else { Distortion::BrownConrady(brown) };
        let camera = Camera {
            position: WorldPoint { x: off(1.2), y: 0.0, z: 2.6 },
            yaw: off(0.35),
            pitch: 0.4 + off(0.08),
            roll: off(0.02),
            focal,
            lens: Lens { focal, distortion, ..Lens::pinhole(principal_point) },
            ..demo_camera()
        };
        let tile = if still % 8 < 6 { 0.6 } else { 0.0 };
        let image = sent(render_room(&camera, SIZE, tile), &mut random);
        let at = Orientation { roll: camera.roll, pitch: camera.pitch, focal };
        each.push((format!("{still} k1 {k1} focal {focal:.0}"), of_image(&image, &at)));
    }
    assert_eq!(gross_among_sure("room", &each), 0);
    let each: Vec<CalibrationError> = each.into_iter().filter_map(|(_, off)| off).collect();
    let measured = Measured { name: "tiled rooms", offered: STILLS, each };
    println!("{HEAD}\n{}", measured.row());
    let (answered, sure) = (measured.answered(), measured.sure());
    assert!(answered.len() * 4 > STILLS * 3 && sure.len() * 2 > STILLS, "{}", measured.row());
    assert!(sure.iter().all(|off| off.log_focal.abs() < 3.0 * off.sigma), "{}", measured.row());
    assert!(Measured::inside(&answered) > 0.92, "{}", measured.row());
    assert!(Measured::focal(&answered, 0.5) < 0.01, "{}", measured.row());
}

/// Returns a camera whose exact covariance is used in struct updates.
fn demo_camera() -> Camera {
    calib_demo::demo_site().truth[0].1
}

#[test]
fn the_centre_of_the_picture_between_bars_is_used() {
    let camera = Camera {
        position: WorldPoint { x: 0.8, y: 0.0, z: 2.6 },
        yaw: 0.3,
        pitch: 0.4,
        roll: -0.02,
        focal: 800.0,
        lens: Lens::pinhole(Pixel::new(480.0, 360.0)),
        ..demo_camera()
    };
    let picture = render_room(&camera, [960, 720], 0.6);
    let image =
        RgbImage::from_fn(
            1280,
            720,
            |x, y| {
                if x < 320 { Rgb([16; 3]) } else { *picture.get_pixel(x - 320, y) }
            },
        );
    let bars = Bars::find(&image);
    assert_eq!(bars, Bars { left: 320, ..Bars::NONE });
    let proposal =
        AutomaticCalibration::new(&EdgeImage::new(line_segments(&image), [1280, 720]).with_bars(bars));
    let solution = proposal.solution.as_ref().unwrap();
    assert!((solution.focal_px / 800.0 - 1.0).abs() < 0.02, "{}", solution.focal_px);
    assert!((solution.roll_deg.unwrap().to_radians() + 0.02).abs() < 0.005, "{:?}", solution.roll_deg);
    assert_eq!(proposal.confidence, Confidence::Check);
    assert!(proposal.reasons[0].to_string().contains("left 320 px"), "{:?}", proposal.reasons);
}

#[test]
fn streets_have_no_gross_errors() {
    let Some(town) = shared("real/town/town.json") else { return };
    let data: Value = serde_json::from_str(&std::fs::read_to_string(&town).unwrap()).unwrap();
    let of = |id: &&str| {
        let image = image::open(town.with_file_name(id).join("0000.jpg")).unwrap().into_rgb8();
        let pitch = data[*id]["pitch_deg"].as_f64().unwrap().to_radians();
        ((*id).to_owned(), of_image(&image, &Orientation { roll: 0.0, pitch, focal: 900.0 }))
    };
    let offs: Vec<(String, Option<CalibrationError>)> = ["C1", "C2", "C3"].iter().map(of).collect();
    assert_eq!(gross_among_sure("town", &offs), 0);
    let Some(meva) = shared("real/meva/meva.json") else { return };
    let data: Value = serde_json::from_str(&std::fs::read_to_string(&meva).unwrap()).unwrap();
    let of = |id: &&str| {
        let image = image::open(meva.with_file_name("frames").join(format!("{id}.png"))).unwrap().into_rgb8();
        let focal = data["cameras"][*id]["truth"]["focal_px"].as_f64().unwrap();
        ((*id).to_owned(), of_image(&image, &Orientation { roll: 0.0, pitch: 0.0, focal }))
    };
    let offs: Vec<(String, Option<CalibrationError>)> = ["G341", "G505", "G506"].iter().map(of).collect();
    assert_eq!(gross_among_sure("meva", &offs), 0);
}

/// Returns images without a recognisable structure of verticals and floor directions.
fn images_without_structure() -> Vec<(&'static str, RgbImage)> {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut grey = |_, _| Rgb([random.random_range(0..=255_u8); 3]);
    let noise = RgbImage::from_fn(640, 480, &mut grey);
    let gradient = RgbImage::from_fn(640, 480, |x, y| Rgb([(x / 4) as u8, (y / 4) as u8, 90]));
    let texture = RgbImage::from_fn(640, 480, |x, y| {
        let weave = (f64::from(x) * 0.31).sin() * (f64::from(y) * 0.27 + 0.002 * f64::from(x * y % 97)).sin();
        Rgb([(128.0 + 90.0 * weave) as u8; 3])
    });
    let board =
        RgbImage::from_fn(640, 480, |x, y| Rgb([if (x / 40 + y / 40) % 2 == 0 { 40 } else { 210 }; 3]));
    let dot = RgbImage::from_pixel(1, 1, Rgb([7; 3]));
    // Tree trunks lean in random directions, and the ground has no edges.
    let trunks: Vec<[f64; 4]> = (0..40)
        .map(|_| {
            let mut of = |from: f64, to: f64| random.random_range(from..to);
            [of(0.0, 640.0), of(-0.25, 0.25), of(2.0, 14.0), of(-0.0006, 0.0006)]
        })
        .collect();
    let mut leaves = ChaCha8Rng::seed_from_u64(5);
    let forest = RgbImage::from_fn(640, 480, |x, y| {
        let is_trunk = trunks.iter().any(|[at, lean, wide, bend]| {
            let up = 480.0 - f64::from(y);
            (f64::from(x) - at - lean * up - bend * up * up).abs() < 0.5 * wide
        });
        let green: u8 = leaves.random_range(60..140);
        if is_trunk { Rgb([70, 50, 35]) } else { Rgb([green / 2, green, green / 3]) }
    });
    let face = RgbImage::from_fn(640, 480, |x, y| {
        let within = |u: f64, v: f64, a: f64, b: f64| {
            ((f64::from(x) - u) / a).powi(2) + ((f64::from(y) - v) / b).powi(2) < 1.0
        };
        let is_dark = within(265.0, 200.0, 24.0, 12.0)
            || within(375.0, 200.0, 24.0, 12.0)
            || within(320.0, 330.0, 55.0, 14.0);
        match () {
            () if is_dark => Rgb([60, 40, 40]),
            () if within(320.0, 240.0, 130.0, 175.0) => Rgb([224, 180, 150]),
            () => Rgb([90, 110, 130]),
        }
    });
    vec![
        ("forest", forest),
        ("face", face),
        ("noise", noise),
        ("gradient", gradient),
        ("texture", texture),
        ("board", board),
        ("dot", dot),
    ]
}

#[test]
fn images_without_structure_abstain() {
    for (name, image) in images_without_structure() {
        let proposal = proposal_of(&image);
        assert_eq!(proposal.confidence, Confidence::None, "{name}: {:?}", proposal.solution);
        assert!(!proposal.reasons.is_empty(), "{name} has no reason");
    }
}

#[test]
fn any_set_of_edges_is_accepted() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for count in [0, 1, 7, 8, 60, 3000] {
        let mut pixel = || Pixel::new(random.random_range(-50.0..700.0), random.random_range(-50.0..500.0));
        let segments = (0..count).map(|_| LineSegment::new([pixel(), pixel()], 0.5)).collect();
        let proposal = AutomaticCalibration::new(&EdgeImage::new(segments, [640, 480]));
        assert_eq!(proposal.confidence, Confidence::None, "{count}: {:?}", proposal.solution);
    }
    let same = LineSegment::new([Pixel::new(10.0, 20.0), Pixel::new(300.0, 40.0)], 0.5);
    assert_eq!(
        AutomaticCalibration::new(&EdgeImage::new(vec![same; 50], [640, 480])).confidence,
        Confidence::None
    );
    let point = LineSegment::new([Pixel::new(f64::NAN, 0.0); 2], 0.0);
    assert_eq!(
        AutomaticCalibration::new(&EdgeImage::new(vec![point; 50], [640, 480])).confidence,
        Confidence::None
    );
}

#[test]
fn command_accepts_edges_that_determine_the_lens() {
    let scratch = Scratch::new();
    let demo = calib_demo::demo_site();
    let distorted =
        demo.truth.iter().position(|(_, camera)| camera.lens.distortion != Distortion::None).unwrap();
    calib_demo::render(&demo.truth[distorted].1, demo.site.cameras[distorted].size_px)
        .save(scratch.path("bent.png"))
        .unwrap();
    scratch.calib(&["propose", "bent.png", "-o", "site.json", "--accept", "all"]).expect_code(0);
    let read = |name: &str| Site::from_json(&std::fs::read_to_string(scratch.path(name)).unwrap()).unwrap();
    let mut site = read("site.json");
    let focal = site.cameras[0].solution.as_ref().unwrap().focal_px;
    let edges = site.cameras[0].annotations.iter().filter(|drawn| drawn.is_straight_edge()).count();
    assert!((1..=8).contains(&edges), "{edges} edges");
    // Without the lens and solution in the file, the straight edges determine the lens.
    site.cameras[0].lens = None;
    site.cameras[0].solution = None;
    std::fs::write(scratch.path("edges.json"), site.to_json()).unwrap();
    scratch.calib(&["solve", "edges.json", "-o", "solved.json"]).expect_code(0);
    let solution = read("solved.json").cameras[0].solution.clone().unwrap();
    assert!(
        solution.distortion.is_some() && (solution.focal_px / focal - 1.0).abs() < 0.05,
        "{}",
        solution.focal_px
    );
}

#[test]
fn command_writes_accepted_groups_and_abstains_with_exit_4() {
    let scratch = Scratch::new();
    let folder = scratch.path("stills");
    std::fs::create_dir(&folder).unwrap();
    let demo = calib_demo::demo_site();
    let (id, truth) = &demo.truth[0];
    calib_demo::render(truth, demo.site.cameras[0].size_px).save(folder.join("shop.png")).unwrap();
    images_without_structure()[0].1.save(folder.join("noise.png")).unwrap();
    let args =
        ["propose", "stills", "-o", "site.json", "--accept", "all", "--format", "json", "--render", "seen"];
    let run = scratch.calib(&args).expect_code(4);
    assert!(run.stderr.contains("noise") && run.stderr.contains("1 of 2"), "{}", run.stderr);
    assert!(!run.stderr.contains("outside"), "{}", run.stderr);
    let cameras = run.json()["cameras"].clone();
    assert_eq!(cameras[0]["id"], "noise");
    assert_eq!(cameras[0]["verdict"], "none");
    assert!(!cameras[0]["reason"].as_str().unwrap().is_empty());
    let group = &cameras[1]["groups"][0];
    assert!((0.0..=1.0).contains(&group["probability"].as_f64().unwrap()), "{id}: {group}");
    let site = Site::from_json(&std::fs::read_to_string(scratch.path("site.json")).unwrap()).unwrap();
    let strokes: usize = site.cameras[1].annotations.iter().flat_map(|a| &a.segments).map(Vec::len).sum();
    assert!((4..=20).contains(&strokes) && site.cameras[1].solution.is_some(), "{strokes} strokes");
    assert!(
        site.cameras[0].annotations.is_empty()
            && site.cameras[0].image.as_deref() == Some("stills/noise.png")
    );
    assert!(scratch.path("seen/shop.png").exists());
    scratch.calib(&["render", "site.json", "--camera", "shop", "-o", "again.png"]).expect_code(0);
    scratch.calib(&["propose", "stills", "-o", "site.json"]).expect_code(1);
    scratch.calib(&["propose", "nowhere.png"]).expect_code(3);
    scratch.calib(&["propose", "stills/noise.png", "--accept", "sure"]).expect_code(4);
    std::fs::create_dir(scratch.path("elsewhere")).unwrap();
    let run = scratch.calib(&["propose", "stills/noise.png", "-o", "elsewhere/site.json"]).expect_code(4);
    let expected = "images outside the folder of elsewhere/site.json: 1 of 1.";
    assert!(run.stderr.contains(expected) && run.stderr.contains("--allow-outside"), "{}", run.stderr);
}
