//! `calib render`: draws overlays on an image, or all cameras on the plan.

use calib_report::{Svg, is_lens_estimated, overlay};
use calib_site::SiteCamera;
use image::RgbImage;

use crate::args::{OutputArgs, SiteArgs};
use crate::painting::draw_on;
use crate::plan_ground::plan_view;
use crate::progress::Pulse;
use crate::sigma_map;
use crate::site_file::{SiteFile, calibrated_camera};
use crate::stop::CommandError;

/// Arguments of `calib render`.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["camera", "plan"])))]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Draw on this camera's image
    #[arg(long, value_name = "ID")]
    camera: Option<String>,
    /// Draw all cameras on the plan
    #[arg(long)]
    plan: bool,
    #[command(flatten)]
    extras: Extras,
    #[command(flatten)]
    output: OutputArgs,
}

/// Optional overlays of a camera's image.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct Extras {
    /// Colour the floor by its predicted error
    #[arg(long, conflicts_with = "plan")]
    pub(crate) sigma: bool,
    /// Draw a regular grid distorted by the lens; without --sigma, always drawn if the lens was estimated
    #[arg(long, conflicts_with = "plan")]
    pub(crate) lens_grid: bool,
}

/// Renders and writes the image.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    args.output.check_picture()?;
    let file = args.site.read()?;
    if let Some(id) = &args.camera {
        file.camera(id)?;
    }
    let _pulse = Pulse::new("drawing");
    let (ground, svg) = match &args.camera {
        Some(id) => camera_view(&file, file.camera(id)?, args.extras)?,
        None => plan_view(&file.site, file.plan_image()?),
    };
    args.output.write_image(&draw_on(&svg, &ground)?)
}

/// Returns a camera's image with its overlays.
pub(crate) fn camera_view(
    file: &SiteFile,
    entry: &SiteCamera,
    Extras { sigma, lens_grid }: Extras,
) -> Result<(RgbImage, Svg), CommandError> {
    let mut image = file.camera_image(entry)?;
    // A second grid would hide the colours of the error.
    let mut svg = overlay(&file.site, entry, lens_grid || (!sigma && is_lens_estimated(entry)));
    if sigma {
        let camera = calibrated_camera(entry)?;
        sigma_map::shade(&mut image, &mut svg, entry, &camera);
    }
    Ok((image, svg))
}
