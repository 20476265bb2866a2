//! `calib render`: overlays on an image, or all cameras on the plan.

use calib_report::{Svg, is_fitted, overlay};
use calib_site::SiteCamera;
use image::RgbImage;

use crate::args::{OutputArgs, SiteArgs};
use crate::painting::draw_on;
use crate::plan_ground::plan_view;
use crate::progress::Pulse;
use crate::sigma_map;
use crate::site_file::SiteFile;
use crate::stop::Stop;

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

/// What is drawn on a camera's image only when it is wanted.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct Extras {
    /// Shade the floor by its predicted error
    #[arg(long, conflicts_with = "plan")]
    pub(crate) sigma: bool,
    /// Draw a grid that is straight in the scene as the lens bends it; without the flag, where the lens was fitted
    #[arg(long, conflicts_with = "plan")]
    pub(crate) lens_grid: bool,
}

/// Draws and writes a PNG.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    args.output.check_free()?;
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

/// A camera's image and what is drawn on it.
pub(crate) fn camera_view(
    file: &SiteFile,
    entry: &SiteCamera,
    Extras { sigma, lens_grid }: Extras,
) -> Result<(RgbImage, Svg), Stop> {
    let mut image = file.camera_image(entry)?;
    // Under the shades of the error a second grid is only in the way.
    let mut svg = overlay(&file.site, entry, lens_grid || (!sigma && is_fitted(entry)));
    if sigma {
        let not_calibrated = || Stop::Unsolved(format!("camera \"{}\" is not calibrated", entry.id));
        let camera = entry.camera().ok_or_else(not_calibrated)?;
        sigma_map::shade(&mut image, &mut svg, entry, &camera);
    }
    Ok((image, svg))
}
