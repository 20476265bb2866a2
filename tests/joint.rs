//! Joint refinement of random sites, compared with the truth.

use calib_core::{
    Annotation, BrownConrady, Camera, Code, Covariance, Distortion, DistortionModel, FloorPoint, Kind, Lens,
    MarkKind, MarkShape, Pixel, UndistortedPixel, WorldPoint,
};

use calib_core::camera::Coefficient;

use calib_core::floor::STAGE_1_HEIGHT;

use calib_core::single::Known;

use calib_demo::layout::Layout;
use calib_demo::random::{AnnotationSet, RandomScene, SIZE, normal};
use calib_site::{
    Distance, DistortionEntry, LensEntry, Link, LinkKind, LinkObservation, Mark, MarkObservation, Options,
    PlacementEntry, Report, Scale, SceneEntry, Site, SiteCamera, Stage,
};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

fn solve(layout: &Layout) -> Report {
    layout.site.calibrate(&Options::default())
}

fn cameras(report: &Report) -> Vec<Camera> {
    report
        .cameras
        .iter()
        .map(|(_, solution)| {
            let solution = solution.as_ref().unwrap();
            assert_eq!(solution.stage, Stage::Refined, "{:?}", solution.warnings);
            solution.camera().unwrap()
        })
        .collect()
}

fn turn(a: f64, b: f64) -> f64 {
    (a - b + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn exact_layouts_are_found() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..10 {
        let mut layout = Layout::ring(&mut random, 3, 8, 0.0);
        layout.place_first();
        let report = solve(&layout);
        for (found, truth) in cameras(&report).iter().zip(&layout.truth) {
            let off = found.position.distance(truth.position);
            assert!(off < 1e-5, "{off} m: {:?}", report.site.warnings);
            assert!(turn(found.yaw, truth.yaw).abs() < 1e-6);
        }
    }
}

#[test]
fn three_cameras_without_a_plan_are_accurate() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let [mut position, mut height, mut yaw, mut gaps]: [Vec<f64>; 4] = Default::default();
    let (mut covered, mut trials) = (0, 0);
    for _ in 0..100 {
        let mut layout = Layout::ring(&mut random, 3, 8, 1.0);
        layout.place_first();
        let report = solve(&layout);
        let found = cameras(&report);
        for (found, truth) in found.iter().zip(&layout.truth).skip(1) {
            position.push(found.position.on_floor().distance(truth.position.on_floor()));
            height.push((found.position.z - truth.position.z).abs());
            yaw.push(turn(found.yaw, truth.yaw).to_degrees().abs());
            for (index, off) in [
                (Covariance::X, found.position.x - truth.position.x),
                (Covariance::Y, found.position.y - truth.position.y),
                (Covariance::Z, found.position.z - truth.position.z),
            ] {
                trials += 1;
                covered += usize::from(off.abs() < 1.96 * found.covariance.sigma(index).unwrap());
            }
        }
        // Floor points without annotations, mapped by every camera.
        for _ in 0..20 {
            let at = FloorPoint { x: random.random_range(-3.0..3.0), y: random.random_range(-3.0..3.0) };
            let put: Vec<_> = found
                .iter()
                .zip(&layout.truth)
                .filter_map(|(found, truth)| {
                    found.pixel_to_floor(truth.world_to_pixel(at.at_height(0.0))?, 0.0)
                })
                .collect();
            for pair in put.windows(2) {
                gaps.push(pair[0].distance(pair[1]));
            }
        }
    }
    let coverage = 100.0 * covered as f64 / trials as f64;
    let [position, height, yaw, gap] = [position, height, yaw, gaps].map(|mut values| median(&mut values));
    println!(
        "position {position:.4} m, height {height:.4} m, yaw {yaw:.3} deg, disagreement {:.2} cm, coverage {coverage:.1} %",
        100.0 * gap
    );
    assert!(position < 0.065, "{position} m");
    assert!(yaw < 0.2, "{yaw} deg");
    assert!(gap < 0.015, "{gap} m");
    assert!((90.0..98.0).contains(&coverage), "{coverage} %");
}

