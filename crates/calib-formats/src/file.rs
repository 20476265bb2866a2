//! A file in memory: what an export gives and what an import takes.
//!
//! What is wrong with a file, and where in it; in words once.

use std::fmt;

use calib_site::SiteError;

/// Why a file could not be read or written.
#[derive(Clone, Debug, PartialEq)]
pub struct FormatError {
    /// The file, and the place in it: a JSON pointer or a line.
    pub place: String,
    /// What is wrong there.
    pub problem: Problem,
}

/// What is wrong with a file.
#[derive(Clone, Debug, PartialEq)]
pub enum Problem {
    /// It is there and cannot be so.
    Unexpected {
        /// What was found.
        found: String,
        /// What can be so.
        expected: String,
    },
    /// None of these keys is there.
    MissingKey(Vec<String>),
    /// A file that belongs to another one is not there.
    MissingFile {
        /// The other one.
        beside: String,
    },
    /// The folder does not have the two files of a COLMAP model.
    NotColmap,
    /// No file of these extensions was given.
    NoFiles(&'static [&'static str]),
    /// The bytes are no text from here on.
    NotUtf8 {
        /// Where, in bytes.
        at: usize,
    },
    /// The text does not follow its syntax.
    Syntax {
        /// Its syntax.
        syntax: &'static str,
        /// What the reader of that syntax says.
        why: String,
    },
    /// A value of a text has no place in any document.
    Unrepresentable {
        /// What the writer says.
        why: String,
    },
    /// The file has no text.
    Empty,
    /// Brackets open inside each other deeper than is read.
    DeepBrackets {
        /// The deepest that is read.
        most: usize,
    },
    /// Elements stand inside each other deeper than is read.
    DeepElements,
    /// The file is too short for an fSpy project, or does not begin as one.
    NotFspy {
        /// It is too short.
        is_short: bool,
    },
    /// The file ends before what it announces.
    CutOff,
    /// The focals are no focals.
    NoFocal([f64; 2]),
    /// The pixels are not square.
    UnequalFocals([f64; 2]),
    /// Nothing tells the size of the image.
    NoSize,
    /// A quaternion has no length.
    NoRotation,
    /// The rows of a rotation are not right-handed unit vectors.
    NotARotation,
    /// A matrix is not that of intrinsics.
    NotIntrinsics,
    /// A projection matrix is that of no camera.
    NotAProjection,
    /// Pixels and the points that they show do not pair.
    Unpaired {
        /// How many pixels there are.
        pixels: usize,
        /// How many points there are.
        points: usize,
    },
    /// There is no camera in it.
    NoCamera,
    /// What was read makes no site.
    NotASite(Box<SiteError>),
    /// The format is read and not written.
    ReadOnly,
    /// The format is written and not read.
    WriteOnly,
    /// No camera of the site is calibrated.
    NothingToExport,
    /// Several periods have the id of one camera.
    SeveralPeriods,
    /// An id by which a file is looked for has characters that no name of a file has.
    NotAFileName,
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

    /// What was found and what is expected.
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
            Self::MissingFile { beside } => write!(f, "is not there, and {beside} is"),
            Self::NoFiles(extensions) => write!(f, "found no file (.{})", extensions.join(", .")),
            Self::NotUtf8 { at } => write!(f, "not UTF-8 text at byte {at}"),
            Self::Syntax { syntax, why } => write!(f, "not {syntax}: {why}"),
            Self::Unrepresentable { why } => f.write_str(why),
            Self::DeepBrackets { most } => write!(f, "found brackets more than {most} deep"),
            Self::NoFocal([fx, fy]) => write!(f, "found focals {fx} and {fy}, expected pixels above 0"),
            Self::UnequalFocals([fx, fy]) => write!(
                f,
                "found focals {fx} in x and {fy} in y: the pixels are not square; scale the image first"
            ),
            Self::Unpaired { pixels, points } => {
                write!(f, "found {pixels} imageCoordinates and {points} globalCoordinates")
            }
            Self::NotASite(error) => write!(f, "as a site, {error}"),
            _ => f.write_str(self.plain()),
        }
    }
}

impl Problem {
    /// What is said of a problem without numbers.
    const fn plain(&self) -> &'static str {
        match self {
            Self::NotColmap => "is not there; expected a folder with cameras.txt and images.txt",
            Self::Empty => "found an empty file",
            Self::DeepElements => "found elements too deep",
            Self::NotFspy { is_short: true } => "found fewer than 16 bytes, expected an fSpy project",
            Self::NotFspy { .. } => "found no \"fspy\" at the beginning, expected an fSpy project",
            Self::CutOff => "ends before its state does",
            Self::NoSize => "found no size of the image, and no principal point to tell it from",
            Self::NoRotation => "found a quaternion of length 0",
            Self::NotARotation => "found a rotation whose rows are not right-handed unit vectors",
            Self::NotIntrinsics => "found a matrix that is not [fx 0 cx; 0 fy cy; 0 0 1]",
            Self::NotAProjection => "found a matrix of no camera",
            Self::NoCamera => "found no camera",
            Self::ReadOnly => "is read and not written",
            Self::WriteOnly => "is written and not read",
            Self::NothingToExport => "has no calibrated camera to export",
            Self::SeveralPeriods => "several periods have this id; choose one with --at TIME",
            Self::NotAFileName => {
                "its file is looked for by this id, which is no name of a file, or that of another camera; give the \
                 camera an id of letters, digits, \".\", \"-\" and \"_\""
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
            | Self::UnequalFocals(_)
            | Self::Unpaired { .. }
            | Self::NotASite(_) => "",
        }
    }
}

/// A hostile text does not fill the screen.
pub(crate) fn quoted(text: &str) -> String {
    const MOST: usize = 60;
    let short: String = text.chars().take(MOST).collect();
    if short.len() < text.len() { format!("{short:?}...") } else { format!("{short:?}") }
}

/// Largest file that is read, in bytes.
pub const MAX_BYTES: usize = 64 << 20;
/// Most files that are read as one.
pub const MAX_FILES: usize = 20_000;
/// Longest name that a file is given, in characters.
const MAX_NAME: usize = 100;

/// A file in memory; its name may have folders, with `/` between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Relative to the folder of the export.
    pub name: String,
    /// What is in it.
    pub bytes: Vec<u8>,
}

impl File {
    pub(crate) fn text(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self { name: name.into(), bytes: text.into().into_bytes() }
    }

    /// Last part of the name.
    pub(crate) fn base(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or_default()
    }

    /// Last part of the name, without its extension.
    pub(crate) fn stem(&self) -> &str {
        self.base().rsplit_once('.').map_or(self.base(), |(stem, _)| stem)
    }

    /// What follows the last dot, in lower case.
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

/// An id as one component of a path that every system takes.
pub(crate) fn file_name(id: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let name: String = id.chars().take(MAX_NAME).map(plain).collect();
    let dots = name.chars().take_while(|&c| c == '.').count();
    if dots == 0 { name } else { format!("{}{}", "_".repeat(dots), &name[dots..]) }
}
