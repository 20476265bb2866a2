//! Appearance of every meaning: colour, width and dash.

use crate::colour::Rgb;
use crate::item::{AnnotatedLine, ElementStatus, Meaning};
use crate::kind::KindLook;

/// Outline under a line, for contrast with any background.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outline {
    /// Dark outline.
    Dark,
    /// Faint dark outline, which reports omit.
    Faint,
    /// No outline.
    None,
}

/// Appearance of a line or point. Lengths are in screen points; painters scale them for large images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Colour of the line.
    pub colour: Rgb,
    /// Width of the line, in screen points.
    pub width: f64,
    /// Lengths of dashes and gaps, in screen points; empty for a solid line.
    pub dash: &'static [f64],
    /// Opacity, from 0 (invisible) to 1.
    pub opacity: f64,
    /// Outline under the line.
    pub outline: Outline,
}

/// Width of annotated lines, in screen points.
pub const LINE_WIDTH: f64 = 2.0;
/// Dash and gap of suggestions and of annotations that are switched off, in screen points.
const DASH_UNUSED_LINE: &[f64] = &[3.0, 6.0];
/// Dash and gap of the outline of an EFOV, in screen points.
const DASH_EFOV: &[f64] = &[10.0, 5.0];
/// Dash and gap of the outline of a plane region, in screen points.
const DASH_PLANE_REGION: &[f64] = &[2.0, 4.0];

impl Look {
    const fn new(colour: Rgb, width: f64) -> Self {
        Self { colour, width, dash: &[], opacity: 1.0, outline: Outline::Dark }
    }

    const fn dashed(self, dash: &'static [f64]) -> Self {
        Self { dash, ..self }
    }

    const fn with_opacity(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    const fn with_outline(self, outline: Outline) -> Self {
        Self { outline, ..self }
    }

    /// Returns the appearance of items with this meaning on images and on a dark plan.
    #[must_use]
    pub fn of(meaning: Meaning) -> Self {
        const WHITE: Rgb = Rgb::WHITE;
        match meaning {
            Meaning::LensGrid => Self::new(Rgb::LENS, 1.0).with_opacity(0.45),
            Meaning::Grid => Self::new(WHITE, 1.0).with_opacity(0.42).with_outline(Outline::Faint),
            Meaning::Horizon => Self::new(WHITE, 1.5).dashed(&[14.0, 5.0, 3.0, 5.0]),
            Meaning::Efov(camera) => Self::new(Rgb::camera(camera), LINE_WIDTH).dashed(DASH_EFOV),
            Meaning::OtherEfov(camera) => {
                Self::new(Rgb::camera(camera), 1.25).dashed(&[5.0, 5.0]).with_outline(Outline::Faint)
            }
            Meaning::Prism(camera) => Self::new(Rgb::camera(camera), 1.25),
            Meaning::Guide => Self::new(WHITE, 1.25).with_opacity(0.78),
            Meaning::Plane(_) => {
                Self::new(WHITE, 1.5).dashed(DASH_PLANE_REGION).with_opacity(0.6).with_outline(Outline::Faint)
            }
            Meaning::Mark(_) => Self::new(WHITE, LINE_WIDTH),
            Meaning::Annotation(line) => line_look(&line),
            Meaning::Extension(kind) => {
                Self::new(KindLook::of(kind).colour, 1.25).dashed(&[2.0, 5.0]).with_outline(Outline::None)
            }
            Meaning::Suggestion(kind) => Self::new(KindLook::of(kind).colour, 2.25).dashed(DASH_UNUSED_LINE),
            Meaning::ControlPoint { is_off: true, .. } => Self::new(Rgb::hex(0x808080), LINE_WIDTH),
            Meaning::ControlPoint { .. } => Self::new(WHITE, LINE_WIDTH),
            Meaning::MarkObservation(_) => Self::new(Rgb::ACCENT, LINE_WIDTH),
            Meaning::Residual { .. } => Self::new(Rgb::BAD, LINE_WIDTH),
            Meaning::Link { is_incomplete: waits, .. } => {
                Self::new(if waits { Rgb::INCOMPLETE } else { WHITE }, LINE_WIDTH)
            }
            Meaning::LinkPosition { camera, .. } => {
                Self::new(camera.map_or(Rgb::INCOMPLETE, Rgb::camera), 1.25)
            }
            Meaning::Epipolar => Self::new(Rgb::INCOMPLETE, 1.75).dashed(&[5.0, 4.0]),
            Meaning::Observed(of) | Meaning::Solved(of) => {
                Self::new(if of.is_rejected { Rgb::BAD } else { WHITE }, 1.25).with_opacity(if of.is_off {
                    0.5
                } else {
                    1.0
                })
            }
            Meaning::PositionEllipse(camera) => {
                Self::new(Rgb::camera(camera), 1.25).with_outline(Outline::None)
            }
            Meaning::Camera(camera) => Self::new(Rgb::camera(camera), 1.5).with_outline(Outline::None),
        }
    }

    /// Returns the appearance of items with this meaning on a light plan: dark lines without outline.
    #[must_use]
    pub fn on_light(meaning: Meaning) -> Self {
        let look = match meaning {
            Meaning::Grid => Self::new(Rgb::INK, 1.0).with_opacity(0.14),
            Meaning::Efov(camera) => Self::new(Rgb::camera_on_light(camera), LINE_WIDTH),
            Meaning::PositionEllipse(camera) => {
                Self::new(Rgb::camera_on_light(camera), 1.25).dashed(&[4.0, 3.0])
            }
            Meaning::Plane(_) => Self::new(Rgb::INK, 1.5).dashed(DASH_PLANE_REGION).with_opacity(0.7),
            Meaning::Mark(_) => Self::new(Rgb::INK, 1.5).with_opacity(0.8),
            Meaning::Camera(_) => Self::new(Rgb::INK, 1.25),
            Meaning::Observed(of) | Meaning::Solved(of) if of.is_rejected => {
                let look = Self::new(Rgb::BAD_ON_LIGHT, 1.25);
                if of.camera.is_some() { look.dashed(&[4.0, 3.0]) } else { look }
            }
            Meaning::Observed(ElementStatus { camera: Some(camera), .. }) => {
                Self::new(Rgb::camera_on_light(camera), 1.5)
            }
            Meaning::Observed(_) | Meaning::Solved(_) => Self::new(Rgb::INK, 1.25),
            other => Self::of(other),
        };
        look.with_outline(Outline::None)
    }
}

impl AnnotatedLine {
    /// Returns the colour of the line's points and name. An outlier has the outlier colour even if the line
    /// is switched off.
    #[must_use]
    pub fn colour(&self) -> Rgb {
        if self.is_outlier { Rgb::BAD } else { KindLook::of(self.kind).colour }
    }
}

/// Returns the appearance of an annotated line: of its kind, as switched off, or as an outlier.
fn line_look(line: &AnnotatedLine) -> Look {
    let kind = KindLook::of(line.kind);
    match (line.is_off, line.is_outlier) {
        (true, _) => Look::new(kind.colour, LINE_WIDTH)
            .dashed(DASH_UNUSED_LINE)
            .with_opacity(0.5)
            .with_outline(Outline::Faint),
        (false, true) => Look::new(Rgb::BAD, LINE_WIDTH + 1.0).dashed(&[6.0, 4.0]),
        (false, false) => Look::new(kind.colour, LINE_WIDTH).dashed(kind.dash),
    }
}

#[cfg(test)]
mod tests {
    use calib_core::single::KINDS;

