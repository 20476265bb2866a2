//! `calib undistort`: a camera's image without lens distortion.

use calib_core::{Crop, Distortion, Straightened};
use clap::ValueEnum;
use image::RgbImage;

use crate::files::{self, SiteFile};
use crate::stop::Stop;

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
    /// Site file; a camera without a solution is solved
    site: String,
    /// Which camera
    #[arg(long, value_name = "ID")]
    camera: String,
    /// PNG to write; - is stdout
    #[arg(short, long, value_name = "OUT.png")]
    output: String,
    /// Which part to show
    #[arg(long, value_enum, default_value = "same-focal")]
    crop: CropArg,
    /// Calibrations that hold at this time (RFC 3339)
    #[arg(long, value_name = "TIME")]
    at: Option<String>,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Writes the image, and says which focal and principal point it has.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    files::check_free(&args.output, args.force)?;
    let file = SiteFile::read_at(&args.site, args.at.as_deref())?;
    file.camera(&args.camera)?;
    let file = file.solved();
    let entry = file.camera(&args.camera)?;
    // The lens may be known where the pose is not.
    let (lens, focal) = match &entry.solution {
        Some(solution) => (solution.lens(), Some(solution.focal_px)),
        None => (entry.lens(), None),
    };
    let image = file.camera_image(entry)?;
    let crop = match args.crop {
        CropArg::SameFocal => Crop::SameFocal,
        CropArg::AllValid => Crop::AllValid,
        CropArg::AllPixels => Crop::AllPixels,
    };
    let (width, height) = image.dimensions();
    let too_small = || anyhow::anyhow!("an image of {width} x {height} pixels cannot be mapped");
    let map = Straightened::new(&lens, width as usize, height as usize, crop).ok_or_else(too_small)?;
    let bytes = map.apply(image.as_raw()).ok_or_else(too_small)?;
    let straight = RgbImage::from_raw(width, height, bytes).ok_or_else(too_small)?;
    files::write(&args.output, &files::encoded(&straight, &args.output)?, args.force)?;
    if lens.distortion == Distortion::None {
        files::say("the camera has no distortion: the image is as it was");
    }
    let centre = map.principal_point();
    let focal = focal.map_or_else(|| "unknown".into(), |focal| format!("{:.2} px", map.focal(focal)));
    files::say(format_args!("focal {focal}, principal point {:.2}, {:.2}", centre.u, centre.v));
    Ok(())
}
