//! `calib render`: overlays on an image, or all cameras on the plan.

use calib_core::SiteCamera;
use image::RgbImage;

use crate::files::{self, SiteFile};
use crate::overlay::overlay;
use crate::plan_view::plan_view;
use crate::sigma_map;
use crate::stop::Stop;
use crate::svg::Svg;

/// Arguments of `calib render`.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["camera", "plan"])))]
pub(crate) struct Args {
    /// Site file; cameras without a solution are solved
    site: String,
    /// Draw on this camera's image
    #[arg(long, value_name = "ID")]
    camera: Option<String>,
    /// Draw all cameras on the plan
    #[arg(long)]
    plan: bool,
    /// Shade the floor by its predicted error
    #[arg(long, conflicts_with = "plan")]
    sigma: bool,
    /// PNG to write; - is stdout
    #[arg(short, long, value_name = "OUT.png")]
    output: String,
    /// Calibrations that hold at this time (RFC 3339)
    #[arg(long, value_name = "TIME")]
    at: Option<String>,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Draws and writes a PNG.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    files::check_free(&args.output, args.force)?;
    let file = SiteFile::read_at(&args.site, args.at.as_deref())?;
    if let Some(id) = &args.camera {
        file.camera(id)?;
    }
    let file = file.solved();
    let (ground, svg) = match &args.camera {
        Some(id) => camera_view(&file, file.camera(id)?, args.sigma)?,
        None => plan_view(&file.site, file.plan_image()?),
    };
    files::write(&args.output, &files::encoded(&svg.draw_on(&ground)?, &args.output)?, args.force)
}

/// A camera's image and what is drawn on it.
pub(crate) fn camera_view(file: &SiteFile, entry: &SiteCamera, sigma: bool) -> Result<(RgbImage, Svg), Stop> {
    let mut image = file.camera_image(entry)?;
    let mut svg = overlay(&file.site, entry);
    if sigma {
        let not_calibrated = || Stop::Unsolved(format!("camera \"{}\" is not calibrated", entry.id));
        let camera = entry.camera().ok_or_else(not_calibrated)?;
        sigma_map::shade(&mut image, &mut svg, entry, &camera);
    }
    Ok((image, svg))
}
