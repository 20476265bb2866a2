//! A name for everything that can be held, for screen readers, the Tab key and tests.

use calib_editor::{Action, Part, PlanHandle, hit, plan_handles};
use egui::{EventFilter, Rect, Role, Sense, Ui, Vec2, WidgetInfo};

use crate::canvas::Mapping;
use crate::state::App;
use crate::theme;

/// A name for every handle, for screen readers, the Tab key and tests.
pub(crate) fn on_image(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping) {
    let list = hit::handles(&app.editor.session().site, camera);
    let mut chosen = None;
    for (part, pixel) in list {
        let at = mapping.screen(pixel.into());
        if !mapping.rect.contains(at) {
            continue;
        }
        let rect = Rect::from_center_size(at, Vec2::splat(2.0 * theme::HIT));
        let id = ui.scope_id().with(("handle", camera, part));
        let response = ui.interact(rect, id, Sense::focusable_noninteractive());
        let name = handle_name(app, part);
        let selected = app.editor.session().selection.contains(&part);
        response.widget_info(|| WidgetInfo::selected(Role::Button, true, selected, &name));
        if response.has_focus() {
            let arrows =
                EventFilter { horizontal_arrows: true, vertical_arrows: true, ..EventFilter::default() };
            ui.memory_mut(|memory| memory.set_focus_lock_filter(id, arrows));
        }
        if response.gained_focus() {
            chosen = Some(part);
        }
    }
    if let Some(part) = chosen {
        app.act(Action::SelectOn(camera, part));
    }
}

fn handle_name(app: &App, part: Part) -> String {
    let name = app.editor.session().part_name(part);
    match part {
        Part::Vertex { vertex, .. } => format!("{name} point {}", vertex + 1),
        Part::Link { point, .. } if point > 0 => format!("{name} point {}", point + 1),
        _ => name,
    }
}

/// The handles of the camera in hand on the plan.
pub(crate) fn on_plan(app: &App, ui: &Ui, mapping: &Mapping) {
    let Some(entry) = app.editor.session().entry() else { return };
    for (handle, at) in plan_handles(app.editor.session(), app.editor.session().camera) {
        let at = mapping.screen(at);
        if !mapping.rect.contains(at) {
            continue;
        }
        let rect = Rect::from_center_size(at, Vec2::splat(2.0 * theme::HIT));
        let id = ui.scope_id().with(("plan handle", handle));
        let response = ui.interact(rect, id, Sense::focusable_noninteractive());
        let name = match handle {
            PlanHandle::Corner(corner) => {
                format!("corner {} of {} on the plan", corner + 1, entry.id)
            }
            other => format!("{} {} on the plan", other.verb(), entry.id),
        };
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &name));
    }
}
