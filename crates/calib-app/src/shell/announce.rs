//! Announcements for screen readers: the status line, errors, and the result of the selected camera.

use calib_editor::{camera_status, steps};
use egui::{Rect, Role, Sense, Ui, Vec2, WidgetInfo};

use crate::state::App;
use crate::widgets::announce;

/// Adds an invisible live region with the result of the selected camera. The text appears when the result changes, and
/// disappears after some seconds.
pub(crate) fn result_region(app: &mut App, ui: &Ui) {
    /// Duration for which the text is available, in seconds.
    const DURATION_S: f64 = 5.0;
    let now = ui.input(|input| input.time);
    let camera = app.editor.session().camera;
    if app.editor.tool().is_idle() {
        let result = result_text(app);
        let announced = &mut app.hover.announced;
        let is_other = announced.camera != Some(camera);
        if is_other || announced.result != result {
            // The name of a selected camera is read anyway, so only changes of its result are announced.
            announced.since = if is_other { f64::NEG_INFINITY } else { now };
            (announced.camera, announced.result) = (Some(camera), result);
        }
    } else {
        app.hover.announced.since = f64::NEG_INFINITY;
    }
    let announced = &app.hover.announced;
    let left = DURATION_S - (now - announced.since);
    let rect = Rect::from_min_size(ui.max_rect().left_bottom(), Vec2::ZERO);
    let response = ui.interact(rect, ui.scope_id().with("announced result"), Sense::hover());
    let text = if left > 0.0 { announced.result.as_str() } else { "" };
    response.widget_info(|| WidgetInfo::labeled(Role::Status, true, text));
    announce(&response, false);
    if left > 0.0 {
        ui.ctx().request_repaint_after(std::time::Duration::from_secs_f64(left));
    }
}

/// Returns the result of the selected camera as a sentence.
fn result_text(app: &App) -> String {
    let session = app.editor.session();
    let Some(entry) = session.entry() else { return String::new() };
    let status = camera_status(session, session.camera).text;
    let sigma = steps::floor_sigma(session, session.camera).filter(|rel| *rel < 1.0);
    let sigma = sigma.map_or_else(String::new, |rel| format!(", floor error \u{b1} {:.1} %", 100.0 * rel));
    format!("Result of {}: {status}{sigma}.", entry.id)
}
