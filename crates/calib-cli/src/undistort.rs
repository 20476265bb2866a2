//! `calib undistort`: a camera's image without lens distortion, whole or in windows.

use calib_core::{Distortion, Undistortion};

use calib_core::floor::Crop;
use clap::ValueEnum;
use image::RgbImage;

use crate::args::{OutputArgs, SiteArgs};
use crate::files;
use crate::stop::Stop;
use crate::windows::{self, WindowArgs};
use calib_report::lens_of;

/// Which part of the undistorted plane to show.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum CropArg {
    /// The centre keeps its scale
    SameFocal,
    /// The largest view without a blank pixel
    AllValid,
    /// Every pixel of the image, blank beyond
    AllPixels,
}

/// Arguments of `calib undistort`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Which camera
    #[arg(long, value_name = "ID")]
    camera: String,
    /// Which part to show
    #[arg(long, value_enum, default_value = "same-focal")]
    crop: CropArg,
    #[command(flatten)]
    windows: WindowArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes the image, and says which focal and principal point it has; or the windows that are asked for.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    args.windows.check()?;
    if !args.windows.is_asked() {
        args.output.check_free()?;
    }
    let file = args.site.read()?;
    let entry = file.camera(&args.camera)?;
    let lens = lens_of(entry);
    if let (None, Distortion::None, Some(error)) = (&entry.solution, lens.distortion, &entry.error) {
        let what = format!("camera \"{}\": nothing tells its lens: {}", entry.id, error.message);
        return Err(Stop::Unsolved(what));
    }
    let focal = entry.solution.as_ref().map(|solution| solution.focal_px);
    let image = file.camera_image(entry)?;
    if args.windows.is_asked() {
        return windows::run(&args.windows, &args.output, entry, &image);
    }
    let crop = match args.crop {
        CropArg::SameFocal => Crop::SameFocal,
        CropArg::AllValid => Crop::AllValid,
        CropArg::AllPixels => Crop::AllPixels,
    };
    let (width, height) = image.dimensions();
    let too_small = || anyhow::anyhow!("an image of {width} x {height} pixels cannot be mapped");
    let made = |crop| Undistortion::new(&lens, width as usize, height as usize, crop);
    let is_round = made(crop).is_none() && made(Crop::SameFocal).is_some();
    if is_round {
        return Err(Stop::Usage(format!(
            "camera \"{}\": no flat image holds all that its lens shows. Leave --crop out, or take --look, --quadrants or \
             --panorama",
            entry.id
        )));
    }
    let map = made(crop).ok_or_else(too_small)?;
    let bytes = map.apply(image.as_raw()).ok_or_else(too_small)?;
    let straight = RgbImage::from_raw(width, height, bytes).ok_or_else(too_small)?;
    args.output.write_image(&straight)?;
    if lens.distortion == Distortion::None {
        files::say("the camera has no distortion: the image is as it was");
    }
    let centre = map.principal_point();
    let focal = focal.map_or_else(|| "unknown".into(), |focal| format!("{:.2} px", map.focal(focal)));
    files::say(format_args!("focal {focal}, principal point {:.2}, {:.2}", centre.u, centre.v));
    Ok(())
}
