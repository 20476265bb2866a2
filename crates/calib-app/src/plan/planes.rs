//! Panel with the planes other than the floor, their parameters and regions. Also the plane of the selected
//! annotations.

use calib_core::single::Known;
use calib_editor::planes::{PlaneAction, planes_of_parts};
use calib_editor::{Action, TOOLS, Units};
use calib_site::{PlaneEntry, PlaneNumber, TiltEntry};
use egui::{ComboBox, DragValue, RichText, Ui, Vec2};

use crate::icons::{self, Icon, Look};
use crate::state::App;
use crate::theme;
use crate::widgets::{entered_text, heading, length_field, number};

/// Shows the panel of planes.
pub(crate) fn planes_ui(app: &mut App, ui: &mut Ui) {
    heading(ui, "Planes", "other than the floor");
    for index in 0..app.editor.site().planes.len() {
        row(app, ui, index);
    }
    if ui
        .button("Add a plane")
        .on_hover_text("For example, a ramp, a platform or another carriageway")
        .clicked()
    {
        app.send(Action::Planes(PlaneAction::Add));
    }
}

fn row(app: &mut App, ui: &mut Ui, index: usize) {
    let palette = theme::palette(ui.ctx());
    let Some(plane) = app.editor.site().planes.get(index).cloned() else { return };
    let is_chosen = app.editor.session().tool.plane == Some(index);
    let mut asked = None;
    ui.horizontal(|ui| {
        let title = RichText::new(&plane.id).font(theme::medium(12.0));
        if ui.selectable_label(is_chosen, title).on_hover_text(format!("Edit plane {}", plane.id)).clicked() {
            asked = Some(PlaneAction::Choose((!is_chosen).then_some(index)));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let look = Look { size: Vec2::splat(18.0), ..Look::default() };
            let remove = format!("Remove plane {}", plane.id);
            let tip = "Remove the plane; its annotations return to the floor";
            if icons::button(ui, Icon::Close, &remove, tip, look).clicked() {
                asked = Some(PlaneAction::Delete(index));
            }
            let text = RichText::new(summary(app, &plane)).color(palette.text2);
            ui.add(egui::Label::new(text).truncate());
        });
    });
    if is_chosen {
        asked = asked.or_else(|| fields(app, ui, index, &plane));
    }
    asked.into_iter().for_each(|planes| app.send(Action::Planes(planes)));
}

/// Returns height and slope of a plane as text, as solved or as entered.
fn summary(app: &App, plane: &PlaneEntry) -> String {
    let (session, units) = (app.editor.session(), app.editor.session().site.units);
    let now = session.solved.plane(&session.site, Some(&plane.id));
    let is_known = plane.height_m.is_some() || now != session.site.plane_or_floor(Some(&plane.id));
    let height = if is_known { units.length(now.height, 2) } else { "height unknown".into() };
    if now.fall() == 0.0 {
        height
    } else {
        format!("{height}, slope {}\u{b0}", number(now.fall().to_degrees(), 1))
    }
}

/// Shows the fields for the parameters of the current plane; returns the requested change.
fn fields(app: &mut App, ui: &mut Ui, index: usize, plane: &PlaneEntry) -> Option<PlaneAction> {
    let renamed = name_field(ui, index, &plane.id).map(|id| PlaneAction::Rename(index, id));
    let (mut new, units) = (plane.clone(), app.editor.session().site.units);
    let mut changed = known_number(ui, units, Quantity::Height, &mut new.height_m).then_some("height");
    let mut falls = new.tilt.is_some();
    if ui
        .checkbox(&mut falls, "Sloping")
        .on_hover_text("When off, the plane is level, like the floor")
        .changed()
    {
        (new.tilt, changed) = (falls.then(TiltEntry::default), Some("slope"));
    }
    if let Some(tilt) = &mut new.tilt {
        let fall = known_number(ui, units, Quantity::Fall, &mut tilt.fall_deg).then_some("slope");
        let toward = known_number(ui, units, Quantity::Toward, &mut tilt.toward_deg).then_some("direction");
        changed = changed.or(fall).or(toward);
    }
    let region = region_buttons(app, ui, index, plane);
    let set = changed.map(|what| PlaneAction::Set {
        index,
        plane: Box::new(new),
        name: format!("change the {what} of {}", plane.id),
    });
    renamed.or(set).or(region)
}

/// Shows the field for the name of a plane; returns the new name once the operator has entered it.
fn name_field(ui: &mut Ui, index: usize, id: &str) -> Option<String> {
    let field = |ui: &mut Ui| {
        let label = ui.label(RichText::new("Plane name").color(theme::palette(ui.ctx()).text2));
        let (response, typed) = entered_text(ui, ("plane", index), id, 120.0);
        response.labelled_by(label.id);
        typed
    };
    ui.horizontal(field).inner
}

/// Parameter of a plane: height in metres, fall and direction in degrees.
#[derive(Clone, Copy, Debug)]
enum Quantity {
    Height,
    Fall,
    Toward,
}

impl Quantity {
    const fn title(self) -> &'static str {
        match self {
            Self::Height => "Height above the floor",
            Self::Fall => "Slope",
            Self::Toward => "Slopes towards",
        }
    }

    /// Returns the initial value and sigma of a parameter that the operator changes from "unknown" to another state,
    /// in metres or degrees.
    const fn initial_value_and_sigma(self) -> [f64; 2] {
        match self {
            Self::Height => [0.0, 0.02],
            Self::Fall => [3.0, 0.5],
            Self::Toward => [0.0, 5.0],
        }
    }

    /// Creates the field for the value of a parameter or for its standard deviation, which is never 0.
    fn field(self, units: Units, value: &mut f64, is_sigma: bool) -> DragValue<'_> {
        let (low, most) = match self {
            Self::Height => return length_field(units, value, if is_sigma { 1e-4 } else { -1e5 }),
            Self::Fall => (0.0, 45.0),
            Self::Toward => (-360.0, 360.0),
        };
        let low = if is_sigma { 1e-3 } else { low };
        let field = DragValue::new(value).speed(0.1).range(low..=most).suffix("\u{b0}");
        field.max_decimals(3).update_while_editing(false)
    }
}

