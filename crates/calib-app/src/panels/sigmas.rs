//! How sure one drawing is, where it is not as sure as any other: its clicks, its angle, its lengths.

use calib_core::{Annotation, SceneErrors};

use calib_core::single::ConstraintKind;
use egui::{DragValue, RichText, Ui};

use crate::theme;

/// What is usual where a drawing says nothing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Usual {
    /// Of a click, in pixels.
    pub(crate) click: f64,
    pub(crate) scene: SceneErrors,
}

/// Fields for the sigmas of a drawing in the hand; the drawing as it was changed.
pub(crate) fn fields(ui: &mut Ui, drawn: &Annotation, usual: Usual) -> Option<Annotation> {
    let mut annotation = drawn.clone();
    let constraint = drawn.kind.row().constraint;
    let has_angle = matches!(constraint, ConstraintKind::Parallel | ConstraintKind::RightAngle);
    let has_scene = has_angle || constraint == ConstraintKind::Length;
    ui.horizontal_wrapped(|ui| {
        ui.add_space(24.0);
        let click = Field { tip: "One sigma of a click", unit: " px", usual: usual.click, scale: 1.0 };
        click.show(ui, &mut annotation.sigma_px);
        if has_angle && !annotation.exact {
            let angle = usual.scene.angle.to_degrees();
            let tip = "One sigma of its angle; it is off level by a quarter of that";
            Field { tip, unit: "\u{b0}", usual: angle, scale: 1.0 }.show(ui, &mut annotation.angle_sigma_deg);
        }
        if constraint == ConstraintKind::Length && !annotation.exact {
            let tip = "One sigma of its length";
            let length = Field { tip, unit: " %", usual: 100.0 * usual.scene.length, scale: 100.0 };
            length.show(ui, &mut annotation.length_sigma_rel);
        }
        if has_scene {
            let says =
                "The scene is what this drawing says: measured to be square, level, and of these lengths";
            ui.checkbox(&mut annotation.exact, "Exact").on_hover_text(says);
        }
        let own = Annotation {
            sigma_px: None,
            angle_sigma_deg: None,
            length_sigma_rel: None,
            exact: false,
            ..annotation.clone()
        };
        if own != annotation && ui.small_button("As usual").clicked() {
            annotation = own;
        }
    });
    (annotation != *drawn).then_some(annotation)
}

/// A sigma that may be a drawing's own.
struct Field {
    tip: &'static str,
    unit: &'static str,
    /// As it is shown.
    usual: f64,
    /// What is shown over what the file has.
    scale: f64,
}

impl Field {
    fn show(&self, ui: &mut Ui, own: &mut Option<f64>) {
        let palette = theme::palette(ui.ctx());
        let mut shown = own.map_or(self.usual, |own| own * self.scale);
        let colour = if own.is_some() { palette.text } else { palette.text3 };
        let label = ui.label(RichText::new("\u{b1}").color(colour));
        let field =
            DragValue::new(&mut shown).range(0.01..=100.0).speed(0.02).max_decimals(2).suffix(self.unit);
        if ui.add(field).labelled_by(label.id).on_hover_text(self.tip).changed() {
            *own = Some(shown / self.scale);
        }
    }
}
