//! Crosshair: a pointer that the arrow keys move, so that every tool works without a mouse.
//!
//! The keys become pointer events before egui reads the input. Canvases, tools and loupe then treat the crosshair as
//! they treat a mouse.

use egui::{Context, Event, Key, Modifiers, PointerButton, Pos2, RawInput, Rect, Vec2};

/// Distances by which an arrow key moves the crosshair: one press, a held key, a key held for longer; in points.
const STEPS: [f32; 3] = [1.0, 4.0, 12.0];
/// Distance of one press with Shift, in points.
const COARSE_STEP: f32 = 24.0;
/// Number of repetitions of a held key per entry of [`STEPS`].
const REPETITIONS_PER_STEP: usize = 8;

/// State of the crosshair. It is a plugin of egui, because plugins see the input first.
#[derive(Debug, Default)]
pub struct Crosshair {
    /// Canvas on which the arrow keys move the crosshair, in screen points; `None` if they have another effect.
    pub canvas: Option<Rect>,
    /// Position, in screen points; `None` while the mouse is used.
    pub at: Option<Pos2>,
    /// Last position of the mouse.
    mouse: Option<Pos2>,
    /// Position of the last point that was set. Enter at the same position has its usual effect.
    set: Option<Pos2>,
    /// Number of repetitions of the held key.
    repetitions: usize,
}

/// Returns the direction of an arrow key.
const fn direction(key: Key) -> Option<Vec2> {
    match key {
        Key::ArrowLeft => Some(Vec2::new(-1.0, 0.0)),
        Key::ArrowRight => Some(Vec2::new(1.0, 0.0)),
        Key::ArrowUp => Some(Vec2::new(0.0, -1.0)),
        Key::ArrowDown => Some(Vec2::new(0.0, 1.0)),
        _ => None,
    }
}

impl Crosshair {
    /// Calls `change` with the crosshair of this window, and returns its result.
    pub(crate) fn with<T>(ctx: &Context, change: impl FnOnce(&mut Self) -> T) -> T {
        change(&mut ctx.plugin_or_default::<Self>().lock())
    }

    /// Moves the crosshair, which first appears at the mouse or in the middle of the canvas.
    fn step(&mut self, canvas: Rect, by: Vec2, modifiers: Modifiers, is_repeated: bool) -> Pos2 {
        self.repetitions = if is_repeated { self.repetitions + 1 } else { 0 };
        let held = STEPS[(self.repetitions / REPETITIONS_PER_STEP).min(STEPS.len() - 1)];
        let length = if modifiers.shift { COARSE_STEP } else { held };
        let from = self.at.or(self.mouse.filter(|at| canvas.contains(*at))).unwrap_or(canvas.center());
        let inside = canvas.shrink(1.0);
        let at = (from + length * by).clamp(inside.min, inside.max);
        self.at = Some(at);
        at
    }

    /// Converts presses of arrow keys to pointer movements and a press of Enter to a click. Other events stay.
    fn convert(&mut self, events: Vec<Event>) -> Vec<Event> {
        let mut converted = Vec::new();
        for event in events {
            match (event, self.canvas, self.at) {
                (Event::PointerMoved(at), ..) => {
                    (self.at, self.set, self.mouse) = (None, None, Some(at));
                    converted.push(Event::PointerMoved(at));
                }
                (Event::Key { key, pressed: true, repeat, modifiers, .. }, Some(canvas), _)
                    if direction(key).is_some() && !modifiers.command && !modifiers.alt =>
                {
                    let by = direction(key).unwrap_or_default();
                    let at = self.step(canvas, by, modifiers, repeat);
                    converted.push(Event::PointerMoved(at));
                }
                (Event::Key { key: Key::Enter, pressed: true, modifiers, .. }, Some(_), Some(at))
                    if self.set != Some(at) && !modifiers.command =>
                {
                    self.set = Some(at);
                    let button = |pressed| Event::PointerButton {
                        pos: at,
                        button: PointerButton::Primary,
                        pressed,
                        modifiers,
                    };
                    converted.extend([Event::PointerMoved(at), button(true), button(false)]);
                }
                (event, ..) => converted.push(event),
            }
        }
        converted
    }
}

impl egui::Plugin for Crosshair {
    fn debug_name(&self) -> &'static str {
        "crosshair"
    }

    fn input_hook(&mut self, _: &Context, input: &mut RawInput) {
        if self.canvas.is_none() {
            self.at = None;
        }
        input.events = self.convert(std::mem::take(&mut input.events));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(key: Key, modifiers: Modifiers, repeat: bool) -> Event {
        Event::Key { key, physical_key: None, pressed: true, repeat, modifiers }
    }

    fn moved(events: &[Event]) -> Option<Pos2> {
        events.iter().rev().find_map(|event| match event {
            Event::PointerMoved(at) => Some(*at),
            _ => None,
        })
    }

    #[test]
    fn arrow_keys_move_and_enter_clicks_once_per_position() {
        let canvas = Rect::from_min_size(Pos2::new(100.0, 50.0), Vec2::new(400.0, 300.0));
        let mut crosshair = Crosshair { canvas: Some(canvas), ..Crosshair::default() };
        let right = |repeat| vec![press(Key::ArrowRight, Modifiers::NONE, repeat)];
        let enter = || vec![press(Key::Enter, Modifiers::NONE, false)];
        assert!(matches!(crosshair.convert(enter())[..], [Event::Key { .. }]), "nothing is shown yet");
        assert_eq!(moved(&crosshair.convert(right(false))), Some(canvas.center() + Vec2::new(1.0, 0.0)));
        let down = vec![press(Key::ArrowDown, Modifiers::SHIFT, false)];
        assert_eq!(moved(&crosshair.convert(down)), Some(canvas.center() + Vec2::new(1.0, 24.0)));
        assert_eq!(crosshair.convert(enter()).len(), 3, "a click");
        assert!(matches!(crosshair.convert(enter())[..], [Event::Key { .. }]), "the second press finishes");
        (0..200).for_each(|_| drop(crosshair.convert(right(true))));
        assert_eq!(crosshair.at.map(|at| at.x), Some(canvas.right() - 1.0), "it stays on the canvas");
        crosshair.convert(vec![Event::PointerMoved(Pos2::new(120.0, 60.0))]);
        assert_eq!(crosshair.at, None, "the mouse replaces it");
        assert_eq!(moved(&crosshair.convert(right(false))), Some(Pos2::new(121.0, 60.0)));
    }
}