    use super::*;

    fn line(kind: calib_core::Kind) -> AnnotatedLine {
        AnnotatedLine {
            kind,
            annotation: 0,
            segment: 0,
            is_off: false,
            is_outlier: false,
            residual_px: None,
            over_sigma: None,
        }
    }

    #[test]
    fn disabled_and_rejected_lines_of_every_kind_look_different() {
        for row in &KINDS {
            let used = line_look(&line(row.kind));
            let off = line_look(&AnnotatedLine { is_off: true, ..line(row.kind) });
            let aside = line_look(&AnnotatedLine { is_outlier: true, ..line(row.kind) });
            assert!(used.opacity == 1.0 && used.dash != off.dash && used.dash != aside.dash);
            assert!(off.opacity < 1.0 && off.colour == used.colour);
            assert!(aside.colour == Rgb::BAD, "{}", row.name);
            let both = AnnotatedLine { is_off: true, is_outlier: true, ..line(row.kind) };
            assert_eq!((line_look(&both), both.colour()), (off, Rgb::BAD));
        }
    }

    #[test]
    fn items_on_a_light_plan_are_dark() {
        let luminance = |Rgb([r, g, b]): Rgb| 0.3 * f64::from(r) + 0.6 * f64::from(g) + 0.1 * f64::from(b);
        let seen = ElementStatus { camera: Some(2), is_rejected: false, is_off: false };
        for camera in 0..8 {
            for meaning in [
                Meaning::Grid,
                Meaning::Efov(camera),
                Meaning::PositionEllipse(camera),
                Meaning::Plane(camera),
                Meaning::Mark(camera),
                Meaning::Camera(camera),
                Meaning::Observed(ElementStatus { camera: Some(camera), ..seen }),
                Meaning::Solved(ElementStatus { camera: None, is_rejected: true, ..seen }),
            ] {
                let look = Look::on_light(meaning);
                assert!(luminance(look.colour) < 140.0, "{meaning:?}");
                assert_eq!(look.outline, Outline::None);
            }
        }
    }
}
