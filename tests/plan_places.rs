//! Placement of cameras on a floor plan from the visible floor. Cameras are placed on the plan of the demonstration,
//! and not on a mirrored plan.

use calib_demo::render_plan;
use calib_image::PlacementSearch;
use calib_site::{Options, Site};
use calib_tests::Scratch;
use image::RgbImage;

/// Number of cameras of the shop in the demonstration that are tested.
const SHOP: usize = 3;

#[test]
fn cameras_are_placed_on_the_plan_and_not_on_a_mirrored_plan() {
    let demo = calib_demo::demo_site();
    let truth = &demo.truth[..SHOP];
    let images: Vec<RgbImage> = (truth.iter().zip(&demo.site.cameras))
        .map(|((_, camera), entry)| calib_demo::render(camera, entry.size_px))
        .collect();
    let plan = render_plan();
    let of_plan = demo.site.plan.as_ref().unwrap();
    let scratch = Scratch::new();
    let folder = scratch.path("stills");
    std::fs::create_dir(&folder).unwrap();
    for ((id, _), image) in truth.iter().zip(&images) {
        image.save(folder.join(format!("{id}.png"))).unwrap();
    }
    // The plan is not one of the images, even in the same folder.
    plan.save(folder.join("plan.png")).unwrap();
    let scale = of_plan.metres_per_px.to_string();
    let args =
        ["propose", "stills", "--plan", "stills/plan.png", "--metres-per-px", &scale, "-o", "site.json"];
    let run = scratch.calib(&args).expect_code(0);
    assert!(run.stdout.contains("by matching colours and using the plan"), "{}", run.stdout);

    let site = Site::from_json(&std::fs::read_to_string(scratch.path("site.json")).unwrap()).unwrap();
    assert_eq!(site.cameras.len(), SHOP);
    let found = site.plan.as_ref().unwrap();
    assert_eq!(found.image.as_deref(), Some("stills/plan.png"));
    for ((id, camera), entry) in truth.iter().zip(&site.cameras) {
        let pose = entry.camera().unwrap();
        let pixel = found.scale().plan_from_floor(pose.position.on_floor());
        let expected = of_plan.scale().plan_from_floor(camera.position.on_floor());
        let off_m = pixel.distance(expected) * of_plan.metres_per_px;
        let turn = (pose.yaw - camera.yaw).to_degrees();
        let turn = (turn + 180.0).rem_euclid(360.0) - 180.0;
        let height = pose.position.z / camera.position.z;
        println!("{id}: {off_m:.2} m, {turn:.2} degrees, height times {height:.3}");
        assert!(off_m < 0.5 && turn.abs() < 2.0 && (height - 1.0).abs() < 0.08, "{id}");
        // The uncertainty of the height is part of the uncertainty of lengths on the floor.
        let sigma = entry.solution.as_ref().unwrap().sigma.as_ref().unwrap().floor_length_rel.unwrap();
        assert!(sigma > 0.05 && (height - 1.0).abs() < 2.0 * sigma, "{id}: {sigma}");
    }

    let free = Site {
        cameras: site
            .cameras
            .iter()
            .cloned()
            .map(|camera| calib_site::SiteCamera { placement: None, height_m: None, ..camera })
            .collect(),
        ..site.clone()
    };
    let free = free.calibrate(&Options::default()).write_into(&free);
    let mirrored = image::imageops::flip_horizontal(&plan);
    let cameras: Vec<usize> = (0..SHOP).collect();
    let search = PlacementSearch::new(&free, &cameras, &images, Some(&mirrored));
    let pairs: Vec<_> = search.pairs().into_iter().map(|pair| search.register(pair)).collect();
    let placed = search.place(&free, &pairs, &mut |_| true).unwrap();
    assert!(placed.cameras.iter().all(|camera| camera.placement.is_none()), "{placed:?}");
    assert!(placed.cameras[0].reason.contains("one of these cameras"), "{}", placed.cameras[0].reason);
}

#[test]
fn a_plan_without_a_scale_and_options_without_a_plan_are_refused() {
    let scratch = Scratch::new();
    RgbImage::from_pixel(640, 480, image::Rgb([90; 3])).save(scratch.path("a.png")).unwrap();
    render_plan().save(scratch.path("plan.png")).unwrap();
    let run = scratch.calib(&["propose", "a.png", "--plan", "plan.png"]).expect_code(2);
    assert!(run.stderr.contains("--metres-per-px is missing"), "{}", run.stderr);
    let run = scratch.calib(&["propose", "a.png", "--page", "2"]).expect_code(2);
    assert!(run.stderr.contains("--page requires --plan"), "{}", run.stderr);
    scratch
        .calib(&["propose", "a.png", "--plan", "plan.png", "--page", "2", "--metres-per-px", "0.02"])
        .expect_code(2);
    scratch.calib(&["propose", "a.png", "--plan", "nowhere.png", "--metres-per-px", "0.02"]).expect_code(3);
}
