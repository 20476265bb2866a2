//! Images from videos: one frame, or the scene without the objects that move.

use calib_site::Site;
use calib_tests::Scratch;
use egui::Key;
use egui_kittest::kittest::Queryable as _;

use crate::desk::Desk;

/// Clips of 12 frames, four a second: a square of 16 pixels moves over a background of the brightness
/// `40 + x + y / 2`.
const CLIPS: [(&str, &[u8]); 4] = [
    ("h264.mp4", include_bytes!("../../../calib-video/tests/clips/h264.mp4")),
    ("h265.mp4", include_bytes!("../../../calib-video/tests/clips/h265.mp4")),
    ("h264.mkv", include_bytes!("../../../calib-video/tests/clips/h264.mkv")),
    ("mjpeg.avi", include_bytes!("../../../calib-video/tests/clips/mjpeg.avi")),
];

/// Opens files of a folder as dropped files.
fn open(desk: &mut Desk, scratch: &Scratch, names: &[&str]) {
    let ctx = desk.harness.ctx.clone();
    desk.app().open_paths(&ctx, names.iter().map(|name| scratch.path(name)));
    desk.harness.run_steps(2);
}

/// Opens one video in a new folder.
fn open_video(name: &str, bytes: &[u8]) -> (Scratch, Desk) {
    let scratch = Scratch::new();
    scratch.write(name, bytes);
    let mut desk = Desk::new(Site::new());
    open(&mut desk, &scratch, &[name]);
    (scratch, desk)
}