#[test]
fn wrong_link_is_rejected_and_site_stays_correct() {
    const TRIALS: usize = 100;
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let (mut named, mut accused, mut far) = (0, 0, 0);
    for _ in 0..TRIALS {
        let mut layout = Layout::ring(&mut random, 3, 20, 1.0);
        layout.place_first();
        let wrong = random.random_range(0..20);
        let which = random.random_range(0..3);
        let pixel = layout.site.links[wrong].seen[which].px.as_mut().unwrap();
        let angle = random.random_range(0.0..std::f64::consts::TAU);
        let by = random.random_range(30.0..200.0);
        (pixel.u, pixel.v) = (pixel.u + by * f64::cos(angle), pixel.v + by * f64::sin(angle));
        let report = solve(&layout);
        let aside = |index: usize| {
            report.links[index].as_ref().is_some_and(|l| l.residuals.iter().any(|r| r.outlier))
        };
        named += usize::from(aside(wrong));
        accused += (0..20).filter(|&index| index != wrong && aside(index)).count();
        let worst = cameras(&report)
            .iter()
            .zip(&layout.truth)
            .map(|(a, b)| a.position.distance(b.position))
            .fold(0.0, f64::max);
        far += usize::from(worst > 0.5);
    }
    println!(
        "{named} of {TRIALS} wrong links rejected, {accused} of {} correct links rejected, {far} sites inaccurate",
        19 * TRIALS
    );
    assert!(named >= 95 && accused <= TRIALS / 10 && far <= 2);
}

#[test]
fn chain_drifts_and_a_loop_corrects_it() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut drift = |closed: bool| {
        let (mut worst, mut covered, mut closures) = (Vec::new(), (0, 0), Vec::new());
        for _ in 0..8 {
            let mut layout = Layout::chain(&mut random, 20, closed, 8, 1.0);
            layout.place_first();
            let report = solve(&layout);
            let found = cameras(&report);
            let off = found.iter().zip(&layout.truth).map(|(a, b)| a.position.distance(b.position));
            worst.push(off.fold(0.0, f64::max));
            closures.extend(report.site.loop_closure_m);
            for (found, truth) in found.iter().zip(&layout.truth).skip(1) {
                let sigma = found.covariance.sigma(Covariance::X).unwrap();
                covered.1 += 1;
                covered.0 += usize::from((found.position.x - truth.position.x).abs() < 3.0 * sigma);
            }
        }
        assert_eq!(closures.is_empty(), !closed, "a chain has no loop");
        (median(&mut worst), covered, closures.iter().copied().fold(0.0, f64::max))
    };
    let (open, open_covered, _) = drift(false);
    let (closed, closed_covered, closure) = drift(true);
    println!(
        "open chain {open:.3} m, closed {closed:.3} m, loop closure {closure:.3} m, inside 3 sigma {open_covered:?} {closed_covered:?}"
    );
    assert!(closed < 0.7 * open, "open {open} m, closed {closed} m");
    for (inside, all) in [open_covered, closed_covered] {
        assert!(inside as f64 > 0.95 * all as f64, "{inside} of {all} inside 3 sigma");
    }
}

/// Returns an annotated scene with lens distortion and straight edges, without noise.
fn distorted_scene(random: &mut ChaCha8Rng, tangential: bool) -> (SiteCamera, Camera) {
    let hfov = random.random_range(60.0..95.0);
    let scene = RandomScene::new(random, AnnotationSet::Directions, Some(hfov), None);
    let [w, h] = SIZE;
    let (beside, above) = (0.1 * w, 0.1 * h);
    let corners = [[-beside, -above], [w + beside, -above], [w + beside, h + above], [-beside, h + above]];
    let corners = corners.map(Pixel::from);
    let focal = 0.5 * w.hypot(h);
    // A real lens is valid up to the corners of its image, and this one a little beyond. A fit whose lens
    // folds inside the image is clipped there, so the bound would not apply.
    let lens = loop {
        let k1 = random.random_range(-0.3..-0.05);
        let k2 = random.random_range(0.0..0.05) - 0.3 * k1 * k1;
        let mut shift = || if tangential { random.random_range(-0.003..0.003) } else { 0.0 };
        let brown = BrownConrady { k1, k2, k3: 0.0, p1: shift(), p2: shift() };
        let lens = Lens { focal, distortion: Distortion::BrownConrady(brown), ..scene.camera.lens };
        if corners.iter().all(|&corner| lens.undistort(corner).is_some()) {
            break lens;
        }
    };
    let camera = Camera { lens, ..scene.camera };
    let bend = |pixel: Pixel| lens.distort(UndistortedPixel { u: pixel.u, v: pixel.v });
    let mut entry = SiteCamera::new("c", SIZE.map(|side| side as u32));
    entry.sigma_px = Some(1.0);
    entry.scene = Some(SceneEntry::EXACT);
    entry.annotations = scene.annotations.clone();
    for pixel in entry.annotations.iter_mut().flat_map(|a| a.segments.iter_mut().flatten().flatten()) {
        *pixel = bend(*pixel).unwrap();
    }
    // Long edges of nine points anywhere in the image.
    while entry.annotations.iter().filter(|a| a.kind == Kind::Straight).count() < 8 {
        let mut end = || Pixel::new(random.random_range(0.0..SIZE[0]), random.random_range(0.0..SIZE[1]));
        let (a, b) = (end(), end());
        if a.distance(b) < 900.0 {
            continue;
        }
        let at = |i: usize| {
            bend(Pixel::new(a.u + (b.u - a.u) * i as f64 / 8.0, a.v + (b.v - a.v) * i as f64 / 8.0))
        };
        let points: Option<Vec<Pixel>> = (0..9).map(at).collect();
        entry.annotations.extend(
            points.map(|points| Annotation { points: Some(points), ..Annotation::new(Kind::Straight) }),
        );
    }
    let fit = if tangential {
        vec![Coefficient::K1, Coefficient::K2, Coefficient::P1, Coefficient::P2]
    } else {
        vec![Coefficient::K1, Coefficient::K2]
    };
    let distortion =
        DistortionEntry { fit: Some(fit), ..DistortionEntry::new(DistortionModel::BrownConrady) };
    entry.lens = Some(LensEntry { distortion: Some(distortion), ..LensEntry::default() });
    (entry, camera)
}

