//! Outliers in large sites: wrong links and wrong lines are rejected, few or many, with little extra time.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use calib_core::{Annotation, Camera, Code, Covariance, Kind, Lens, Pixel, WorldPoint};

use calib_demo::layout::Layout;
use calib_demo::random::{SIZE, normal};
use calib_site::{Options, Report, SceneEntry, Site, SiteCamera, Stage, Warning};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

fn moved(pixel: Pixel, random: &mut ChaCha8Rng) -> Pixel {
    let (by, angle) = (random.random_range(30.0..200.0), random.random_range(0.0..std::f64::consts::TAU));
    Pixel::new(pixel.u + by * f64::cos(angle), pixel.v + by * f64::sin(angle))
}

/// Moves one observation in about one of `every` links, and returns the indices of these links.
fn spoil(layout: &mut Layout, random: &mut ChaCha8Rng, every: usize) -> BTreeSet<usize> {
    let wrong: BTreeSet<usize> =
        (0..layout.site.links.len()).filter(|_| random.random_range(0..every) == 0).collect();
    for &index in &wrong {
        let which = random.random_range(0..layout.site.links[index].seen.len());
        let pixel = layout.site.links[index].seen[which].px.as_mut().unwrap();
        *pixel = moved(*pixel, random);
    }
    wrong
}

fn rejected_links(report: &Report) -> BTreeSet<usize> {
    let is_aside = |&index: &usize| {
        report.links[index].as_ref().is_some_and(|link| link.residuals.iter().any(|seen| seen.outlier))
    };
    (0..report.links.len()).filter(is_aside).collect()
}

/// Returns the report of a site and the shortest duration of several runs.
fn timed(site: &Site, runs: usize) -> (Report, Duration) {
    let run = |_| {
        let before = Instant::now();
        (site.calibrate(&Options::default()), before.elapsed())
    };
    (0..runs).map(run).min_by_key(|(_, took)| *took).unwrap()
}

fn farthest_off(report: &Report, layout: &Layout) -> f64 {
    let off = report.cameras.iter().zip(&layout.truth).map(|((_, found), truth)| {
        let found = found.as_ref().unwrap();
        assert_eq!(found.stage, Stage::Refined);
        found.camera().unwrap().position.distance(truth.position)
    });
    off.fold(0.0, f64::max)
}

/// Compares a hall of twenty cameras and two thousand links with and without outliers. About one of `every`
/// links is wrong.
fn hall(every: usize, noise_is_known: bool) {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut layout = Layout::grid(&mut random, [5, 4], 65, 1.0);
    layout.place_first();
    if !noise_is_known {
        layout.site.cameras.iter_mut().for_each(|camera| camera.sigma_px = None);
    }
    let (clean, clean_took) = timed(&layout.site, 3);
    let wrong = spoil(&mut layout, &mut random, every);
    let (report, took) = timed(&layout.site, 3);
    let aside = rejected_links(&report);
    let (accused, missed) = (aside.difference(&wrong).count(), wrong.difference(&aside).count());
    let off = [farthest_off(&clean, &layout), farthest_off(&report, &layout)];
    println!(
        "{} links, {} wrong: {missed} missed, {accused} correct links rejected, position errors {off:?} m, {clean_took:?} clean, {took:?}",
        layout.site.links.len(),
        wrong.len()
    );
    // A small move, or a move along the other camera's ray, cannot be detected.
    assert!(missed * 50 <= wrong.len() && accused * 200 <= layout.site.links.len());
    assert!(off[1] < 2.0 * off[0] + 0.01, "{off:?}");
    assert!(took < 12 * clean_took, "{took:?} instead of {clean_took:?}");
}

#[test]
fn many_wrong_links_are_found() {
    hall(20, true);
}

#[test]
fn many_wrong_links_are_found_with_unknown_noise() {
    hall(20, false);
}

#[test]
fn few_wrong_links_of_many_are_found() {
    hall(700, true);
}

#[test]
fn search_ends_if_most_links_are_wrong() {
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let mut layout = Layout::grid(&mut random, [5, 4], 65, 1.0);
    layout.place_first();
    let (_, clean_took) = timed(&layout.site, 3);
    for every in [2, 1] {
        let mut wrong = layout.clone();
        spoil(&mut wrong, &mut random, every);
        let (report, took) = timed(&wrong.site, 1);
        println!(
            "one of {every} wrong: {took:?} instead of {clean_took:?}, {} rejected",
            rejected_links(&report).len()
        );
        assert!(took < 15 * clean_took, "one of {every} wrong: {took:?} instead of {clean_took:?}");
        let is_misfit = |warnings: &[Warning]| warnings.iter().any(|warning| warning.code == Code::Misfit);
        let misfits =
            report.cameras.iter().flat_map(|(_, found)| found).filter(|found| is_misfit(&found.warnings));
        assert!(misfits.count() > 0 || !report.site.warnings.is_empty(), "a warning is reported");
    }
}

