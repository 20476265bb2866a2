//! Frames of small clips in every container and codec, and damaged clips.
//!
//! The clips were made with ffmpeg (x264, x265 and its own encoders): 12 frames of 96 x 64 pixels, four a
//! second. Their background has the brightness `40 + x + y / 2`. A square of 16 pixels moves by 8 pixels a frame.

use std::io::Cursor;
use std::time::{Duration, Instant};

use calib_video::{Video, VideoError, is_video};
use image::RgbImage;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

const SIZE: [u32; 2] = [96, 64];
const CLIPS: [(&str, &[u8]); 6] = [
    ("h264.mp4", include_bytes!("clips/h264.mp4")),
    ("fragmented.mp4", include_bytes!("clips/fragmented.mp4")),
    ("h264.mkv", include_bytes!("clips/h264.mkv")),
    ("h265.mp4", include_bytes!("clips/h265.mp4")),
    ("mjpeg.avi", include_bytes!("clips/mjpeg.avi")),
    ("anamorphic.mp4", include_bytes!("clips/anamorphic.mp4")),
];

fn open(bytes: &[u8]) -> Result<Video, VideoError> {
    Video::open(Cursor::new(bytes.to_vec()))
}

fn background(x: u32, y: u32) -> u8 {
    (40 + x + y / 2) as u8
}

/// Returns the 99th percentile of the difference between an image and the expected brightness.
fn difference(image: &RgbImage, expected: impl Fn(u32, u32) -> u8) -> u8 {
    let mut off: Vec<u8> =
        image.enumerate_pixels().map(|(x, y, pixel)| pixel.0[1].abs_diff(expected(x, y))).collect();
    off.sort_unstable();
    off[off.len() * 99 / 100]
}

#[test]
fn the_median_shows_the_empty_scene() {
    for (name, bytes) in CLIPS {
        assert!(is_video(bytes), "{name}");
        let mut video = open(bytes).unwrap();
        assert_eq!(video.frame_count(), 12, "{name}");
        assert!((video.duration_s() - 3.0).abs() < 0.01, "{name}: {} s", video.duration_s());
        let mut shares = Vec::new();
        let median = video
            .median(12, &mut |share| {
                shares.push(share);
                true
            })
            .unwrap();
        assert_eq!((median.scene.image.dimensions(), median.times_s.len()), (SIZE.into(), 12), "{name}");
        let off = difference(&median.scene.image, background);
        assert!(off <= 4, "{name}: {off}");
        // The square covers a band of 16 rows.
        let [changed, busy] = [median.scene.changed_share, median.scene.busy_share];
        assert!((changed - 0.25).abs() < 0.03 && busy < 0.01, "{name}: {changed} {busy}");
        assert!(shares.is_sorted() && shares.last() == Some(&1.0), "{name}: {shares:?}");
    }
}

#[test]
fn a_frame_is_found_by_its_time() {
    for (name, bytes) in CLIPS {
        let mut video = open(bytes).unwrap();
        for number in [0, 3, 5, 6, 7, 11_u32] {
            let (time, image) = video.frame_at(0.25 * f64::from(number) + 0.1).unwrap();
            assert!((time - 0.25 * f64::from(number)).abs() < 0.01, "{name}: {number} at {time} s");
            let at = 8 * number;
            let is_square = |x: u32, y: u32| (24..40).contains(&y) && (at..at + 16).contains(&x);
            let off = difference(&image, |x, y| if is_square(x, y) { 235 } else { background(x, y) });
            assert!(off <= 12, "{name}: frame {number}: {off}");
        }
        let error = video.frame_at(60.0).unwrap_err().to_string();
        assert!(error.contains("60.00 s") && error.contains("3.00 s"), "{name}: {error}");
        assert!(matches!(video.median(5, &mut |_| false), Err(VideoError::Cancelled)));
    }
}

#[test]
fn rotation_and_pixel_aspect_are_known() {
    let mut rotated = open(include_bytes!("clips/rotated.mp4")).unwrap();
    let (_, image) = rotated.frame_at(0.0).unwrap();
    assert_eq!(image.dimensions(), (64, 96));
    // Clockwise: the left side of the stored image is at the top.
    let off = difference(&image, |x, y| {
        let [x, y] = [y, 63 - x];
        if (24..40).contains(&y) && x < 16 { 235 } else { background(x, y) }
    });
    assert!(off <= 12, "{off}");
    assert_eq!(rotated.pixel_aspect(), 1.0);
    let anamorphic = open(CLIPS[5].1).unwrap();
    assert!((anamorphic.pixel_aspect() - 12.0 / 11.0).abs() < 1e-9, "{}", anamorphic.pixel_aspect());
}

#[test]
fn other_codecs_and_cut_files_are_named() {
    let error = open(include_bytes!("clips/mpeg4.mp4")).unwrap_err().to_string();
    assert!(error.contains("codec") && error.contains("ffmpeg"), "{error}");
    let whole = CLIPS[0].1;
    let error = open(&whole[..whole.len() / 2]).unwrap_err().to_string();
    assert!(error.contains("damaged"), "{error}");
}

#[test]
fn damaged_clips_give_an_error_or_a_picture_in_time() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for (name, bytes) in CLIPS {
        for round in 0..400 {
            let mut damaged = bytes.to_vec();
            for _ in 0..random.random_range(1..6) {
                let at = random.random_range(0..damaged.len());
                damaged[at] = random.random();
            }
            if round % 5 == 0 {
                damaged.truncate(random.random_range(0..damaged.len()));
            }
            let start = Instant::now();
            let image = open(&damaged).and_then(|mut video| video.median(3, &mut |_| true));
            if let Ok(found) = image {
                assert!(found.scene.image.width() > 0, "{name} {round}");
            }
            assert!(start.elapsed() < Duration::from_secs(20), "{name} {round}: {:?}", start.elapsed());
        }
    }
}
