//! Arguments that several subcommands have in common.
//!
//! Which pixels detections are of, as the command line says it.

use std::path::Path;

use clap::ValueEnum;
use image::RgbImage;

use crate::site_file::SiteFile;
use crate::stop::Stop;
use crate::{files, picture};

/// Longest side of a stream that is asked for, in pixels.
const MAX_SIDE: u32 = 16_384;

/// Width and height of a stream, as in 1280x720.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([side(w)?, side(h)?]));
    sides.ok_or_else(|| format!("expected WIDTHxHEIGHT, such as 1280x720, up to {MAX_SIDE}"))
}

/// The site that a command reads.
#[derive(Debug, clap::Args)]
pub(crate) struct SiteArgs {
    /// Site file, or - for stdin; cameras without a solution are solved
    site: String,
    /// Calibrations that hold at this time (RFC 3339)
    #[arg(long, value_name = "TIME")]
    at: Option<String>,
    #[command(flatten)]
    images: ImageArgs,
}

/// Which images of a site are read.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct ImageArgs {
    /// Read images that stand outside the folder of the site, too
    #[arg(long)]
    pub(crate) allow_outside: bool,
}

impl SiteArgs {
    /// Reads, checks and solves the site; cameras that do not hold at the time are left out. What is out of date is
    /// told.
    pub(crate) fn read(&self) -> Result<SiteFile, Stop> {
        let file = self.read_to_judge()?;
        file.tell_out_of_date();
        Ok(file)
    }

    /// As [`Self::read`], for a command that says itself what is wrong.
    pub(crate) fn read_to_judge(&self) -> Result<SiteFile, Stop> {
        let file = SiteFile::read_solved(&self.site, self.at.as_deref())?;
        Ok(file.allowing_outside(self.images.allow_outside))
    }

    /// Whether the site comes from stdin.
    pub(crate) fn is_stdin(&self) -> bool {
        self.site == "-"
    }
}

/// The file that a command writes.
#[derive(Debug, clap::Args)]
pub(crate) struct OutputArgs {
    /// File to write; - is stdout
    #[arg(short, long, value_name = "FILE")]
    output: String,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

impl OutputArgs {
    /// Refuses a path that is taken, before any work is done for it.
    pub(crate) fn check_free(&self) -> Result<(), Stop> {
        files::check_free(&self.output, self.force)
    }

    /// Writes the file whole or not at all.
    pub(crate) fn write(&self, bytes: &[u8]) -> Result<(), Stop> {
        files::write(&self.output, bytes, self.force)
    }

    /// Whether the file is stdout.
    pub(crate) fn is_stdout(&self) -> bool {
        self.output == "-"
    }

    /// The path of one of several files: that of the output with a name in front of its extension, if there is one.
    pub(crate) fn named(&self, name: &str) -> String {
        let path = Path::new(&self.output);
        let (stem, extension) = (path.file_stem(), path.extension());
        if name.is_empty() {
            return self.output.clone();
        }
        let stem = stem.unwrap_or_default().to_string_lossy();
        let extension =
            extension.map_or_else(String::new, |extension| format!(".{}", extension.to_string_lossy()));
        path.with_file_name(format!("{stem}-{name}{extension}")).to_string_lossy().into_owned()
    }

    /// Refuses one of several files that is there.
    pub(crate) fn check_named(&self, path: &str) -> Result<(), Stop> {
        files::check_free(path, self.force)
    }

    /// Writes one of several files whole or not at all.
    pub(crate) fn write_named(&self, path: &str, bytes: &[u8]) -> Result<(), Stop> {
        files::write(path, bytes, self.force)
    }

    /// Writes an image in the format that the file's name asks for.
    pub(crate) fn write_image(&self, image: &RgbImage) -> Result<(), Stop> {
        self.write(&picture::encoded(image, &self.output)?)
    }
}

/// Where pixels are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelOrigin {
    /// From the corner of the image: the centre of the first pixel is (0.5, 0.5)
    Corner,
    /// From the centre of the first pixel, which is (0, 0)
    Centre,
}

/// How the image was brought to the size of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Fit {
    /// Each side by itself: the stream shows the whole image and nothing else
    Stretch,
    /// Both sides alike, with equal bars on two sides, as detectors do
    Letterbox,
}

impl From<PixelOrigin> for calib_core::floor::PixelOrigin {
    fn from(origin: PixelOrigin) -> Self {
        match origin {
            PixelOrigin::Corner => Self::Corner,
            PixelOrigin::Centre => Self::Centre,
        }
    }
}

impl From<Fit> for calib_core::floor::StreamFit {
    fn from(fit: Fit) -> Self {
        match fit {
            Fit::Stretch => Self::Stretch,
            Fit::Letterbox => Self::Letterbox,
        }
    }
}
