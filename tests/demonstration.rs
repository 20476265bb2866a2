//! The demonstration site: its files, solution, images and errors.

use calib_core::{Camera, Code, Covariance};

use calib_site::{Options, Site, Stage};
use calib_tests::Scratch;

#[test]
fn demonstration_cameras_are_within_their_sigmas() {
    let demo = calib_demo::demo_site();
    demo.site.check().unwrap();
    let solved = demo.site.calibrate(&Options::default()).write_into(&demo.site);
    for (camera, (id, truth)) in solved.cameras.iter().zip(&demo.truth) {
        let found = camera.camera().unwrap_or_else(|| panic!("{id}: {:?}", camera.error));
        let errors = [
            (found.roll - truth.roll, Covariance::ROLL),
            (found.pitch - truth.pitch, Covariance::PITCH),
            (found.focal - truth.focal, Covariance::FOCAL),
        ];
        for (error, index) in errors {
            let sigma = found.covariance.sigma(index).unwrap();
            assert!(error.abs() < 3.5 * sigma, "{id}, unknown {index}: {error} with a sigma of {sigma}");
        }
        // The position of the store is set by hand, 5 cm off. Control points and links determine the others.
        assert!(found.position.distance(truth.position) < 0.15, "{id}");
        if camera.solution.as_ref().unwrap().stage == Stage::Refined {
            assert_within_three_sigmas(id, &found, truth);
        }
        let outliers =
            camera.solution.iter().flat_map(|s| &s.residuals).filter(|residual| residual.outlier).count();
        assert_eq!(outliers, 0, "{id}: there are no wrong annotations");
    }
}

/// Asserts that the position of a refined camera is within three standard deviations per axis. A camera that fixes
/// the frame has no standard deviations.
fn assert_within_three_sigmas(id: &str, found: &Camera, truth: &Camera) {
    let (a, b) = (found.position, truth.position);
    for (error, index) in [(a.x - b.x, Covariance::X), (a.y - b.y, Covariance::Y), (a.z - b.z, Covariance::Z)]
    {
        let sigma = found.covariance.sigma(index).unwrap_or(1e-9);
        assert!(error.abs() < 3.0 * sigma + 1e-9, "{id}, unknown {index}: {error} m with a sigma of {sigma}");
    }
}

#[test]
fn shop_without_plan_is_solved_from_links_and_marks() {
    let demo = calib_demo::demo_site_without_plan();
    demo.site.check().unwrap();
    let report = demo.site.calibrate(&Options::default());
    for ((index, solution), (id, truth)) in report.cameras.iter().zip(&demo.truth) {
        let solution = solution.as_ref().unwrap();
        let in_shop = id.starts_with("shop") || id == "checkouts";
        assert_eq!(solution.stage, if in_shop { Stage::Refined } else { Stage::Partial }, "{index}");
        if in_shop {
            assert_within_three_sigmas(id, &solution.camera().unwrap(), truth);
        }
    }
    for (mark, found) in demo.site.marks.iter().zip(&report.marks) {
        let found = found.as_ref().unwrap();
        for seen in &found.residuals {
            assert!(seen.px < 2.0 && !seen.outlier, "{:?} in {}: {} px", mark.id, seen.camera, seen.px);
        }
    }
    assert!(
        report
            .site
            .components
            .contains(&["shop-1", "shop-2", "shop-3", "checkouts"].map(String::from).to_vec())
    );
    let apart = report.site.warnings.iter().filter(|warning| warning.code == Code::NotConnected).count();
    assert_eq!(apart, 2, "the store and the barn are reported as not connected: {:?}", report.site.warnings);
}

#[test]
fn first_command_of_the_readme_writes_the_demonstration() {
    let scratch = Scratch::new();
    let run = scratch.calib(&["demo"]).expect_code(0);
    assert!(
        run.stdout.contains("Errors against ground truth") && run.stdout.contains("barn"),
        "{}",
        run.stdout
    );
    let site =
        Site::from_json(&std::fs::read_to_string(scratch.path("calib-demo/site.json")).unwrap()).unwrap();
    for camera in &site.cameras {
        for name in [
            camera.image.clone().unwrap(),
            format!("overlay-{}.png", camera.id),
            format!("sigma-{}.png", camera.id),
        ] {
            let image = image::open(scratch.path("calib-demo").join(&name))
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!([image.width(), image.height()], camera.size_px, "{name}");
        }
    }
    assert!(image::open(scratch.path("calib-demo/overlay-plan.png")).is_ok());
    let again = scratch.calib(&["solve", "calib-demo/site.json", "--format", "json"]).expect_code(0).json();
    let solved = scratch.read_json("calib-demo/solved.json");
    assert_eq!(solved["cameras"][0]["solution"], again["shop-1"]);
    scratch.calib(&["report", "calib-demo/solved.json", "-o", "report.html"]).expect_code(0);
    // The command overwrites its own folder, but no other.
    std::fs::create_dir(scratch.path("mine")).unwrap();
    scratch.write("mine/keep.txt", "mine");
    scratch.calib(&["demo", "mine"]).expect_code(1);
}
