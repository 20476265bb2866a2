//! Files in memory, as exports return them and imports take them.
//!
//! Also the errors of a file, with their position and their message.

use std::fmt;

use calib_site::SiteError;

/// Error in a file that could not be read or written.
#[derive(Clone, Debug, PartialEq)]
pub struct FormatError {
    /// Name of the file, and the position in the file: a JSON pointer or a line number.
    pub place: String,
    /// Cause of the error, with its values.
    pub problem: Problem,
}

/// Cause of an error in a file.
#[derive(Clone, Debug, PartialEq)]
pub enum Problem {
    /// A value is not allowed here.
    Unexpected {
        /// Value that was found.
        found: String,
        /// Values that are allowed.
        expected: String,
    },
    /// All of these keys are missing.
    MissingKey(Vec<String>),
    /// A file is missing that belongs to another file.
    MissingFile {
        /// Name of the present file that refers to the missing file.
        companion: String,
    },
    /// A required file of a COLMAP model is missing.
    NotColmap,
    /// No file with one of these extensions was given.
    NoFiles(&'static [&'static str]),
    /// The file is not UTF-8 text.
    NotUtf8 {
        /// Offset of the first invalid byte.
        at: usize,
    },
    /// The text violates the syntax of its format.
    Syntax {
        /// Name of the syntax.
        syntax: &'static str,
        /// Message of the parser.
        why: String,
    },
    /// A value of the text cannot be represented.
    Unrepresentable {
        /// Message of the converter.
        why: String,
    },
    /// The file contains no text.
    Empty,
    /// Brackets are nested too deeply.
    DeepBrackets {
        /// Largest accepted depth.
        most: usize,
    },
    /// Elements are nested too deeply.
    DeepElements,
    /// The file is too short for an fSpy project, or has another signature.
    NotFspy {
        /// Whether the file is too short.
        is_short: bool,
    },
    /// The file is incomplete: it ends before all data that it announces.
    CutOff,
    /// The focal lengths in x and y, in pixels, are not positive, finite and similar.
    NoFocal([f64; 2]),
    /// The principal point suggests another image size than the stated one.
    TwoResolutions {
        /// Stated width and height, in pixels.
        stated: [u32; 2],
        /// Twice the principal point, in pixels.
        suggested: [f64; 2],
    },
    /// The size of the image is missing and cannot be derived.
    NoSize,
    /// A projection matrix counts pixels from the centre of an image of unknown size.
    NoSizeOfCentred,
    /// A quaternion has length 0.
    NoRotation,
    /// The rows of a rotation are not right-handed unit vectors.
    InvalidRotation,
    /// A matrix is not an intrinsic matrix.
    InvalidIntrinsics,
    /// A 3 x 4 matrix is not the projection matrix of a camera.
    InvalidProjection,
    /// The numbers of pixels and of world points differ.
    Unpaired {
        /// Number of pixels.
        pixels: usize,
        /// Number of world points.
        points: usize,
    },
    /// The file contains no camera.
    NoCamera,
    /// A unit or a left-handed world is stated for a format without poses.
    NoPoses,
    /// An image size is stated for files without cameras.
    NoCameras,
    /// The fSpy project contains no camera.
    NoCameraInProject,
    /// A field of view is given without an image size.
    AngleWithoutSize,
    /// The content is not a valid site.
    InvalidSite(Box<SiteError>),
    /// The format can be imported, but not exported.
    ReadOnly,
    /// The format can be exported, but not imported.
    WriteOnly,
    /// No camera of the site is calibrated.
    NothingToExport,
    /// The format needs positions on the map, and the site has no georeference.
    NoGeoreference,
    /// Several periods share the id of one camera.
    SeveralPeriods,
    /// A camera's id is used as a file name, but is not valid or not unique.
    InvalidFileName,
}

impl FormatError {
    pub(crate) fn new(place: impl Into<String>, problem: Problem) -> Self {
        Self { place: place.into(), problem }
    }

    pub(crate) fn expected(
        place: impl Into<String>,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        let problem = Problem::Unexpected { found: found.to_string(), expected: expected.to_string() };
        Self::new(place, problem)
    }

    /// Returns the message without the position in the file.
    #[must_use]
    pub fn message(&self) -> String {
        self.problem.to_string()
    }
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.problem)
    }
}

impl std::error::Error for FormatError {}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unexpected { found, expected } => write!(f, "found {found}, expected {expected}"),
            Self::MissingKey(keys) => write!(f, "expected {}", keys.join(" or ")),
            Self::MissingFile { companion } => write!(f, "is missing; {companion} refers to it"),
            Self::NoFiles(extensions) => {
                write!(f, "found no file with the extension .{}", extensions.join(" or ."))
            }
            Self::NotUtf8 { at } => write!(f, "not UTF-8 text at byte {at}"),
            Self::Syntax { syntax, why } => write!(f, "not {syntax}: {why}"),
            Self::Unrepresentable { why } => f.write_str(why),
            Self::DeepBrackets { most } => write!(f, "found brackets nested more than {most} deep"),
            Self::NoFocal([fx, fy]) => {
                write!(
                    f,
                    "found focal lengths {fx} in x and {fy} in y, expected similar values above 0, in pixels"
                )
            }
            Self::TwoResolutions { stated: [w, h], suggested: [x, y] } => write!(
                f,
                "found an image of {w} x {h} pixels and a camera matrix for an image of about {x:.0} x {y:.0}, \
                 expected one resolution; correct the size (calib import --size), or scale the matrix"
            ),
            Self::Unpaired { pixels, points } => {
                write!(
                    f,
                    "found {pixels} imageCoordinates and {points} globalCoordinates, expected equal numbers"
                )
            }
            Self::InvalidSite(error) => write!(f, "the result is not a valid site: {error}"),
            _ => f.write_str(self.fixed_message()),
        }
    }
}