/// Waits until a text is shown.
fn wait_for(desk: &mut Desk, text: &str) {
    for _ in 0..600 {
        desk.harness.step();
        if desk.words().iter().any(|word| word.contains(text)) {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    panic!("{text:?} is not shown: {:?}", desk.words());
}

/// Clicks "Use this image" once the image is read, and waits until the site has this number of cameras.
fn use_image(desk: &mut Desk, cameras: usize) {
    wait_for(desk, "in the folder of the video");
    desk.harness.get_by_label("Use this image").click();
    desk.wait(|app| app.editor.site().cameras.len() == cameras && !app.is_working());
    desk.harness.run_steps(2);
}

/// Returns the 99th percentile of the difference between the green of an image and the background.
fn difference(image: &image::RgbImage) -> u8 {
    let of = |(x, y, pixel): (u32, u32, &image::Rgb<u8>)| pixel.0[1].abs_diff((40 + x + y / 2) as u8);
    let mut all: Vec<u8> = image.enumerate_pixels().map(of).collect();
    all.sort_unstable();
    all[all.len() * 99 / 100]
}

#[test]
fn a_frame_of_a_video_becomes_a_camera() {
    for (name, bytes) in CLIPS {
        let (scratch, mut desk) = open_video(name, bytes);
        wait_for(&mut desk, &format!("Image from {name}"));
        use_image(&mut desk, 1);
        let stem = name.split('.').next().unwrap();
        let camera = &desk.site().cameras[0];
        assert!(camera.id.starts_with(&format!("{stem} at 0.")), "{}", camera.id);
        let saved = image::open(scratch.path(&format!("{}.png", camera.id))).unwrap().into_rgb8();
        assert_eq!((saved.dimensions(), camera.size()), ((96, 64), [96.0, 64.0]), "{name}");
        // The square is visible.
        assert!(difference(&saved) > 30, "{name}");
    }
}

#[test]
fn the_frame_at_a_time_has_the_time_in_its_name() {
    let (_scratch, mut desk) = open_video("door_20260501_083005.mp4", CLIPS[0].1);
    wait_for(&mut desk, "in the folder of the video");
    let frames = |desk: &Desk| {
        let is_frame = |word: &String| word.starts_with("Frame at ");
        let mut words: Vec<String> = desk.words().into_iter().filter(is_frame).collect();
        words.dedup();
        words
    };
    let shown = frames(&desk);
    assert_eq!(shown.len(), 8, "{shown:?}");
    desk.harness.get_by_label(&shown[6]).click();
    desk.harness.run_steps(2);
    let seconds: f64 = shown[6].trim_start_matches("Frame at ").trim_end_matches(" s").parse().unwrap();
    wait_for(&mut desk, &format!("door_20260501_08300{:.3}.png", 5.0 + seconds));
    use_image(&mut desk, 1);
    assert!(desk.site().cameras[0].id.starts_with("door_20260501_0830"), "{}", desk.site().cameras[0].id);
}

#[test]
fn objects_that_move_are_removed() {
    let (scratch, mut desk) = open_video("yard.mp4", CLIPS[0].1);
    wait_for(&mut desk, "Remove moving objects");
    desk.harness.get_by_label("Remove moving objects").click();
    wait_for(&mut desk, "Moving objects covered 2");
    desk.harness.get_by_label("Mark changed pixels").click();
    use_image(&mut desk, 1);
    let saved = image::open(scratch.path("yard empty.png")).unwrap().into_rgb8();
    assert!(difference(&saved) <= 4, "{}", difference(&saved));
}

#[test]
fn several_videos_are_opened_one_after_the_other() {
    let scratch = Scratch::new();
    for (name, bytes) in &CLIPS[..2] {
        scratch.write(name, bytes);
    }
    let mut desk = Desk::new(Site::new());
    open(&mut desk, &scratch, &["h264.mp4", "h265.mp4"]);
    wait_for(&mut desk, "Image from h264.mp4");
    wait_for(&mut desk, "in the folder of the video");
    desk.harness.get_by_label("Cancel").click();
    wait_for(&mut desk, "Image from h265.mp4");
    open(&mut desk, &scratch, &["h264.mp4"]);
    wait_for(&mut desk, "in the folder of the video");
    desk.key(Key::Escape);
    wait_for(&mut desk, "Image from h264.mp4");
    use_image(&mut desk, 1);
    assert!(desk.words().iter().all(|word| !word.contains("Image from")));
    desk.undo();
    assert!(desk.site().cameras.is_empty());
}

#[test]
fn a_damaged_video_is_refused_and_escape_closes_the_sheet() {
    let (_scratch, mut desk) = open_video("cut.mp4", &CLIPS[0].1[..CLIPS[0].1.len() / 3]);
    wait_for(&mut desk, "Image from cut.mp4");
    wait_for(&mut desk, "cut.mp4 is damaged");
    let words = desk.words();
    assert!(!words.iter().any(|word| word.starts_with("Reading the")), "{words:?}");
    assert!(!words.iter().any(|word| word.contains("in the folder of the video")), "{words:?}");
    desk.key(Key::Escape);
    desk.harness.run_steps(2);
    assert!(desk.words().iter().all(|word| !word.contains("Image from")));
    assert!(desk.site().cameras.is_empty());
}

#[test]
fn a_lens_is_imported_after_the_image_of_the_video() {
    let scratch = Scratch::new();
    scratch.write("yard.mp4", CLIPS[0].1);
    scratch.write(
        "yard.yml",
        "%YAML:1.0\n---\nimage_width: 96\nimage_height: 64\n\
         camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 80., 0., 48., 0., 80., 32., 0., 0., 1. ]\n\
         distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.01, 0., 0., 0. ]\n",
    );
    let mut desk = Desk::new(Site::new());
    open(&mut desk, &scratch, &["yard.mp4", "yard.yml"]);
    use_image(&mut desk, 1);
    desk.wait(|app| app.editor.site().cameras.iter().any(|camera| camera.lens.is_some()));
    assert_eq!(desk.site().cameras.len(), 1);
}

#[test]
fn pixels_that_are_not_square_are_entered() {
    let (_scratch, mut desk) =
        open_video("wide.mp4", include_bytes!("../../../calib-video/tests/clips/anamorphic.mp4"));
    use_image(&mut desk, 1);
    let lens = desk.site().cameras[0].lens.clone().unwrap();
    let Some(calib_site::PixelAspectEntry::Known(aspect)) = lens.pixel_aspect else { panic!("{lens:?}") };
    assert!((aspect - 12.0 / 11.0).abs() < 1e-6, "{aspect}");
}
