//! `calib undistort`: writes a camera's image without lens distortion, completely or as virtual views.

use calib_core::{Distortion, Undistortion};

use calib_core::floor::Crop;
use clap::ValueEnum;
use image::RgbImage;

use crate::args::{OutputArgs, SiteArgs};
use crate::files;
use crate::stop::CommandError;
use crate::windows::{self, WindowArgs};
use calib_report::camera_lens;

/// Part of the undistorted plane that the written image shows.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum CropArg {
    /// The centre keeps its scale
    SameFocal,
    /// The largest view without blank pixels
    AllValid,
    /// All pixels of the image, with blank margins
    AllPixels,
}

/// Arguments of `calib undistort`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Camera to undistort
    #[arg(long, value_name = "ID")]
    camera: String,
    /// Part of the undistorted image to show
    #[arg(long, value_enum, default_value = "same-focal")]
    crop: CropArg,
    #[command(flatten)]
    windows: WindowArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes the undistorted image and prints its focal length and principal point, or writes the requested
/// views.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    args.windows.check()?;
    if !args.windows.is_requested() {
        args.output.check_picture()?;
    }
    let file = args.site.read()?;
    let entry = file.camera(&args.camera)?;
    let lens = camera_lens(entry);
    if let (None, Distortion::None, Some(error)) = (&entry.solution, lens.distortion, &entry.error) {
        let what =
            format!("the lens of camera \"{}\" is unknown: {} {}", entry.id, error.message, error.advice);
        return Err(CommandError::Unsolved(what));
    }
    let focal = entry.solution.as_ref().map(|solution| solution.focal_px);
    let image = file.camera_image(entry)?;
    if args.windows.is_requested() {
        return windows::run(&args.windows, &args.output, entry, &image);
    }
    let crop = match args.crop {
        CropArg::SameFocal => Crop::SameFocal,
        CropArg::AllValid => Crop::AllValid,
        CropArg::AllPixels => Crop::AllPixels,
    };
    let (width, height) = image.dimensions();
    let id = &entry.id;
    let too_small = || {
        anyhow::anyhow!("camera \"{id}\": an image of {width} x {height} pixels is too small to undistort")
    };
    let made = |crop| Undistortion::new(&lens, width as usize, height as usize, crop);
    let is_round = made(crop).is_none() && made(Crop::SameFocal).is_some();
    if is_round {
        return Err(CommandError::Usage(format!(
            "a flat image cannot show the whole field of view of camera \"{id}\"; omit --crop, or use --look, \
             --quadrants or --panorama"
        )));
    }
    let map = made(crop).ok_or_else(too_small)?;
    let bytes = map.apply(image.as_raw()).ok_or_else(too_small)?;
    let straight = RgbImage::from_raw(width, height, bytes).ok_or_else(too_small)?;
    args.output.write_image(&straight)?;
    if lens.distortion == Distortion::None {
        files::print_message(format_args!("camera \"{id}\": no distortion; the image is unchanged"));
    }
    let centre = map.principal_point();
    let focal = focal.map_or_else(|| "unknown".into(), |focal| format!("{:.2} px", map.focal(focal)));
    files::print_message(format_args!(
        "focal length {focal}, principal point {:.2}, {:.2} px",
        centre.u, centre.v
    ));
    Ok(())
}
