//! Result of an export: files, losses and notes.

use calib_core::DistortionModel;
use calib_site::Site;

use crate::file::File;
use crate::view::{ExportOptions, Terms, View};

/// Data of a calibration that a format cannot represent, so that the exported files are misleading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loss {
    /// Id of the camera; absent for the site as a whole.
    pub camera: Option<String>,
    /// Description of the loss, with its size if known.
    pub description: String,
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.camera {
            Some(camera) => write!(f, "camera {camera:?}: {}", self.description),
            None => f.write_str(&self.description),
        }
    }
}

/// Result of an export.
#[derive(Clone, Debug, Default)]
pub struct Export {
    /// Files to write into one folder.
    pub files: Vec<File>,
    /// Differences between files and calibration. The operator must accept them before the files are used.
    pub losses: Vec<Loss>,
    /// Remarks for the operator that need no confirmation.
    pub notes: Vec<String>,
    /// Ids of the cameras that are missing because they are not calibrated.
    pub unsolved: Vec<String>,
}

/// Site and views that the writer of a format receives.
#[derive(Debug)]
pub(crate) struct Scene<'a> {
    pub(crate) site: &'a Site,
    pub(crate) views: Vec<View>,
    pub(crate) options: &'a ExportOptions,
    /// Extension of the files to write, without the dot.
    pub(crate) extension: &'a str,
    /// Lens models that the format represents exactly.
    pub(crate) lenses: &'static [DistortionModel],
}

/// Largest error of a converted lens, in pixels, that is negligible. An export reports a larger error
/// as lost data. An import refuses a lens if terms that it would neglect have a larger effect.
pub(crate) const MAX_NEGLIGIBLE_ERROR_PX: f64 = 0.05;

/// Returns advice for a wide-angle lens whose model the format does not support; `None` for other lenses.
pub(crate) fn wide_lens_advice(view: &View) -> Option<String> {
    let row = view.camera.lens.distortion.model()?.row();
    row.is_wide.then(|| {
        format!(
            "calib undistort --look converts a {} lens to pinhole cameras, which every format supports",
            row.name
        )
    })
}

/// Rounds an error up to this number of decimal places, so that the text never understates it.
pub(crate) fn round_up(error: f64, digits: i32) -> f64 {
    let unit = 10_f64.powi(digits);
    (error * unit).ceil() / unit
}

impl Export {
    pub(crate) fn push(&mut self, name: impl Into<String>, text: impl Into<String>) {
        self.files.push(File::text(name, text));
    }

    pub(crate) fn add_loss(&mut self, view: &View, what: impl Into<String>) {
        self.losses.push(Loss { camera: Some(view.id.clone()), description: what.into() });
    }

    /// Reports a camera that was not placed: a loss if the site has other cameras, otherwise a note.
    pub(crate) fn report_unplaced(&mut self, site: &Site, view: &View) {
        if site.cameras.len() > 1 {
            self.add_loss(view, "its position: it is not placed, and would be at (0, 0)");
        } else {
            self.notes.push(format!("camera {:?} is not placed: it is exported above (0, 0)", view.id));
        }
    }

    /// Reports a stream with another aspect ratio than the camera's image.
    pub(crate) fn report_aspect_ratio(&mut self, view: &View) {
        let ([w, h], [sw, sh]) = (view.size, view.image_size);
        self.add_loss(
            view,
            format!(
                "its aspect ratio: {sw} x {sh} pixels are stretched to {w} x {h}, which is wrong for a stream that \
                 was cropped or has bars"
            ),
        );
    }

    /// Reports the loss of distortion, for formats that contain pinhole cameras only.
    pub(crate) fn report_distortion(&mut self, view: &View) {
        if view.is_distorted() {
            let windows = wide_lens_advice(view).map_or(String::new(), |windows| format!("; {windows}"));
            let what = "the distortion of its lens; --rectified exports the undistorted camera";
            self.add_loss(view, format!("{what}{windows}"));
        }
    }

    /// Returns the lens in Brown-Conrady terms, or in the terms of another model in `lenses`. Reports the
    /// error of an approximation.
    pub(crate) fn terms(&mut self, view: &View, lenses: &[DistortionModel]) -> Terms {
        let terms = view.terms(lenses);
        let Terms::Fitted(brown, off) = terms else { return terms };
        if let Some(windows) = wide_lens_advice(view) {
            self.add_loss(
                view,
                format!("its lens model: k1, k2, k3 cannot represent its wide field of view; {windows}"),
            );
            return Terms::BrownConrady(brown);
        }
        if off.is_finite() && off <= MAX_NEGLIGIBLE_ERROR_PX {
            self.notes.push(format!(
                "camera {:?}: its lens is approximated in the terms of this format, with an error of at most {:.3} px",
                view.id,
                round_up(off, 3)
            ));
            return terms;
        }
        let by = if off.is_finite() {
            format!("up to {:.2} px", round_up(off, 2))
        } else {
            "an unlimited amount".into()
        };
        self.add_loss(view, format!("its lens model: the nearest k1, k2, k3 differ by {by}"));
        Terms::BrownConrady(brown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rounded_error_is_never_understated() {
        for error in [0.0, 1e-9, 0.0494, 0.050_000_1, 0.1234, 7.0, f64::INFINITY] {
            let stated: f64 = format!("{:.3}", round_up(error, 3)).parse().unwrap_or_default();
            assert!(
                stated >= error && (stated - error < 0.001_000_1 || stated == error),
                "{error}: {stated}"
            );
        }
    }
}
