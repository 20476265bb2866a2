//! The quality gate: what is no drawing of a scene does not pass it, and what is unknown is not taken for exact.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_core::{Annotation, Kind, Known, Pixel, Site, SiteCamera};
use calib_tests::Scratch;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

const SIZE: [u32; 2] = [1920, 1080];

fn any_pixel(random: &mut ChaCha8Rng) -> Pixel {
    Pixel::new(random.random_range(0.0..1920.0), random.random_range(0.0..1080.0))
}

fn any_segments(random: &mut ChaCha8Rng, count: usize) -> Vec<Vec<Pixel>> {
    (0..count).map(|_| vec![any_pixel(random), any_pixel(random)]).collect()
}

/// A camera on whose image lines are drawn wherever chance would have them, of every kind.
fn scribbled(random: &mut ChaCha8Rng, index: usize) -> SiteCamera {
    let mut camera = SiteCamera::new(&format!("c{index}"), SIZE);
    let mut draw = |kind: Kind, groups: usize, least: usize, most: usize| {
        for _ in 0..groups {
            let count = random.random_range(least..=most);
            if count > 0 {
                camera.annotations.push(Annotation::of_segments(kind, any_segments(random, count)));
            }
        }
    };
    draw(Kind::Vertical, 1, 0, 5);
    draw(Kind::Parallel, 2, 0, 4);
    draw(Kind::Perpendicular, 1, 2, 3);
    draw(Kind::EqualLength, 1, 0, 4);
    if random.random_bool(0.2) {
        let [foot, head] = [(); 2].map(|()| any_pixel(random));
        let height_m = Some(Known::prior(1.75, 0.07));
        let upright =
            Annotation { foot: Some(foot), head: Some(head), height_m, ..Annotation::new(Kind::Upright) };
        camera.annotations.push(upright);
    }
    camera
}

#[test]
fn lines_at_random_do_not_pass() {
    let count: usize =
        std::env::var("CALIB_SCRIBBLES").ok().and_then(|count| count.parse().ok()).unwrap_or(300);
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut site = Site::new();
    site.cameras = (0..count).map(|index| scribbled(&mut random, index)).collect();
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let _ = scratch.calib(&["solve", "site.json", "-o", "solved.json", "--no-refine"]);
    let solved = scratch.read_json("solved.json");
    let verdicts = scratch.calib(&["check", "solved.json", "--format", "json"]).expect_code(4).json();
    let (mut solutions, mut passed, mut exact) = (0, 0, 0);
    for (camera, verdict) in
        solved["cameras"].as_array().unwrap().iter().zip(verdicts["cameras"].as_array().unwrap())
    {
        let solution = &camera["solution"];
        solutions += usize::from(solution.is_object());
        if verdict["ok"] == json!(true) {
            passed += 1;
            let rel = solution["sigma"]["floor_length_rel"].as_f64().unwrap();
            exact += usize::from(rel < 0.01);
            println!(
                "{} {rel} chi2 {} dof {} {}",
                camera["id"], solution["chi2"], solution["dof"], solution["warnings"]
            );
        }
    }
    println!("of {count} {solutions} have a solution, {passed} pass, {exact} of them under 1 %");
    assert!(solutions > count / 4, "most of them are solved: the gate is what keeps them out");
    assert!(passed * 100 <= count && exact == 0, "{passed} of {count} pass, {exact} of them under 1 %");
}