fn draw(entry: &SiteCamera, random: &mut ChaCha8Rng) -> SiteCamera {
    let mut drawn = entry.clone();
    for annotation in &mut drawn.annotations {
        let points =
            annotation.segments.iter_mut().flatten().flatten().chain(annotation.points.iter_mut().flatten());
        for pixel in points {
            *pixel = Pixel::new(pixel.u + normal(random), pixel.v + normal(random));
        }
    }
    drawn
}

#[test]
fn lens_fitted_with_stage_1_reaches_the_bound_and_its_sigmas_are_correct() {
    for tangential in [false, true] {
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let names = ["roll", "pitch", "focal", "k1", "k2", "p1", "p2"];
        let (mut squares, mut covered, mut trials) = ([0.0; 7], [0; 7], 0);
        for _ in 0..100 {
            let (entry, truth) = distorted_scene(&mut random, tangential);
            for _ in 0..8 {
                let mut site = Site::new();
                site.cameras.push(draw(&entry, &mut random));
                let report = site.calibrate(&Options::default());
                let Ok(solution) = &report.cameras[0].1 else { continue };
                let found = solution.camera().unwrap();
                let given = DistortionEntry::from_lens(&truth.lens, truth.focal).unwrap();
                let (fit, sigma) = (solution.distortion.as_ref().unwrap(), solution.sigma.as_ref().unwrap());
                let degrees = |a: f64, b: f64| (a - b).to_degrees();
                let off = |a: Option<f64>, b: Option<f64>| a.unwrap_or(0.0) - b.unwrap_or(0.0);
                let errors = [
                    (degrees(found.roll, truth.roll), sigma.roll_deg),
                    (degrees(found.pitch, truth.pitch), sigma.pitch_deg),
                    (found.focal - truth.focal, sigma.focal_px),
                    (off(fit.k1, given.k1), sigma.k1),
                    (off(fit.k2, given.k2), sigma.k2),
                    (off(fit.p1, given.p1), sigma.p1),
                    (off(fit.p2, given.p2), sigma.p2),
                ];
                // If the focal length is almost undetermined, the linear bound does not apply.
                if sigma.focal_px.unwrap() > 0.1 * truth.focal {
                    continue;
                }
                trials += 1;
                for (k, (error, sigma)) in errors.iter().enumerate() {
                    let Some(sigma) = sigma else { continue };
                    squares[k] += (error / sigma).powi(2);
                    covered[k] += usize::from(error.abs() < 1.96 * sigma);
                }
            }
        }
        for (k, name) in names.iter().enumerate().filter(|(k, _)| *k < 5 || tangential) {
            let ratio = f64::sqrt(squares[k] / trials as f64);
            let coverage = 100.0 * covered[k] as f64 / trials as f64;
            println!(
                "tangential {tangential}: {name} {ratio:.3} of the bound, {coverage:.1} % inside, {trials} trials"
            );
            assert!(ratio < 1.1 && (92.0..98.0).contains(&coverage), "{name}: {ratio} {coverage}");
        }
    }
}

/// Returns the pixel of a point in a camera of the layout.
fn shown(layout: &Layout, camera: usize, at: [f64; 3]) -> Pixel {
    layout.truth[camera].world_to_pixel(at.into()).unwrap()
}

fn seen(layout: &Layout, camera: usize) -> LinkObservation {
    LinkObservation::new(&layout.site.cameras[camera].id)
}