/// State of a parameter that the solve estimates without a prior.
const UNKNOWN: &str = "unknown";
/// State of a parameter that is fixed.
const KNOWN: &str = "known";
/// State of a parameter with a prior.
const ABOUT: &str = "approximate";

/// Shows a parameter that is unknown, fixed, or known with a sigma; returns whether the parameter was
/// changed.
fn known_number(ui: &mut Ui, units: Units, what: Quantity, number: &mut Option<PlaneNumber>) -> bool {
    let palette = theme::palette(ui.ctx());
    let before = *number;
    ui.horizontal_wrapped(|ui| {
        let label = ui.label(RichText::new(what.title()).color(palette.text2));
        let [usual, usual_sigma] = what.initial_value_and_sigma();
        let (mut value, sigma) = number.map_or((usual, None), |number| (number.value(), sigma_of(number)));
        let state = match (*number, sigma) {
            (None, _) => UNKNOWN,
            (_, None) => KNOWN,
            (_, Some(_)) => ABOUT,
        };
        let mut chosen = state;
        ComboBox::from_id_salt(what.title())
            .width(96.0)
            .selected_text(state)
            .show_ui(ui, |ui| {
                for state in [UNKNOWN, KNOWN, ABOUT] {
                    ui.selectable_value(&mut chosen, state, state);
                }
            })
            .response
            .labelled_by(label.id);
        if chosen == UNKNOWN {
            *number = None;
            return;
        }
        ui.add(what.field(units, &mut value, false)).labelled_by(label.id);
        let mut sigma = (chosen == ABOUT).then_some(sigma.unwrap_or(usual_sigma));
        if let Some(sigma) = &mut sigma {
            let sure = ui.label(RichText::new("\u{b1}").color(palette.text3));
            ui.add(what.field(units, sigma, true))
                .labelled_by(sure.id)
                .on_hover_text("Standard deviation (\u{b1})");
        }
        let is_same = before.is_some_and(|before| before.value() == value && sigma_of(before) == sigma);
        if !is_same {
            *number =
                Some(sigma.map_or(PlaneNumber::Exact(value), |sigma| {
                    PlaneNumber::Known(Known::prior(value, sigma))
                }));
        }
    });
    *number != before
}

const fn sigma_of(number: PlaneNumber) -> Option<f64> {
    match number {
        PlaneNumber::Exact(_) => None,
        PlaneNumber::Known(known) => known.sigma,
    }
}

/// Shows the buttons that set the region of a plane: draw on the plan, or take the field of view of the
/// current camera.
fn region_buttons(app: &mut App, ui: &mut Ui, index: usize, plane: &PlaneEntry) -> Option<PlaneAction> {
    let palette = theme::palette(ui.ctx());
    let mut asked = None;
    ui.horizontal_wrapped(|ui| {
        let corners = plane.region.len();
        let text = if corners == 0 {
            "No region: no pixels are mapped to this plane".into()
        } else {
            format!("Region with {corners} corners")
        };
        ui.label(RichText::new(text).color(palette.text2));
        if ui.button("Draw").on_hover_text("Draw the region corner by corner on the plan (O)").clicked() {
            let tool = TOOLS.iter().position(|tool| tool.icon == calib_editor::Icon::Region);
            tool.into_iter().for_each(|tool| app.send(Action::SelectTool(tool)));
        }
        let camera = app.editor.session().entry().map_or("this camera", |entry| &entry.id);
        if ui
            .button("Use the field of view")
            .on_hover_text(format!("Set the region to the floor area that {camera} sees"))
            .clicked()
        {
            asked = Some(PlaneAction::SetRegionFromField(index));
        }
        if corners > 0 && ui.button("Clear").on_hover_text("Remove the region").clicked() {
            let bare = PlaneEntry { region: Vec::new(), ..plane.clone() };
            let name = format!("clear the region of {}", plane.id);
            asked = Some(PlaneAction::Set { index, plane: Box::new(bare), name });
        }
    });
    asked
}

/// Shows the choice of the plane for the selected annotations, if planes exist.
pub(crate) fn lies_on_ui(app: &mut App, ui: &mut Ui) {
    let session = app.editor.session();
    let under = planes_of_parts(&session.site, session.camera, &session.selection);
    if session.site.planes.is_empty() || under.is_empty() {
        return;
    }
    let palette = theme::palette(ui.ctx());
    let ids: Vec<Option<String>> =
        std::iter::once(None).chain(session.site.planes.iter().map(|plane| Some(plane.id.clone()))).collect();
    let title = |plane: &Option<String>| plane.clone().unwrap_or_else(|| "Floor".into());
    let now = match under.iter().collect::<Vec<_>>()[..] {
        [one] => title(one),
        _ => "several".into(),
    };
    let mut chosen = None;
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("On plane").color(palette.text2));
        ComboBox::from_id_salt("on plane")
            .selected_text(now)
            .show_ui(ui, |ui| {
                for id in ids {
                    let is_own = under.len() == 1 && under.contains(&id);
                    if ui.selectable_label(is_own, title(&id)).clicked() && !is_own {
                        chosen = Some(id);
                    }
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text(session.selection_name());
    });
    chosen.into_iter().for_each(|plane| app.send(Action::Planes(PlaneAction::Assign(plane))));
}
