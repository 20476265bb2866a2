//! What the still proposes: whether to believe it, and a row a group to accept, flip or delete.

use calib_core::Kind;
use calib_editor::{Action, Hypothesis, OnProposed, Proposed, ProposedGroup, TOOLS};
use calib_image::{Lies, Verdict};
use egui::{Color32, ComboBox, RichText, Ui, WidgetInfo};

use crate::command::Command;
use crate::icons::{self, Icon};
use crate::state::App;
use crate::theme;
use crate::widgets::{heading, section};

/// The panel, while something is proposed.
pub fn propose_ui(app: &mut App, ui: &mut Ui) {
    app.editor.find_preview();
    app.hover.lit_group = None;
    let Some(proposed) = app.shown_proposal().cloned() else { return };
    let mut wish = None;
    section(ui, |ui| {
        let lines = proposed.count();
        heading(ui, "Proposed", &format!("{lines} {}", if lines == 1 { "line" } else { "lines" }));
        judgement(app, ui, &proposed);
        hypotheses(app, ui, &proposed, &mut wish);
        whole(app, ui, &proposed);
        let next = app.editor.preview().and_then(|preview| preview.next);
        let picked = app.editor.session().picked().map(|(group, _)| group);
        for (index, group) in proposed.groups.iter().enumerate() {
            let row = Row {
                index,
                group,
                directions: &proposed.directions(),
                is_next: next == Some(index) && proposed.groups.len() > 1,
                is_picked: picked == Some(index),
            };
            if row.show(ui, &mut wish) {
                app.hover.lit_group = Some(index);
            }
        }
    });
    if let Some(wish) = wish {
        app.send(Action::OnProposed(wish));
    }
}

/// Whether to believe it, and why not.
fn judgement(app: &App, ui: &mut Ui, proposed: &Proposed) {
    let palette = theme::palette(ui.ctx());
    let solution = app.editor.preview().and_then(|preview| preview.solution.as_ref());
    let focal = solution.map(|solution| {
        let sigma = solution.sigma.as_ref().and_then(|sigma| sigma.focal_px);
        let sure = sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {sigma:.0}"));
        format!("focal {:.0}{sure} px", solution.focal_px)
    });
    let (fill, colour, icon, words) = match proposed.verdict {
        Verdict::Sure => (palette.raised, palette.ok, Icon::Check, "Sure"),
        Verdict::Check => (palette.warn_bg, palette.warn, Icon::Warn, "Likely, have a look"),
        Verdict::None if proposed.alternative.is_some() => {
            (palette.warn_bg, palette.warn, Icon::Warn, "One of two cameras")
        }
        Verdict::None => (palette.bad_bg, palette.bad, Icon::Warn, "No proposal for the camera"),
    };
    let words = match focal.filter(|_| proposed.verdict != Verdict::None) {
        Some(focal) => format!("{words}: {focal}"),
        None => words.to_owned(),
    };
    egui::Frame::NONE.fill(fill).corner_radius(4).inner_margin(8).show(ui, |ui| {
        ui.set_width(ui.available_width());
        ui.horizontal_top(|ui| {
            icons::inline(ui, icon, colour);
            ui.vertical(|ui| {
                ui.label(RichText::new(words).font(theme::medium(12.0)));
                for reason in &proposed.reasons {
                    ui.label(RichText::new(sentence(&reason.to_string())).color(palette.text2));
                }
            });
        });
    });
    ui.add_space(4.0);
}

/// Where two cameras explain the edges alike: which it is, whoever looks at the image sees at once.
fn hypotheses(app: &App, ui: &mut Ui, proposed: &Proposed, wish: &mut Option<OnProposed>) {
    let entry = app.editor.session().entry();
    let (Some(own), Some(other), Some(entry)) = (&proposed.orientation, &proposed.alternative, entry) else {
        return;
    };
    ui.label("Which camera is it?");
    ui.horizontal_wrapped(|ui| {
        for (orientation, other) in [(own, false), (&other.orientation, true)] {
            let words = Hypothesis::words(orientation, entry.size()[0]);
            let tip = format!("It is so: focal {:.0} px, and the groups of this camera", orientation.focal);
            if ui.button(words).on_hover_text(tip).clicked() {
                *wish = Some(OnProposed::Decide { other });
            }
        }
    });
    ui.add_space(4.0);
}