/// Asserts that the cameras are found exactly.
fn assert_found(layout: &Layout, what: &str) {
    let report = solve(layout);
    for (found, truth) in cameras(&report).iter().zip(&layout.truth) {
        let off = found.position.distance(truth.position);
        assert!(off < 1e-4, "{what}: {off} m, {:?}", report.site.warnings);
        assert!(turn(found.yaw, truth.yaw).abs() < 1e-5, "{what}");
    }
}

/// Returns three cameras without shared landmarks. The first has its true placement.
fn bare_ring(random: &mut ChaCha8Rng) -> Layout {
    let mut layout = Layout::ring(random, 3, 0, 0.0);
    layout.place_first();
    layout
}

#[test]
fn posts_determine_cameras() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..5 {
        let layout = bare_ring(&mut random);
        let mut posts = layout.clone();
        for (i, [x, y]) in [[0.5, 0.3], [-0.8, 0.4], [0.2, -0.9]].into_iter().enumerate() {
            let length = 0.6 + 0.2 * i as f64;
            let seen = (0..3).map(|camera| LinkObservation {
                foot: Some(shown(&posts, camera, [x, y, 0.0])),
                head: Some(shown(&posts, camera, [x, y, length])),
                ..seen(&posts, camera)
            });
            let seen = seen.collect();
            posts.site.links.push(Link::new(Some(format!("post {i}")), LinkKind::Post, seen));
        }
        assert_found(&posts, "posts");
    }
}

#[test]
fn inaccurate_links_are_weighted_by_their_sigma() {
    /// Counts the coordinates of the second and third camera within their 95 % intervals, and all coordinates.
    /// `says_so` is whether the links have their standard deviation.
    fn inside(random: &mut ChaCha8Rng, says_so: bool) -> [usize; 2] {
        const HASTE: f64 = 3.0;
        let mut held = [0, 0];
        for _ in 0..60 {
            let mut layout = Layout::ring(random, 3, 8, 1.0);
            layout.place_first();
            for link in &mut layout.site.links {
                let at = link.seen[1].px.unwrap();
                let [u, v] = [at.u, at.v]
                    .map(|at| at + random.random_range(-8_f64.sqrt()..8_f64.sqrt()) * 3_f64.sqrt());
                link.seen[1].px = Some(Pixel::new(u, v));
                link.seen[1].sigma_px = says_so.then_some(HASTE);
            }
            let report = solve(&layout);
            for (found, truth) in cameras(&report).iter().zip(&layout.truth).skip(1) {
                let off = [found.position.x - truth.position.x, found.position.y - truth.position.y];
                for (off, index) in off.into_iter().zip([Covariance::X, Covariance::Y]) {
                    let sigma = found.covariance.sigma(index).unwrap();
                    held = [held[0] + usize::from(off.abs() < 1.96 * sigma), held[1] + 1];
                }
            }
        }
        held
    }
    let mut random = ChaCha8Rng::seed_from_u64(31);
    let [held, of] = inside(&mut random, true);
    assert!((0.91..0.99).contains(&(held as f64 / of as f64)), "{held} of {of}");
    let [held, of] = inside(&mut random, false);
    assert!((held as f64) < 0.88 * of as f64, "without their sigma, coverage is too low: {held} of {of}");
}

#[test]
fn marks_determine_cameras_and_the_scale() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..5 {
        let layout = bare_ring(&mut random);
        // A box of known size determines the scale, too. The placement of the first camera has a wrong scale.
        let mut marks = layout.clone();
        let (at, turned) = (WorldPoint::new(0.3, -0.2, 0.0), 0.7_f64);
        let shape = MarkShape { kind: MarkKind::Box, at, turn: turned, size: vec![1.2, 0.8, 0.9] };
        let mut seen_of_box = Vec::new();
        for camera in 0..3 {
            for point in ["b0", "b1", "b2", "t0", "t1", "t2", "t3"] {
                let px = shown(&marks, camera, shape.point(point).unwrap().into());
                let camera = marks.site.cameras[camera].id.clone();
                seen_of_box.push(MarkObservation { camera, point: point.into(), px });
            }
        }
        marks.site.marks.push(Mark {
            id: Some("box".into()),
            turn_deg: 10.0,
            seen: seen_of_box,
            ..Mark::new(MarkKind::Box, WorldPoint::default(), shape.size.clone())
        });
        let scale = &mut marks.site.cameras[0].placement.as_mut().unwrap().scale;
        *scale = scale.map(|scale| 1.2 * scale);
        assert_found(&marks, "marks");
        let report = solve(&marks);
        let mark = report.marks[0].as_ref().unwrap();
        assert!(mark.at_m.distance(at) < 1e-4 && (mark.turn_deg.unwrap() - turned.to_degrees()).abs() < 1e-3);
    }
}