impl Problem {
    /// Returns the message of a problem that has no values; empty for the others.
    const fn fixed_message(&self) -> &'static str {
        match self {
            Self::NotColmap => {
                "is missing; expected a folder with cameras.txt and images.txt, or with cameras.bin and images.bin"
            }
            Self::NoCameraInProject => {
                "the project has no camera: its vanishing points do not meet, or it was saved by an old version; open it \
                 in fSpy and save it again"
            }
            Self::AngleWithoutSize => {
                "found camera_angle_x, but no w and h; the field of view alone does not determine pixels, so add \
                 the image size (calib import --size)"
            }
            Self::Empty => "is empty; export the calibration again",
            Self::DeepElements => "found elements nested too deeply",
            Self::NotFspy { is_short: true } => "found fewer than 16 bytes, expected an fSpy project",
            Self::NotFspy { .. } => "found no \"fspy\" at the beginning, expected an fSpy project",
            Self::CutOff => "is incomplete: the file ends early",
            Self::NoSize => {
                "found no image size, and no principal point to derive it from; add the size (calib import --size)"
            }
            Self::NoSizeOfCentred => {
                "counts pixels from the centre of the image, whose size is not in the file; add it \
                 (calib import --size 1920x1080)"
            }
            Self::NoRotation => "found a quaternion of length 0",
            Self::InvalidRotation => "found a rotation whose rows are not right-handed unit vectors",
            Self::InvalidIntrinsics => "found a matrix that is not [fx 0 cx; 0 fy cy; 0 0 1]",
            Self::InvalidProjection => "found a matrix that is not a camera projection",
            Self::NoCamera => "found no camera",
            Self::NoPoses => "contains no poses; leave out the options for poses (--unit, --left-handed)",
            Self::NoCameras => "contains no cameras; leave out --size",
            Self::ReadOnly => "can be imported but not exported",
            Self::WriteOnly => "can be exported but not imported",
            Self::NothingToExport => "has no calibrated camera; solve it first",
            Self::NoGeoreference => {
                "has no georeference, so that no position on the map is known; add \"georeference\", or two control points \
                 with \"lat_deg\" and \"lon_deg\""
            }
            Self::SeveralPeriods => "several periods have this id; choose one with --at TIME",
            Self::InvalidFileName => {
                "this id is used as a file name, but is not a valid or unique one; use letters, digits, \".\", \
                 \"-\" and \"_\""
            }
            Self::Unexpected { .. }
            | Self::MissingKey(_)
            | Self::MissingFile { .. }
            | Self::NoFiles(_)
            | Self::NotUtf8 { .. }
            | Self::Syntax { .. }
            | Self::Unrepresentable { .. }
            | Self::DeepBrackets { .. }
            | Self::NoFocal(_)
            | Self::TwoResolutions { .. }
            | Self::Unpaired { .. }
            | Self::InvalidSite(_) => "",
        }
    }
}

/// Quotes a text from a file for an error message. It is cut to 60 characters, so that a hostile file cannot
/// fill the screen.
pub(crate) fn quoted(text: &str) -> String {
    const MAX_CHARS: usize = 60;
    let short: String = text.chars().take(MAX_CHARS).collect();
    if short.len() < text.len() { format!("{short:?}...") } else { format!("{short:?}") }
}

/// Largest accepted size of an imported file, in bytes.
pub const MAX_BYTES: usize = 64 << 20;
/// Largest accepted number of files of one import.
pub const MAX_FILES: usize = 20_000;
/// Largest length of a file name that is made from a camera id, in characters.
const MAX_NAME_CHARS: usize = 100;

/// File in memory; its name may contain folders, separated by `/`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Path relative to the folder of the import or export.
    pub name: String,
    /// Content of the file.
    pub bytes: Vec<u8>,
}

impl File {
    pub(crate) fn text(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self { name: name.into(), bytes: text.into().into_bytes() }
    }

    /// Returns the last component of the path.
    pub(crate) fn base(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or_default()
    }

    /// Returns the last component of the path, without its extension.
    pub(crate) fn stem(&self) -> &str {
        stem(&self.name)
    }

    /// Returns the path of another file. `other` is its name in this file, relative to the folder of this file.
    pub(crate) fn path_beside(&self, other: &str) -> String {
        self.name.rsplit_once('/').map_or(other.to_owned(), |(folder, _)| format!("{folder}/{other}"))
    }

    /// Returns the extension in lower case, without the dot.
    pub(crate) fn extension(&self) -> String {
        self.base().rsplit_once('.').map_or(String::new(), |(_, extension)| extension.to_lowercase())
    }

    pub(crate) fn as_text(&self) -> Result<&str, FormatError> {
        let found = self.bytes.len();
        if found > MAX_BYTES {
            return Err(FormatError::expected(
                &self.name,
                format!("{found} bytes"),
                format!("at most {MAX_BYTES}"),
            ));
        }
        let text = std::str::from_utf8(&self.bytes)
            .map_err(|error| FormatError::new(&self.name, Problem::NotUtf8 { at: error.valid_up_to() }))?;
        Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
    }
}

/// Returns the last component of a path, without its extension.
pub(crate) fn stem(path: &str) -> &str {
    let base = path.rsplit('/').next().unwrap_or_default();
    base.rsplit_once('.').map_or(base, |(stem, _)| stem)
}

/// Converts a camera id to a file name that is valid on every operating system.
pub(crate) fn file_name(id: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let name: String = id.chars().take(MAX_NAME_CHARS).map(plain).collect();
    let dots = name.chars().take_while(|&c| c == '.').count();
    if dots == 0 { name } else { format!("{}{}", "_".repeat(dots), &name[dots..]) }
}
