//! Boxes of a table: their columns, their form, and signs that another form is meant.

use std::sync::OnceLock;

use arrow_array::RecordBatch;
use calib_core::floor::BoxForm;

use crate::calibrations::Calibrations;
use crate::columns::{BadCells, RowName, numbers};
use crate::table_error::TableError;
use crate::wording::Wording;

/// Meaning of the four numbers of a box in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum TableBoxForm {
    /// Upper left and lower right corners
    Xyxy,
    /// Upper left corner, width and height
    Xywh,
    /// Centre, width and height
    Cxcywh,
    /// Centre, width and height as fractions of the stream, from 0 to 1
    Yolo,
}

impl TableBoxForm {
    /// Returns the form with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "xyxy" => Some(Self::Xyxy),
            "xywh" => Some(Self::Xywh),
            "cxcywh" => Some(Self::Cxcywh),
            "yolo" => Some(Self::Yolo),
            _ => None,
        }
    }

    const fn numbers(self) -> BoxForm {
        match self {
            Self::Xyxy => BoxForm::Corners,
            Self::Xywh => BoxForm::CornerSize,
            Self::Cxcywh | Self::Yolo => BoxForm::CentreSize,
        }
    }
}

/// Names of the columns of boxes, in upper or lower case, and the form of the box that these names mean.
const LAYOUTS: [([&str; 4], BoxForm); 11] = [
    (["x", "y", "w", "h"], BoxForm::CornerSize),
    (["left", "top", "width", "height"], BoxForm::CornerSize),
    (["x", "y", "width", "height"], BoxForm::CornerSize),
    (["bbox_left", "bbox_top", "bbox_width", "bbox_height"], BoxForm::CornerSize),
    (["bb_left", "bb_top", "bb_width", "bb_height"], BoxForm::CornerSize),
    (["x1", "y1", "x2", "y2"], BoxForm::Corners),
    (["xmin", "ymin", "xmax", "ymax"], BoxForm::Corners),
    (["x_min", "y_min", "x_max", "y_max"], BoxForm::Corners),
    (["left", "top", "right", "bottom"], BoxForm::Corners),
    (["cx", "cy", "w", "h"], BoxForm::CentreSize),
    (["x_center", "y_center", "width", "height"], BoxForm::CentreSize),
];

/// Reader of the boxes of a table.
#[derive(Debug, Default)]
pub struct Boxes {
    /// Form that the user states; by default it follows from the names of the columns.
    form: Option<TableBoxForm>,
    /// Whether the numbers are fractions of the stream. The first batch with boxes determines this.
    is_normalised: OnceLock<bool>,
    /// Note about the columns, if their names are not x, y, w, h.
    columns_note: OnceLock<String>,
    /// Note about fractions of the stream.
    fractions_note: OnceLock<String>,
}

/// Columns of boxes, for messages.
pub(crate) const BOXES: &str = "x,y,w,h or x1,y1,x2,y2";

/// Columns of feet or boxes, for messages.
pub(crate) const FEET_OR_BOXES: &str = "u,v, or x,y,w,h or x1,y1,x2,y2 for boxes";

/// Boxes of a batch, column by column, in pixels or as fractions of the stream.
pub(crate) struct BoxValues {
    pub(crate) form: BoxForm,
    pub(crate) values: [Vec<f64>; 4],
    pub(crate) are_fractions: bool,
}

/// Columns of the boxes in a batch.
pub(crate) struct BoxColumns {
    /// Names of the columns, as in the table.
    pub(crate) names: [String; 4],
    /// Meaning of the numbers.
    pub(crate) form: BoxForm,
    /// Whether the form `xywh` follows only from the names of the columns.
    is_default: bool,
}

impl Boxes {
    /// Creates a reader of boxes of a stated form, or of the form that the names of the columns mean.
    #[must_use]
    pub const fn new(form: Option<TableBoxForm>) -> Self {
        Self {
            form,
            is_normalised: OnceLock::new(),
            columns_note: OnceLock::new(),
            fractions_note: OnceLock::new(),
        }
    }

    /// Whether the user stated the form of the boxes. If so, the table must contain boxes.
    pub(crate) const fn is_stated(&self) -> bool {
        self.form.is_some()
    }

    /// Returns notes about columns with other names than x, y, w, h, and about fractions of the stream.
    pub fn notes(&self) -> impl Iterator<Item = &str> {
        [&self.columns_note, &self.fractions_note].into_iter().filter_map(OnceLock::get).map(String::as_str)
    }