#[test]
fn segments_of_floor_lines_determine_cameras() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..5 {
        let layout = bare_ring(&mut random);
        // Two floor lines; every camera sees another segment of them. The heights are fixed, and the
        // placements are approximate.
        let mut lines = layout.clone();
        for (camera, truth) in lines.site.cameras.iter_mut().zip(&lines.truth) {
            camera.height_m = Some(Known::fixed(truth.position.z));
            let foot = truth.position.on_floor();
            camera.placement = Some(PlacementEntry {
                move_m: FloorPoint { x: foot.x + 0.2, y: foot.y - 0.3 },
                turn_deg: truth.yaw.to_degrees() + 3.0,
                scale: Some(truth.position.z / STAGE_1_HEIGHT),
                fixed: false,
                held: calib_site::FixedEntry::default(),
                estimated: false,
            });
        }
        lines.place_first();
        for (i, (angle, offset)) in [(0.2_f64, 0.3), (1.4, -0.4)].into_iter().enumerate() {
            let (sin, cos) = angle.sin_cos();
            let point = |t: f64| [t * cos - offset * sin, t * sin + offset * cos, 0.0];
            let seen = (0..3).map(|camera| {
                let from = 0.5 * camera as f64 - 0.8;
                let ends = [point(from), point(from + 0.7)].map(|at| shown(&lines, camera, at));
                LinkObservation { segment: Some(ends.to_vec()), ..seen(&lines, camera) }
            });
            let seen = seen.collect();
            lines.site.links.push(Link::new(Some(format!("line {i}")), LinkKind::Line, seen));
        }
        assert_found(&lines, "lines");
    }
}

#[test]
fn unknown_scale_and_missing_links_are_reported() {
    let mut random = ChaCha8Rng::seed_from_u64(8);
    // Without a known length, the shape of the site is correct and the first camera determines its scale.
    let layout = Layout::ring(&mut random, 3, 8, 1.0);
    let report = solve(&layout);
    assert_eq!(report.site.scale, Some(Scale::Unknown));
    assert!(report.site.warnings.iter().any(|warning| warning.code == Code::ScaleUnknown));
    let first = cameras(&report)[0];
    assert_eq!((first.position, first.yaw), (WorldPoint::new(0.0, 0.0, 3.0), 0.0));
    // A distance determines the scale.
    let mut taped = layout.clone();
    let apart = |report: &Report, a: usize, b: usize| {
        report.links[a].as_ref().unwrap().at_m.distance(report.links[b].as_ref().unwrap().at_m)
    };
    taped.site.distances.push(Distance {
        id: None,
        name: None,
        off: false,
        keep: false,
        between: ["p0".into(), "p1".into()],
        length_m: Known::prior(2.0, 0.001),
    });
    let scaled = solve(&taped);
    assert_eq!(scaled.site.scale, Some(Scale::Known));
    assert!((apart(&scaled, 0, 1) - 2.0).abs() < 0.01);
    let ratio = cameras(&scaled)[1].position.z / cameras(&report)[1].position.z;
    assert!((ratio / (2.0 / apart(&report, 0, 1)) - 1.0).abs() < 0.05, "{ratio}");
    // A camera without links is reported.
    let mut alone = layout.clone();
    alone.site.links.iter_mut().for_each(|link| link.seen.retain(|seen| seen.camera != "c2"));
    let report = solve(&alone);
    assert_eq!(report.site.components, [vec!["c0".to_owned(), "c1".into()], vec!["c2".into()]]);
    let message = report.site.warnings.iter().find(|warning| warning.code == Code::NotConnected).unwrap();
    assert!(message.message.contains("c2"), "{message:?}");
    assert_eq!(report.cameras[2].1.as_ref().unwrap().stage, Stage::Partial);
}

#[test]
fn fixed_placement_is_kept_and_others_are_relative_to_it() {
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let mut layout = Layout::ring(&mut random, 3, 8, 1.0);
    layout.place_first();
    let held =
        layout.site.cameras[0].placement.take().map(|placement| PlacementEntry { fixed: true, ..placement });
    layout.site.cameras[0].placement = held;
    let report = solve(&layout);
    let found = cameras(&report);
    assert!(found[0].position.distance(layout.truth[0].position) < 1e-9, "{:?}", found[0].position);
    assert_eq!(report.site.scale, Some(Scale::Known));
    for (found, truth) in found.iter().zip(&layout.truth) {
        assert!(found.position.distance(truth.position) < 0.5);
    }
}
