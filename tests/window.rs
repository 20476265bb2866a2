//! Images that show a part of the calibrated image: digital zooms, crops and substreams.

use calib_core::camera::{Pixel, RotationZoom};
use calib_image::{CameraChange, Comparison, recover};
use calib_site::{NewImage, Options, Site};
use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};

/// Returns the solved demonstration, and the index of a camera whose lens is distorted.
fn demonstration() -> (Site, usize) {
    let site = calib_demo::demo_site().site;
    let solved = site.calibrate(&Options::default()).write_into(&site);
    (solved, 2)
}

/// Returns the image of the camera with this index.
fn still(site: &Site, index: usize) -> RgbImage {
    let demo = calib_demo::demo_site();
    calib_demo::render(&demo.truth[index].1, site.cameras[index].size_px)
}

/// Returns the part (left, top, width, height) of an image, shown with this width and height.
fn part(image: &RgbImage, [x, y, w, h]: [u32; 4], [width, height]: [u32; 2]) -> RgbImage {
    let cropped = crop_imm(image, x, y, w, h).to_image();
    if [w, h] == [width, height] { cropped } else { resize(&cropped, width, height, FilterType::CatmullRom) }
}

/// Returns left, top, width and height of the part that a comparison found, in pixels.
fn found(comparison: &Comparison) -> [f64; 4] {
    assert_eq!(comparison.change, CameraChange::Windowed, "{:?}", comparison.rotation);
    comparison.window.unwrap().px()
}

#[test]
fn zooms_crops_and_substreams_are_found() {
    let (site, index) = demonstration();
    let (entry, old) = (&site.cameras[index], still(&site, index));
    let [width, height] = entry.size_px;
    let cases = [
        // Digital zooms: in the centre, and elsewhere.
        ([width / 4, height / 4, width / 2, height / 2], [width, height]),
        ([900, 420, width / 4, height / 4], [width, height]),
        // Crop.
        ([611, 333, 1001, 702], [1001, 702]),
        // Substream.
        ([0, 0, width, height], [640, 360]),
    ];
    for (window, size) in cases {
        let new = part(&old, window, size);
        let comparison = Comparison::from_entry(entry, &old, &new).unwrap();
        let px = found(&comparison);
        println!("{window:?} {size:?}: {px:.3?}, {:.2} agree", comparison.found_fraction);
        for (found, true_side) in px.iter().zip(window) {
            assert!((found - f64::from(true_side)).abs() < 0.51, "{window:?} {size:?}: {px:?}");
        }
        if window[2..] == size {
            assert_eq!(px, window.map(f64::from), "a crop is exact");
        }
    }
}

#[test]
fn a_darker_noisy_zoom_is_found() {
    let (site, index) = demonstration();
    let (entry, old) = (&site.cameras[index], still(&site, index));
    let mut new = part(&old, [400, 250, 960, 540], entry.size_px);
    let mut state = 12_345_u32;
    for value in new.iter_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *value = (f32::from(*value) * 0.6 + (state >> 29) as f32) as u8;
    }
    let px = found(&Comparison::from_entry(entry, &old, &new).unwrap());
    assert!((px[0] - 400.0).abs() < 0.6 && (px[2] - 960.0).abs() < 0.6, "{px:?}");
}

#[test]
fn movements_and_other_images_are_no_windows() {
    let (site, index) = demonstration();
    let (entry, old) = (&site.cameras[index], still(&site, index));
    let camera = calib_demo::demo_site().truth[index].1;
    for (vector, zoom) in [([0.01, 0.02, -0.005], 0.0), ([0.0, 0.05, 0.0], 0.1)] {
        let turned = RotationZoom { vector, zoom }.apply_to(&camera);
        let new = calib_demo::render(&turned, entry.size_px);
        let change = Comparison::from_entry(entry, &old, &new).unwrap().change;
        assert_eq!(change, CameraChange::Moved, "{vector:?} {zoom}");
    }
    let other = still(&site, 0);
    let other = resize(&other, 1280, 720, FilterType::Triangle);
    assert!(Comparison::from_entry(entry, &old, &other).is_err(), "another size and another view");
}

#[test]
fn a_recovered_window_has_the_same_pose() {
    let (site, index) = demonstration();
    let (entry, old) = (&site.cameras[index], still(&site, index));
    let before = entry.camera().unwrap();
    for (window, size) in [([300, 200, 1280, 720], [1280, 720]), ([480, 300, 960, 540], entry.size_px)] {
        let new = part(&old, window, size);
        let comparison = Comparison::from_entry(entry, &old, &new).unwrap();
        let image = NewImage { image: "new.png".into(), since: "2026-05-01T08:00:00Z".into() };
        let recovered = recover(&site, index, &comparison, [&old, &new], &image).unwrap().site;
        let after = &recovered.cameras[index];
        assert_eq!(after.size_px, size);
        assert_eq!(after.lens.as_ref().unwrap().window_px, Some(comparison.window.unwrap().px()));
        let now = after.camera().unwrap();
        assert!((now.pitch - before.pitch).abs() < 2e-4 && (now.roll - before.roll).abs() < 2e-4, "{now:?}");
        assert!((now.yaw - before.yaw).abs() < 5e-4, "{} {}", now.yaw, before.yaw);
        assert!((now.position.x - before.position.x).hypot(now.position.y - before.position.y) < 0.01);
        // A pixel shows the same floor in both images.
        let map = comparison.window.unwrap().map;
        for (u, v) in [(700.0, 600.0), (1100.0, 800.0), (900.0, 500.0)] {
            let pixel = Pixel::new(u, v);
            let floors = [(&before, pixel), (&now, map.pixel(pixel))]
                .map(|(camera, pixel)| camera.pixel_to_floor(pixel, 0.0));
            if let [Some(a), Some(b)] = floors {
                assert!(a.distance(b) < 0.02, "{a:?} {b:?}");
            }
        }
        // A second zoom moves the window; the lens values stay.
        let again = part(&new, [100, 60, size[0] / 2, size[1] / 2], size);
        let comparison = Comparison::from_entry(after, &new, &again).unwrap();
        let image = NewImage { image: "again.png".into(), since: "2026-06-01T08:00:00Z".into() };
        let twice = recover(&recovered, index, &comparison, [&new, &again], &image).unwrap().site;
        let [was, is] = [after, &twice.cameras[index]].map(|entry| entry.lens.clone().unwrap());
        let ratio = f64::from(window[2]) / f64::from(size[0]);
        let px = is.window_px.unwrap();
        assert!((px[0] - (f64::from(window[0]) + 100.0 * ratio)).abs() < 0.6, "{px:?}");
        assert_eq!(calib_site::LensEntry { window_px: was.window_px, ..is }, was);
    }
}
