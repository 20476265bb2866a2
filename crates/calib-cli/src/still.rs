//! `calib still`: writes a still image from a video file, or snapshots from the addresses of cameras.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use calib_image::EmptyScene;
use calib_video::{Video, VideoError, is_address, is_video};
use image::RgbImage;
use indicatif::{ProgressBar, ProgressStyle};

use crate::args::OutputArgs;
use crate::files::print_message;
use crate::snapshot::{self, SnapshotArgs};
use crate::snapshot_list;
use crate::stop::CommandError;

/// Arguments of `calib still`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Video file (MP4, MOV, MKV, AVI; H.264, H.265, motion JPEG), or address of a camera (http, https, rtsp)
    #[arg(value_name = "VIDEO|URL", required_unless_present = "all")]
    source: Option<String>,
    /// List of cameras (TOML with ids and addresses); writes the image of each camera as ID.jpg to the
    /// --output folder
    #[arg(long, value_name = "FILE", conflicts_with_all = ["source", "at", "median"])]
    all: Option<PathBuf>,
    /// Time of the frame from the start of the video: seconds, MM:SS or HH:MM:SS [default: the first frame]
    #[arg(long, value_name = "TIME", value_parser = seconds, conflicts_with = "median")]
    at: Option<f64>,
    /// Write the median of this number of frames, evenly spaced over the video; people and vehicles disappear
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=201))]
    median: Option<u16>,
    #[command(flatten)]
    snapshot: SnapshotArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes a still image from a video, a snapshot from an address, or the snapshots of a list of cameras.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if let Some(list) = &args.all {
        return snapshot_list::run(list, &args.snapshot, &args.output);
    }
    args.output.check_picture()?;
    let source = args.source.as_deref().unwrap_or_default();
    if is_address(source) {
        if args.at.is_some() || args.median.is_some() {
            let what = "--at and --median are for video files; the address of a camera gives one image";
            return Err(CommandError::Usage(what.into()));
        }
        return snapshot::run(source, &args.snapshot, &args.output);
    }
    let path = Path::new(source);
    let invalid = |error: VideoError| CommandError::invalid(path.display(), error);
    let file = File::open(path).map_err(|error| invalid(error.into()))?;
    let mut video = Video::open(BufReader::new(file)).map_err(|error| match error {
        VideoError::NotVideo if is_image(path) => {
            let what = "is an image, not a video; use this image directly";
            CommandError::invalid(path.display(), what)
        }
        error => invalid(error),
    })?;
    let image = match args.median {
        Some(count) => median(&mut video, count).map_err(invalid)?,
        None => {
            let (time, image) = video.frame_at(args.at.unwrap_or(0.0)).map_err(invalid)?;
            print_message(format_args!("calib: frame at {time:.2} s of {:.2} s", video.duration_s()));
            image
        }
    };
    snapshot::print_pixel_aspect("", video.pixel_aspect());
    args.output.write_image(&image)
}

/// Whether a file is an image.
fn is_image(path: &Path) -> bool {
    calib_input::read(path, 1 << 30)
        .is_ok_and(|bytes| !is_video(&bytes) && calib_input::image_size(&bytes).is_ok())
}

/// Computes the median of `count` frames, with a progress bar.
fn median(video: &mut Video, count: u16) -> Result<RgbImage, VideoError> {
    let bar = ProgressBar::new(u64::from(count));
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} frames, {eta} left") {
        bar.set_style(style);
    }
    let found = video.median(usize::from(count), &mut |share| {
        bar.set_position((share * f64::from(count)).round() as u64);
        true
    })?;
    bar.finish_and_clear();
    print_message(format_args!(
        "calib: median of {} of {} frames; moving objects covered {:.1} % of the image",
        found.times_s.len(),
        video.frame_count(),
        100.0 * found.scene.changed_share
    ));
    if found.scene.busy_share > EmptyScene::MAX_BUSY_SHARE {
        print_message(format_args!(
            "calib: objects that hardly moved may be visible in {:.1} % of the image; use a longer video",
            100.0 * found.scene.busy_share
        ));
    }
    Ok(found.scene.image)
}

/// Parses a time: seconds, MM:SS or HH:MM:SS.
fn seconds(text: &str) -> Result<f64, String> {
    let parts: Vec<&str> = text.split(':').collect();
    let total = parts.iter().try_fold(0.0, |total, part| {
        let value: f64 = part.parse().ok()?;
        (value >= 0.0 && (parts.len() == 1 || value < 60.0 || total == 0.0)).then_some(60.0 * total + value)
    });
    total
        .filter(|total: &f64| parts.len() <= 3 && total.is_finite())
        .ok_or_else(|| "expected seconds, MM:SS or HH:MM:SS".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_seconds_or_with_colons() {
        for (text, expected) in [("12.5", 12.5), ("1:30", 90.0), ("01:02:03.5", 3723.5), ("0", 0.0)] {
            assert_eq!(seconds(text), Ok(expected), "{text}");
        }
        for text in ["", "-1", "1:2:3:4", "1:75:00", "NaN", "x"] {
            assert!(seconds(text).is_err(), "{text}");
        }
    }
}
