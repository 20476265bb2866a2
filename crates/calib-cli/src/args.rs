//! Arguments that several subcommands share: the site, the output file, and the pixel coordinates of
//! detections.

use std::path::Path;

use calib_site::CoordinateSystem;
use clap::ValueEnum;
use image::RgbImage;

use crate::site_file::SiteFile;
use crate::stop::CommandError;
use crate::{files, picture};

/// Largest accepted side of a stream, in pixels.
const MAX_STREAM_SIDE_PX: u32 = 16_384;

/// Parses a unit of length (mm, cm, m, in or ft), and returns its length in metres.
pub(crate) fn unit(text: &str) -> Result<f64, String> {
    match text {
        "mm" => Ok(1e-3),
        "cm" => Ok(1e-2),
        "m" => Ok(1.0),
        "in" => Ok(0.0254),
        "ft" => Ok(0.3048),
        _ => Err("expected mm, cm, m, in or ft".into()),
    }
}

/// Parses the width and height of a stream, as in 1280x720.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=MAX_STREAM_SIDE_PX).contains(side));
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([side(w)?, side(h)?]));
    sides.ok_or_else(|| {
        format!("expected WIDTHxHEIGHT, such as 1280x720, each side at most {MAX_STREAM_SIDE_PX} pixels")
    })
}

/// Parses the name of a projected grid.
pub(crate) fn grid(name: &str) -> Result<CoordinateSystem, String> {
    CoordinateSystem::new(name).map_err(|error| format!("expected {error}"))
}

/// Arguments for the site that a command reads.
#[derive(Debug, clap::Args)]
pub(crate) struct SiteArgs {
    /// Site file, or - for stdin; cameras without a solution are solved first
    site: String,
    /// Use the calibrations that are valid at this time (RFC 3339)
    #[arg(long, value_name = "TIME")]
    at: Option<String>,
    #[command(flatten)]
    images: ImageArgs,
}

/// Arguments for the images of a site.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct ImageArgs {
    /// Also read images outside the site's folder
    #[arg(long)]
    pub(crate) allow_outside: bool,
}

impl SiteArgs {
    /// Reads, checks and solves the site, and warns about outdated solutions. Cameras that are not valid at the time
    /// of `--at` are left out.
    pub(crate) fn read(&self) -> Result<SiteFile, CommandError> {
        let file = self.read_without_warnings()?;
        file.warn_out_of_date();
        Ok(file)
    }

    /// Reads the site as [`Self::read`] does, without warnings: for commands that report outdated solutions
    /// themselves.
    pub(crate) fn read_without_warnings(&self) -> Result<SiteFile, CommandError> {
        SiteFile::read_solved(&self.site, self.at.as_deref(), self.images.allow_outside)
    }

    /// Returns the time at which the calibrations must be valid.
    pub(crate) fn time(&self) -> Option<&str> {
        self.at.as_deref()
    }

    /// Whether the site comes from stdin.
    pub(crate) fn is_stdin(&self) -> bool {
        self.site == "-"
    }
}

/// Arguments for the file that a command writes.
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
    /// Refuses an existing output file before any work is done, unless `--force` is given.
    pub(crate) fn check_free(&self) -> Result<(), CommandError> {
        files::check_free(&self.output, self.force)
    }

    /// Checks the extension of an output image before any work is done, and refuses an existing file as
    /// [`Self::check_free`] does.
    pub(crate) fn check_picture(&self) -> Result<(), CommandError> {
        picture::is_jpeg_name(&self.output)?;
        self.check_free()
    }

    /// Writes the complete file, or nothing.
    pub(crate) fn write(&self, bytes: &[u8]) -> Result<(), CommandError> {
        files::write(&self.output, bytes, self.force)
    }

    /// Whether the output is stdout.
    pub(crate) fn is_stdout(&self) -> bool {
        self.output == "-"
    }

    /// Returns whether the output is written as JPEG. See [`picture::is_jpeg_name`].
    ///
    /// # Errors
    /// If the extension is not `.png`, `.jpg` or `.jpeg`.
    #[cfg(feature = "stills")]
    pub(crate) fn is_jpeg(&self) -> Result<bool, CommandError> {
        picture::is_jpeg_name(&self.output)
    }

    /// Returns the path of one of several output files: the output path with `-name` before its extension. For an
    /// empty name, returns the output path.
    pub(crate) fn path_for(&self, name: &str) -> String {
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

    /// Returns the path of a file in the output folder.
    #[cfg(feature = "stills")]
    pub(crate) fn path_in(&self, name: &str) -> String {
        Path::new(&self.output).join(name).to_string_lossy().into_owned()
    }

    /// Creates the output folder, if it does not exist.
    #[cfg(feature = "stills")]
    pub(crate) fn create_folder(&self) -> Result<(), CommandError> {
        std::fs::create_dir_all(&self.output).map_err(|error| CommandError::invalid(&self.output, error))
    }

    /// Refuses an existing file at `path`, one of several output files, unless `--force` is given.
    pub(crate) fn check_path_free(&self, path: &str) -> Result<(), CommandError> {
        files::check_free(path, self.force)
    }

    /// Writes one of several output files completely, or not at all.
    pub(crate) fn write_to(&self, path: &str, bytes: &[u8]) -> Result<(), CommandError> {
        files::write(path, bytes, self.force)
    }

    /// Writes an image in the format given by the file name's extension.
    pub(crate) fn write_image(&self, image: &RgbImage) -> Result<(), CommandError> {
        self.write(&picture::encode(image, &self.output)?)
    }
}

/// Origin of pixel coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelOrigin {
    /// The corner of the image: the centre of the first pixel is (0.5, 0.5)
    Corner,
    /// The centre of the first pixel, which is (0, 0)
    Centre,
}

/// Scaling of the image to the size of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Fit {
    /// Width and height are scaled separately: the image fills the stream without bars
    Stretch,
    /// Width and height are scaled equally, with equal bars on two sides (letterboxing, as in detectors)
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
