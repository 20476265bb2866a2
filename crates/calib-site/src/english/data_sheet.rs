//! Messages about the text of a data sheet.

use std::fmt;

use crate::data_sheet::DataSheetError;

/// Messages for the operator.
impl fmt::Display for DataSheetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const EXAMPLES: &str = "Enter, for example, 2.8 mm 1/2.7, or horizontal 98\u{b0}.";
        match self {
            Self::NoSensor => {
                f.write_str("Add the size of the sensor to the focal length, for example 2.8 mm 1/2.7.")
            }
            Self::NoFocalLength => {
                f.write_str("Add the focal length to the size of the sensor, for example 2.8 mm 1/2.7.")
            }
            Self::Repeated(what) => write!(f, "The text contains two values for the {what}. Remove one."),
            Self::FieldOutOfRange => f.write_str("Enter a field of view from 0.1\u{b0} to 179\u{b0}."),
            Self::UnknownFormat(format) => {
                write!(f, "No sensor has the format {format}. Usual formats are 1/2.8 and 1/3.")
            }
            Self::UnknownWord(word) => write!(f, "\"{word}\" is not understood. {EXAMPLES}"),
            Self::MissingNumber => write!(f, "A number is missing at the end. {EXAMPLES}"),
        }
    }
}