/// With a capital letter and a full stop.
fn sentence(words: &str) -> String {
    let mut letters = words.chars();
    let first = letters.next().map(|first| first.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

/// One group.
struct Row<'a> {
    index: usize,
    group: &'a ProposedGroup,
    directions: &'a [String],
    is_next: bool,
    is_picked: bool,
}

impl Row<'_> {
    /// Shows it; whether the cursor is on it.
    fn show(&self, ui: &mut Ui, wish: &mut Option<OnProposed>) -> bool {
        let palette = theme::palette(ui.ctx());
        let fill = if self.is_picked { palette.accent_bg } else { Color32::TRANSPARENT };
        let frame = egui::Frame::NONE.fill(fill).corner_radius(4).inner_margin(egui::Margin::symmetric(4, 3));
        let shown = frame.show(ui, |ui| {
            ui.set_width(ui.available_width());
            self.title(ui);
            ui.horizontal_wrapped(|ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                self.buttons(ui, wish);
            });
        });
        ui.rect_contains_pointer(shown.response.rect)
    }

    fn title(&self, ui: &mut Ui) {
        let palette = theme::palette(ui.ctx());
        let tool = TOOLS.iter().find(|tool| tool.kind == Some(self.group.kind));
        let icon = tool.map_or(Icon::Vertical, |tool| tool.icon.into());
        let is_narrow = ui.available_width() < 220.0;
        ui.horizontal(|ui| {
            icons::inline(ui, icon, theme::kind_icon(self.group.kind, ui.visuals().dark_mode));
            let name = RichText::new(capital(self.group.title())).font(theme::medium(12.0));
            ui.label(name);
            if self.is_next {
                ui.label(RichText::new("tells most").small().color(palette.accent))
                    .on_hover_text("Of the groups, the floor is known best with this one");
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let count = self.group.lines.len();
                // In a narrow panel the number speaks for itself.
                let noun = match (is_narrow, count) {
                    (true, _) => "",
                    (false, 1) => " line",
                    (false, _) => " lines",
                };
                let label = ui.label(RichText::new(format!("{count}{noun}")).color(palette.text2));
                if self.group.kind != Kind::Straight {
                    let share = 100.0 * self.group.probability();
                    let lying = |so: Lies, words: &str| match self.group.lying(so) {
                        0 => String::new(),
                        count => format!("; {count} {words}"),
                    };
                    label.on_hover_text(format!(
                        "They belong together with a probability of {share:.0} %{}{}",
                        lying(Lies::Floor, "on the floor, as far as edges tell"),
                        lying(Lies::Above, "above it")
                    ));
                }
            });
        });
    }

    fn buttons(&self, ui: &mut Ui, wish: &mut Option<OnProposed>) {
        let title = self.group.title();
        let mut button = |ui: &mut Ui, word: &str, tip: &str, action: OnProposed| {
            let response = ui.small_button(word);
            let name = format!("{word} {title}");
            response.widget_info(|| WidgetInfo::labeled(egui::Role::Button, true, &name));
            if response.on_hover_text(tip).clicked() {
                *wish = Some(action);
            }
        };
        button(ui, "Accept", "Draw these lines", OnProposed::Accept(self.index));
        match self.group.kind {
            Kind::Vertical => button(ui, "Flip", "They lie flat: floor lines", OnProposed::Flip(self.index)),
            Kind::Parallel => {
                button(ui, "Flip", "They stand upright: verticals", OnProposed::Flip(self.index));
            }
            _ => {}
        }
        button(ui, "Delete", "Leave these lines out", OnProposed::Delete(self.index));
        // What is chosen can be told more of; in every row it would be noise.
        if self.group.kind == Kind::Parallel && self.is_picked {
            self.direction(ui, wish);
        }
    }

    /// Another floor direction.
    fn direction(&self, ui: &mut Ui, wish: &mut Option<OnProposed>) {
        let mut chosen = self.group.direction.clone();
        let salt = ui.scope_id().with(("direction", self.index));
        let menu = ComboBox::from_id_salt(salt).width(64.0).selected_text(self.group.direction.as_str());
        let response = menu.show_ui(ui, |ui| {
            for direction in self.directions {
                ui.selectable_value(&mut chosen, direction.clone(), direction);
            }
        });
        response.response.on_hover_text("The floor direction that they lead in");
        if chosen != self.group.direction {
            *wish = Some(OnProposed::Turn(self.index, chosen));
        }
    }
}

fn capital(words: &str) -> String {
    sentence(words).trim_end_matches('.').to_owned()
}

/// All of it at once.
fn whole(app: &mut App, ui: &mut Ui, proposed: &Proposed) {
    ui.horizontal_wrapped(|ui| {
        let is_offered = proposed.verdict != Verdict::None && !proposed.groups.is_empty();
        if is_offered && ui.button("Accept all   Enter").clicked() {
            app.tell(Command::AcceptProposed);
        }
        if ui.button("Dismiss   Esc").clicked() {
            app.tell(Command::DismissProposed);
        }
    });
}
