//! Keyboard focus: focused widgets scroll into view, and requested fields get the focus.

use egui::accesskit::{Action, ActionRequest, TreeId};
use egui::{Context, Event, Id, Key, Modifiers, Response};

/// Field that the program asks the operator to fill in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RequestedField {
    /// Length or height of an annotation of the current camera; contains the index of the annotation.
    Size(usize),
    /// Distance between two measured points of the plan.
    PlanLength,
}

/// Id under which the requested field is stored until a panel shows it.
fn requested_id() -> Id {
    Id::unique("requested field")
}

/// Requests a field: the next panel that shows the field gives it the focus.
pub(crate) fn request(ctx: &Context, field: RequestedField) {
    ctx.data_mut(|data| data.insert_temp(requested_id(), field));
    ctx.request_repaint();
}

/// Gives the focus to a field if it was requested.
pub(crate) fn focus_if_requested(response: &Response, field: RequestedField) {
    let is_requested = response.ctx.data_mut(|data| {
        let is_requested = data.get_temp(requested_id()) == Some(field);
        if is_requested {
            data.remove::<RequestedField>(requested_id());
        }
        is_requested
    });
    if is_requested {
        response.request_focus();
    }
}

/// Keyboard focus of the last frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FocusWatch {
    /// Widget that had the focus.
    pub(crate) focused: Option<Id>,
    /// Number of frames in which the program may still scroll to the widget.
    tries: u8,
}

/// Scrolls the focused widget into view if the focus has moved to a partly hidden widget. A press of the pointer does
/// not scroll.
pub(crate) fn scroll_to_focused(ctx: &Context, watch: &mut FocusWatch) {
    /// Number of frames in which the program scrolls. A panel can have its final layout one frame later.
    const MAX_TRIES: u8 = 4;
    let focused = ctx.memory(|memory| memory.focused());
    if std::mem::replace(&mut watch.focused, focused) != focused {
        let is_pressed = ctx.input(|input| input.pointer.any_down() || input.pointer.any_released());
        watch.tries = if is_pressed { 0 } else { MAX_TRIES };
    }
    let Some(id) = focused.filter(|_| watch.tries > 0) else { return };
    let Some(response) = ctx.read_response(id) else { return };
    if response.interact_rect.contains_rect(response.rect) {
        watch.tries = 0;
        return;
    }
    watch.tries -= 1;
    let request = ActionRequest {
        action: Action::ScrollIntoView,
        target_tree: TreeId::ROOT,
        target_node: id.accesskit_id(),
        data: None,
    };
    ctx.input_mut(|input| input.events.push(Event::AccessKitActionRequest(request)));
    ctx.request_repaint();
}

/// Id under which the focused length field is stored while it is empty.
fn blank_id() -> Id {
    Id::unique("blank field")
}

/// Stores whether a length field is focused and empty. Shortcuts then work, although a field has the focus.
pub(crate) fn set_blank(response: &Response, is_empty: bool) {
    let is_blank = is_empty && response.has_focus();
    response.ctx.data_mut(|data| {
        if is_blank {
            data.insert_temp(blank_id(), response.id);
        } else if data.get_temp(blank_id()) == Some(response.id) {
            data.remove::<Id>(blank_id());
        }
    });
}

/// Returns the focused field if it is an empty length field.
pub(crate) fn blank_field(ctx: &Context) -> Option<Id> {
    let blank: Option<Id> = ctx.data(|data| data.get_temp(blank_id()));
    blank.filter(|_| ctx.memory(|memory| memory.focused()) == blank)
}

/// Whether a key goes to an empty length field that has the focus: it enters or edits a length, or leaves the field.
pub(crate) fn is_for_field(key: Key, modifiers: Modifiers) -> bool {
    if modifiers.command {
        return matches!(key, Key::A | Key::C | Key::V | Key::X);
    }
    let is_digit = key.name().len() == 1 && key.name().starts_with(|sign: char| sign.is_ascii_digit());
    is_digit
        || matches!(
            key,
            Key::Period
                | Key::Comma
                | Key::Minus
                | Key::Plus
                | Key::Equals
                | Key::Enter
                | Key::Escape
                | Key::Tab
        )
}
