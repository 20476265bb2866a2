//! Virtual elements: the kind of the next one, and those there are.

use calib_core::{MarkKind, WorldPoint};

use calib_editor::{Action, Part};
use calib_site::Mark;
use egui::{DragValue, RichText, Ui, Vec2};

use crate::icons::{self, Icon, Look};
use crate::panels::{heading, length_field};
use crate::state::App;
use crate::theme;

const fn icon(kind: MarkKind) -> Icon {
    match kind {
        MarkKind::Cross => Icon::Cross,
        MarkKind::Post => Icon::Post,
        MarkKind::Box => Icon::Box,
        MarkKind::Cylinder => Icon::Cylinder,
        MarkKind::Circle => Icon::Circle,
        MarkKind::Person => Icon::Person,
        MarkKind::Grid => Icon::Grid,
    }
}

/// Virtual elements: the kind of the next one, and those there are.
pub fn show(app: &mut App, ui: &mut Ui) {
    heading(ui, "Marks", "M");
    let mut wanted = None;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for kind in MarkKind::ALL {
            let name = format!("{kind:?}").to_lowercase();
            let look = Look {
                chosen: app.editor.session().mark_kind == kind,
                size: Vec2::splat(28.0),
                ..Look::default()
            };
            if icons::button(ui, icon(kind), &format!("Mark kind {name}"), &name, look).clicked() {
                wanted = Some(kind);
            }
        }
    });
    if let Some(kind) = wanted {
        app.send(Action::MarkKind(kind));
    }
    for index in 0..app.editor.session().site.marks.len() {
        mark_row(app, ui, index);
    }
}

fn mark_row(app: &mut App, ui: &mut Ui, index: usize) {
    let palette = theme::palette(ui.ctx());
    let Some(mark) = app.editor.session().site.marks.get(index).cloned() else { return };
    let part = Part::Mark(index);
    let selected = app.editor.session().selection.contains(&part);
    let name = app.editor.session().part_name(part);
    let WorldPoint { x, y, .. } = mark.at_m;
    let units = app.editor.session().units;
    let mut on = !mark.off;
    ui.horizontal(|ui| {
        ui.checkbox(&mut on, "").on_hover_text(format!("Use {name}"));
        icons::inline(ui, icon(mark.kind), palette.text);
        if ui.selectable_label(selected, RichText::new(&name).font(theme::medium(12.0))).clicked() {
            app.send(Action::Select(part));
        }
        let sizes: Vec<String> = mark.size_m.iter().map(|size| units.number(*size, 2)).collect();
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(units.point([x, y], 2));
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                let text = RichText::new(sizes.join(" \u{d7} ")).color(palette.text2);
                ui.add(egui::Label::new(text).truncate());
            });
        });
    });
    if on == mark.off {
        let name = format!("switch {name} {}", if on { "on" } else { "off" });
        app.send(Action::SetMark { index, mark: Box::new(Mark { off: !on, ..mark }), name });
        return;
    }
    if selected {
        mark_fields(app, ui, index, mark);
    }
}

/// Size, turn and height of the mark that is selected.
fn mark_fields(app: &mut App, ui: &mut Ui, index: usize, mut mark: Mark) {
    let palette = theme::palette(ui.ctx());
    let units = app.editor.session().units;
    let mut changed = false;
    let mut field = |ui: &mut Ui, title: &str, edit: DragValue<'_>| {
        let label = ui.label(RichText::new(title).small().color(palette.text2));
        changed |= ui.add(edit).labelled_by(label.id).changed();
    };
    ui.horizontal_wrapped(|ui| {
        for (title, value) in mark.kind.size_names().iter().zip(mark.size_m.iter_mut()) {
            let is_count = ["columns", "rows"].contains(title);
            let edit = if is_count {
                DragValue::new(value).range(1.0..=1e3).max_decimals(0).update_while_editing(false)
            } else {
                length_field(units, value, 1e-3)
            };
            field(ui, title, edit);
        }
        let turn = DragValue::new(&mut mark.turn_deg)
            .speed(0.1)
            .range(-360.0..=360.0)
            .suffix("\u{b0}")
            .max_decimals(3);
        field(ui, "turn", turn.update_while_editing(false));
        field(ui, "above the floor", length_field(units, &mut mark.at_m.z, -1e5));
    });
    let was_fixed = mark.fixed;
    ui.checkbox(&mut mark.fixed, "stays where it is when all cameras are refined");
    if changed || was_fixed != mark.fixed {
        for size in &mut mark.size_m {
            *size = size.clamp(1e-3, 1e4);
        }
        for (title, count) in mark.kind.size_names().iter().zip(&mut mark.size_m) {
            if ["columns", "rows"].contains(title) {
                *count = count.round();
            }
        }
        let name = format!("change {}", app.editor.session().part_name(Part::Mark(index)));
        app.send(Action::SetMark { index, mark: Box::new(mark), name });
    }
}
