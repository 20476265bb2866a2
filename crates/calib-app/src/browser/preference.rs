//! What the browser keeps of how the app looks: the theme that was chosen.
//!
//! egui would keep more (the widths of panels), but what writes that down is a fortieth of the page.

use egui::{Context, ThemePreference};

const KEY: &str = "calib.theme";

/// `None` where the browser keeps nothing, as in a private window.
fn storage() -> Option<web_sys::Storage> {
    web_sys::window()?.local_storage().ok()?
}

/// The theme that is chosen now.
fn chosen(ctx: &Context) -> ThemePreference {
    ctx.options(|options| options.theme_preference)
}

/// Takes up the theme of an earlier visit; what it is now.
pub(super) fn restore(ctx: &Context) -> ThemePreference {
    match storage().and_then(|storage| storage.get_item(KEY).ok().flatten()).as_deref() {
        Some("dark") => ctx.set_theme(ThemePreference::Dark),
        Some("light") => ctx.set_theme(ThemePreference::Light),
        _ => {}
    }
    chosen(ctx)
}

/// Writes the theme down where it is another than the one kept.
pub(super) fn keep(ctx: &Context, kept: &mut ThemePreference) {
    let now = chosen(ctx);
    if now == *kept {
        return;
    }
    *kept = now;
    let name = match now {
        ThemePreference::Dark => "dark",
        ThemePreference::Light => "light",
        ThemePreference::System => "system",
    };
    if let Some(storage) = storage() {
        // A full or forbidden storage costs the theme of the next visit, nothing else.
        let _ = storage.set_item(KEY, name);
    }
}
