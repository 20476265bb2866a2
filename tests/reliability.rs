//! Reliability of annotations and links: redundancy numbers, and pairs of cameras in which a wrong link cannot be
//! detected.

use calib_core::{Code, ResidualOf};
use calib_demo::layout::Layout;
use calib_demo::random::{AnnotationSet, RandomScene, SIZE};
use calib_site::{Options, SceneEntry, Site, SiteCamera, Solution};
use calib_tests::Scratch;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// Returns the solution of a camera with the annotations of a scene.
fn solved(scene: &RandomScene, random: &mut ChaCha8Rng) -> Solution {
    let camera = SiteCamera {
        annotations: scene.noisy(random, 1.0),
        efov_px: Some(scene.efov.clone()),
        scene: Some(SceneEntry::EXACT),
        ..SiteCamera::new("a", SIZE.map(|side| side as u32))
    };
    let site = Site { cameras: vec![camera], ..Site::default() };
    let (_, result) = site.calibrate(&Options::default()).cameras.remove(0);
    result.unwrap()
}

#[test]
fn redundancy_numbers_add_up_to_the_degrees_of_freedom() {
    let mut random = ChaCha8Rng::seed_from_u64(20);
    let (mut count, mut equal) = (0, 0);
    for _ in 0..40 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, Some(70.0), Some(35.0));
        let solution = solved(&scene, &mut random);
        // A weak prior is one more residual, and a rejected line has no redundancy number.
        let has_prior =
            solution.has_warning(Code::PriorDominates) || solution.has_warning(Code::FocalUnobservable);
        if has_prior || solution.residuals.iter().any(|residual| residual.outlier) {
            continue;
        }
        let sum: f64 = solution.residuals.iter().map(|residual| residual.redundancy.unwrap()).sum();
        let dof = solution.dof.unwrap() as f64;
        // Overlapping lines count as one line in the degrees of freedom.
        let overlapping = (sum - dof).round();
        assert!((sum - dof - overlapping).abs() < 1e-3, "{sum} for {dof} degrees of freedom");
        assert!((0.0..=1.0).contains(&overlapping), "{sum} for {dof} degrees of freedom");
        equal += usize::from(overlapping == 0.0);
        assert!(solution.residuals.iter().all(|residual| residual.undetectable_m.unwrap() > 0.0));
        count += 1;
    }
    assert!(count > 20 && 2 * equal > count, "{count} scenes are tested, {equal} without overlapping lines");
}

/// Returns the number of links without redundancy in a solution.
fn unchecked_links(solution: &Solution) -> usize {
    let links = solution.residuals.iter().filter(|residual| residual.of == ResidualOf::Link);
    links.filter(|residual| residual.redundancy.unwrap() < 1e-6).count()
}

#[test]
fn a_pair_with_two_links_is_not_checked() {
    let mut random = ChaCha8Rng::seed_from_u64(21);
    for trial in 0..10 {
        for (count, is_checked) in [(2, false), (8, true)] {
            let mut layout = Layout::ring(&mut random, 2, count, 1.0);
            // Without a placement and a height, the scale is unknown, too.
            if trial % 2 == 0 {
                layout.place_first();
            }
            let report = layout.site.calibrate(&Options::default());
            for (index, result) in &report.cameras {
                let solution = result.as_ref().unwrap();
                assert_eq!(!solution.has_warning(Code::Unchecked), is_checked, "{count} links: {solution:?}");
                assert_eq!(unchecked_links(solution), if is_checked { 0 } else { 2 });
                if !is_checked {
                    let other = &layout.site.cameras[1 - *index].id;
                    let named =
                        |message: &String| message.contains(&format!("redundant link with \"{other}\""));
                    let mut messages = solution.warnings.iter().map(|warning| &warning.message);
                    assert!(messages.any(named), "{:?}", solution.warnings);
                }
            }
        }
    }
}

#[test]
fn check_fails_for_a_pair_with_two_links() {
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let mut layout = Layout::ring(&mut random, 2, 2, 0.5);
    layout.place_first();
    let scratch = Scratch::new();
    scratch.write("site.json", layout.site.to_json());
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    let failed = scratch.calib(&["check", "solved.json", "--max-floor-error", "0.5"]).expect_code(4);
    assert!(failed.stdout.contains("no redundant link with"), "{}", failed.stdout);
    let allowed = ["check", "solved.json", "--max-floor-error", "0.5", "--allow", "unchecked"];
    scratch.calib(&allowed).expect_code(0);
}
