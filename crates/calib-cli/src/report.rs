//! `calib report`: one self-contained page to hand over.

use base64::Engine as _;
use calib_report::{Picture, Shown, WalkPage};
use calib_site::SiteCamera;
use image::RgbImage;

use crate::args::{OutputArgs, SiteArgs};
use crate::files::say;
use crate::picture;
use crate::progress::Pulse;
use crate::site_file::SiteFile;
use crate::stop::Stop;
#[cfg(feature = "archives")]
use crate::walk::{Judged, WalkedArgs};

/// Arguments of `calib report`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[cfg(feature = "archives")]
    #[command(flatten)]
    walk: WalkedArgs,
}

/// Writes the page.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    args.output.check_free()?;
    let file = args.site.read()?;
    #[cfg(feature = "archives")]
    let judged = args.walk.judged(&file)?;
    #[cfg(feature = "archives")]
    let walk = judged.as_ref().map(Judged::page);
    #[cfg(not(feature = "archives"))]
    let walk = None;
    let pulse = Pulse::new("drawing the page");
    let page = page(&file, walk.as_ref())?;
    drop(pulse);
    args.output.write(page.as_bytes())?;
    let cameras: Vec<&SiteCamera> = file.site.cameras.iter().collect();
    crate::solve::unsolved(&cameras)?;
    #[cfg(feature = "archives")]
    if let Some(judged) = &judged {
        judged.verdict()?;
    }
    Ok(())
}

/// The whole page; what is wrong with a picture is told, and stands in its place.
fn page(file: &SiteFile, walk: Option<&WalkPage<'_>>) -> Result<String, Stop> {
    let mut ended = None;
    let mut pictures = |shown: Shown<'_>| match shown_in(file, shown) {
        Ok(picture) => Ok(picture),
        Err(Stop::Invalid(message)) => {
            say(format_args!("calib: {message}"));
            Err(message)
        }
        Err(stop) => {
            ended = Some(stop);
            Err(String::new())
        }
    };
    let page = calib_report::page(&file.site, walk, &mut pictures);
    ended.map_or(Ok(page), Err)
}

fn shown_in(file: &SiteFile, shown: Shown<'_>) -> Result<Picture, Stop> {
    match shown {
        Shown::Camera(camera) => embedded(&file.camera_image(camera)?),
        Shown::Plan => {
            let plan = file.plan_image()?;
            embedded(&plan.ok_or_else(|| Stop::Invalid("the plan has no picture".into()))?)
        }
    }
}

/// A picture as the page has it.
fn embedded(image: &RgbImage) -> Result<Picture, Stop> {
    let data = base64::engine::general_purpose::STANDARD.encode(picture::jpeg(image)?);
    Ok(Picture { href: format!("data:image/jpeg;base64,{data}"), size: image.dimensions().into() })
}