#[test]
fn time_is_linear_in_the_number_of_lines() {
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let took = |annotations: &[Annotation]| timed(&site_of(annotations.to_vec()), 1).1;
    let (_, few) = drawn(&mut random, 500);
    let few = timed(&site_of(few), 5).1;
    let (_, clean) = drawn(&mut random, 5000);
    let mut wrong = clean.clone();
    for segment in wrong.iter_mut().flat_map(|drawn| drawn.segments.iter_mut().flatten()) {
        if random.random_range(0..20) == 0 {
            *segment = segment.iter().map(|&pixel| moved(pixel, &mut random)).collect();
        }
    }
    let mut equal = clean.clone();
    for segments in equal.iter_mut().filter_map(|drawn| drawn.segments.as_mut()) {
        let first = segments[0].clone();
        segments.fill(first);
    }
    let (clean, wrong, equal) = (took(&clean), took(&wrong), took(&equal));
    println!("500 lines {few:?}, 5000 {clean:?}, one of 20 wrong {wrong:?}, all equal {equal:?}");
    assert!(clean < 60 * few, "{clean:?} instead of ten times {few:?}");
    assert!(wrong < 6 * clean, "{wrong:?} instead of {clean:?}");
    assert!(equal < 3 * clean, "{equal:?} instead of {clean:?}");
}

/// Returns a camera 4 m high with `count` annotated lines: verticals, and floor lines of two directions.
fn drawn(random: &mut ChaCha8Rng, count: usize) -> (Camera, Vec<Annotation>) {
    let camera = Camera {
        position: WorldPoint::new(0.0, 0.0, 4.0),
        yaw: 0.0,
        pitch: 0.5,
        roll: 0.03,
        focal: 1200.0,
        lens: Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1])),
        covariance: Covariance::EXACT,
    };
    let mut segments: [Vec<Vec<Pixel>>; 3] = Default::default();
    while segments.iter().map(Vec::len).sum::<usize>() < count {
        let kind = segments.iter().map(Vec::len).sum::<usize>() % 3;
        let (x, y) = (random.random_range(-5.0..5.0), random.random_range(4.0..12.0));
        // Floor lines of a rotated room.
        let along = [[0.0, 0.0, 2.0], [1.2, 0.9, 0.0], [-0.9, 1.2, 0.0]][kind];
        let ends = [0.0, 1.0].map(|s| WorldPoint::new(x + s * along[0], y + s * along[1], s * along[2]));
        let shown = ends.map(|end| camera.world_to_pixel(end));
        let inside = |p: &Pixel| p.u > 0.0 && p.v > 0.0 && p.u < SIZE[0] && p.v < SIZE[1];
        if let [Some(a), Some(b)] = shown.map(|shown| shown.filter(inside)) {
            let mut noisy = |p: Pixel| Pixel::new(p.u + normal(random), p.v + normal(random));
            segments[kind].push(vec![noisy(a), noisy(b)]);
        }
    }
    let [vertical, along, across] = segments;
    let kinds = [(Kind::Vertical, vertical), (Kind::Parallel, along), (Kind::Parallel, across)];
    (camera, kinds.map(|(kind, lines)| Annotation::from_segments(kind, lines)).to_vec())
}

fn site_of(annotations: Vec<Annotation>) -> Site {
    let mut entry = SiteCamera::new("c", SIZE.map(|side| side as u32));
    entry.sigma_px = Some(1.0);
    entry.annotations = annotations;
    Site { cameras: vec![entry], scene: Some(SceneEntry::EXACT), ..Site::new() }
}

#[test]
fn wrong_lines_are_found_quickly() {
    let mut random = ChaCha8Rng::seed_from_u64(21);
    for (lines, wrong) in [(30, 2), (60, 3), (90, 4)] {
        let (camera, mut annotations) = drawn(&mut random, lines);
        let (_, clean_took) = timed(&site_of(annotations.clone()), 3);
        let spoiled: BTreeSet<(usize, usize)> = (0..wrong).map(|k| (k % 3, 2 * k)).collect();
        for &(annotation, segment) in &spoiled {
            let end = annotations[annotation].segments.as_mut().unwrap()[segment].last_mut().unwrap();
            *end = moved(*end, &mut random);
        }
        let (report, took) = timed(&site_of(annotations), 3);
        let solution = report.cameras[0].1.as_ref().unwrap();
        let aside: BTreeSet<(usize, usize)> = solution
            .residuals
            .iter()
            .filter(|residual| residual.outlier)
            .map(|residual| (residual.annotation.unwrap(), residual.segment.unwrap()))
            .collect();
        let off = solution.camera().unwrap().focal - camera.focal;
        println!(
            "{lines} lines, {wrong} wrong: {aside:?} of {spoiled:?}, focal {off:.1} px off, {clean_took:?} clean, {took:?}"
        );
        assert_eq!(aside, spoiled);
        assert!(off.abs() < 30.0, "{off}");
    }
}
