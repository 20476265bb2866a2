//! The tools, each with its key.

use calib_editor::{Action, TOOLS};
use egui::{Align2, Ui, Vec2};

use crate::icons::{self, Look};
use crate::state::App;
use crate::theme;

/// Behind which tools a gap stands.
const GAPS: [&str; 3] = ["Select", "Upright", "Mark"];

/// The strip of tools.
pub fn show(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let dark = ui.visuals().dark_mode;
    ui.add_space(6.0);
    // The buttons share the height that there is.
    let height = ((ui.available_height() - 24.0) / TOOLS.len() as f32).clamp(22.0, 34.0);
    let mut chosen = None;
    ui.vertical_centered(|ui| {
        ui.spacing_mut().item_spacing.y = 1.0;
        for (index, row) in TOOLS.iter().enumerate() {
            let colour = row.kind.map(|kind| theme::kind_icon(kind, dark));
            let look = Look {
                size: Vec2::new(36.0, height),
                chosen: index == app.editor.tool_row(),
                colour,
                ..Look::default()
            };
            let label = format!("{} tool", row.title);
            let tip = format!("{}  ({})", row.title, row.key.name());
            let response = icons::button(ui, row.icon.into(), &label, &tip, look);
            let corner = response.rect.right_bottom() - Vec2::new(2.0, 1.0);
            let key = row.key.name();
            ui.painter().text(corner, Align2::RIGHT_BOTTOM, key, theme::regular(10.0), palette.text3);
            if response.clicked() {
                chosen = Some(index);
            }
            if GAPS.contains(&row.title) {
                ui.add_space(4.0);
            }
        }
    });
    if let Some(index) = chosen {
        app.send(Action::TakeTool(index));
    }
}
