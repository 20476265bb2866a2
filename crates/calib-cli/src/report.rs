//! `calib report`: writes one self-contained HTML page for handover.

use std::time::{SystemTime, UNIX_EPOCH};

use base64::Engine as _;
use calib_report::{EmbeddedImage, ImageRequest, WalkPage};
use calib_site::SiteCamera;
use image::RgbImage;

use crate::args::{OutputArgs, SiteArgs};
use crate::files::print_message;
use crate::picture;
use crate::progress::Pulse;
use crate::site_file::SiteFile;
use crate::stop::CommandError;
#[cfg(feature = "archives")]
use crate::walk::{WalkArgs, WalkTest};

/// Arguments of `calib report`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[cfg(feature = "archives")]
    #[command(flatten)]
    walk: WalkArgs,
}

/// Writes the page. Fails with exit code 4 if a camera is not solved, or if the walk test fails.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    args.output.check_free()?;
    let file = args.site.read()?;
    #[cfg(feature = "archives")]
    let walk_test = args.walk.test(&file)?;
    #[cfg(feature = "archives")]
    let walk = walk_test.as_ref().map(WalkTest::page);
    #[cfg(not(feature = "archives"))]
    let walk = None;
    let pulse = Pulse::new("drawing the page");
    let page = page(&file, walk.as_ref())?;
    drop(pulse);
    args.output.write(page.as_bytes())?;
    let cameras: Vec<&SiteCamera> = file.site.cameras.iter().collect();
    crate::solve::check_all_solved(&cameras)?;
    #[cfg(feature = "archives")]
    if let Some(walk_test) = &walk_test {
        walk_test.check_passed()?;
    }
    Ok(())
}

/// Builds the page. An unreadable image is reported, and the page shows the reason instead.
fn page(file: &SiteFile, walk: Option<&WalkPage<'_>>) -> Result<String, CommandError> {
    let mut failure = None;
    let mut pictures = |shown: ImageRequest<'_>| match read_picture(file, shown) {
        Ok(picture) => Ok(picture),
        Err(CommandError::Invalid(message)) => {
            print_message(format_args!("calib: {message}"));
            Err(message)
        }
        Err(error) => {
            failure = Some(error);
            Err(String::new())
        }
    };
    let created = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let page = calib_report::page(&file.site, created, walk, &mut pictures);
    failure.map_or(Ok(page), Err)
}

fn read_picture(file: &SiteFile, shown: ImageRequest<'_>) -> Result<EmbeddedImage, CommandError> {
    match shown {
        ImageRequest::Camera(camera) => embed(&file.camera_image(camera)?),
        ImageRequest::Plan => {
            let plan = file.plan_image()?;
            embed(&plan.ok_or_else(|| CommandError::Invalid("the plan has no image".into()))?)
        }
    }
}

/// Returns the image of the plan for a page; `None` if the site has none.
pub(crate) fn plan_picture(file: &SiteFile) -> Result<Option<EmbeddedImage>, CommandError> {
    file.plan_image()?.as_ref().map(embed).transpose()
}

/// Encodes an image for the page.
fn embed(image: &RgbImage) -> Result<EmbeddedImage, CommandError> {
    let data = base64::engine::general_purpose::STANDARD.encode(picture::jpeg(image)?);
    Ok(EmbeddedImage { href: format!("data:image/jpeg;base64,{data}"), size: image.dimensions().into() })
}