    /// Finds the columns of boxes. Columns with the stated form are preferred. Columns named x, y, w, h or
    /// similarly can have any stated form; other names do not fit another form.
    pub(crate) fn columns(&self, batch: &RecordBatch) -> Option<BoxColumns> {
        let schema = batch.schema();
        let actual = |name: &str| {
            schema
                .fields()
                .iter()
                .map(|field| field.name())
                .find(|own| own.eq_ignore_ascii_case(name))
                .cloned()
        };
        let found = |(names, form): ([&str; 4], BoxForm)| {
            let [a, b, c, d] = names.map(actual);
            Some(([a?, b?, c?, d?], form))
        };
        let stated = self.form.map(TableBoxForm::numbers);
        let of_form = LAYOUTS.into_iter().filter(|(_, form)| stated.is_none_or(|stated| *form == stated));
        let usual = LAYOUTS.into_iter().filter(|(_, form)| *form == BoxForm::CornerSize);
        let (names, form) = of_form.chain(usual).find_map(found)?;
        let form = stated.unwrap_or(form);
        let is_plain = names.iter().map(String::as_str).eq(LAYOUTS[0].0);
        if !is_plain {
            let meaning = match form {
                BoxForm::CornerSize => "upper left corner, width and height",
                BoxForm::Corners => "upper left and lower right corners",
                BoxForm::CentreSize | BoxForm::Fractions => "centre, width and height",
            };
            let _ = self
                .columns_note
                .set(format!("boxes are read from the columns {}: {meaning}", names.join(",")));
        }
        Some(BoxColumns { names, form, is_default: stated.is_none() && form == BoxForm::CornerSize })
    }

    /// Reads the boxes in these columns.
    ///
    /// # Errors
    ///
    /// Fails if a cell is invalid, or if the numbers show that another form is meant.
    pub(crate) fn read(
        &self,
        batch: &RecordBatch,
        columns: &BoxColumns,
        calibrations: &Calibrations,
        (row_name, bad): (RowName<'_>, &BadCells),
    ) -> Result<BoxValues, TableError> {
        let names = columns.names.each_ref().map(String::as_str);
        let values = numbers(batch, names, BOXES, row_name, bad)?;
        let are_fractions = self.are_normalised(columns, &values, calibrations, bad.wording())?;
        Ok(BoxValues { form: columns.form, values, are_fractions })
    }

    /// Decides whether the numbers of the boxes are fractions of the stream, from the first batch with boxes.
    ///
    /// # Errors
    ///
    /// Fails if the numbers show that another form is meant, or if fractions lack a stated form or a stream size.
    fn are_normalised(
        &self,
        columns: &BoxColumns,
        values: &[Vec<f64>; 4],
        calibrations: &Calibrations,
        wording: Wording,
    ) -> Result<bool, TableError> {
        if self.form == Some(TableBoxForm::Yolo) {
            return Ok(true);
        }
        if let Some(&decided) = self.is_normalised.get() {
            return Ok(decided);
        }
        let [a, b, c, d] = values;
        let rows: Vec<[f64; 4]> = (0..a.len())
            .map(|row| [a[row], b[row], c[row], d[row]])
            .filter(|numbers| numbers.iter().all(|number| number.is_finite()))
            // Some detectors write boxes of zeros if they detect no object.
            .filter(|numbers| numbers.iter().any(|number| *number != 0.0))
            .collect();
        if rows.is_empty() {
            return Ok(false);
        }
        // Boxes can end slightly outside the image.
        let is_fraction = |numbers: &[f64; 4]| numbers.iter().all(|number| (-0.1..=1.1).contains(number));
        let are_fractions = rows.iter().all(is_fraction);
        if are_fractions && !(self.is_stated() && calibrations.has_stream_size()) {
            return Err(normalised_error(wording));
        }
        if columns.is_default && !are_fractions {
            check_corners(&rows, calibrations.largest_stream(), columns, wording)?;
        }
        if are_fractions {
            let size = wording.name("stream-size");
            let _ = self.fractions_note.set(format!("the boxes are read as fractions of the size in {size}"));
        }
        Ok(*self.is_normalised.get_or_init(|| are_fractions))
    }
}

fn normalised_error(wording: Wording) -> TableError {
    TableError::Invalid(format!(
        "all numbers of the boxes are between 0 and 1, so they are fractions of the image: add {} for centre, \
         width and height, or {} (or {}) with {}",
        wording.with("box-form", "yolo"),
        wording.with("box-form", "xywh"),
        wording.with("box-form", "xyxy"),
        wording.name("stream-size"),
    ))
}

/// Refuses boxes if some end outside the image when read as corner and size, but all fit when read as two corners.
fn check_corners(
    rows: &[[f64; 4]],
    [width, height]: [f64; 2],
    columns: &BoxColumns,
    wording: Wording,
) -> Result<(), TableError> {
    /// Largest accepted excess of a box beyond the border of the image, relative to the size of the image.
    const MARGIN: f64 = 0.02;
    let [right, bottom] = [width, height].map(|side| (1.0 + MARGIN) * side);
    let ends_outside = |&&[x, y, w, h]: &&[f64; 4]| x + w > right || y + h > bottom;
    let are_corners = |&[x, y, w, h]: &[f64; 4]| w > x && h > y && w <= right && h <= bottom;
    let outside = rows.iter().filter(ends_outside).count();
    if outside == 0 || !rows.iter().all(are_corners) {
        return Ok(());
    }
    let names = columns.names.join(",");
    Err(TableError::Invalid(format!(
        "with {names} as corner, width and height, {outside} of {} boxes would end outside the image; as two corners, \
         all fit: add {} for two corners, or {} for corner, width and height",
        rows.len(),
        wording.with("box-form", "xyxy"),
        wording.with("box-form", "xywh"),
    )))
}
