//! Colours, fonts, radii and line widths of the dark and the light theme.

use std::sync::Arc;

use calib_core::Kind;
use calib_draw::{KindLook, Rgb};
use egui::{Color32, CornerRadius, FontData, FontFamily, FontId, Stroke, TextStyle, Theme, Visuals};

use crate::platform::{Here, Platform as _};

/// Colours of the window; lines on images have the same colours in both themes.
#[derive(Clone, Copy, Debug)]
pub struct Palette {
    /// Background of the window.
    pub bg: Color32,
    /// Background of panels.
    pub panel: Color32,
    /// Background of buttons and fields.
    pub raised: Color32,
    /// Colour of lines between panels.
    pub line: Color32,
    /// Background around images.
    pub canvas: Color32,
    /// Colour of main text.
    pub text: Color32,
    /// Colour of secondary text.
    pub text2: Color32,
    /// Colour of captions.
    pub text3: Color32,
    /// Colour of selection and focus.
    pub accent: Color32,
    /// Background of a selection.
    pub accent_bg: Color32,
    /// Colour of finished steps and good results.
    pub ok: Color32,
    /// Colour of warnings.
    pub warn: Color32,
    /// Background of a warning.
    pub warn_bg: Color32,
    /// Colour of errors.
    pub bad: Color32,
    /// Background of an error.
    pub bad_bg: Color32,
    /// Colours of residuals: as expected, large (above 1.5 sigmas), suspicious (above 3 sigmas).
    pub residual: [Color32; 3],
}

const fn hex(rgb: u32) -> Color32 {
    Color32::from_rgb((rgb >> 16) as u8, (rgb >> 8) as u8, rgb as u8)
}

/// Converts a colour of `calib_draw` to a colour of egui.
#[must_use]
pub const fn colour(Rgb([red, green, blue]): Rgb) -> Color32 {
    Color32::from_rgb(red, green, blue)
}

/// Converts a colour of `calib_draw`, with opacity `alpha` from 0 to 255.
const fn with_alpha(Rgb(rgb): Rgb, alpha: u8) -> Color32 {
    const fn share(value: u8, alpha: u8) -> u8 {
        ((value as u32 * alpha as u32 + 127) / 255) as u8
    }
    let [red, green, blue] = rgb;
    Color32::from_rgba_premultiplied(share(red, alpha), share(green, alpha), share(blue, alpha), alpha)
}

/// Colours of the dark theme.
pub const DARK: Palette = Palette {
    bg: hex(0x0F1113),
    panel: hex(0x191C1F),
    raised: hex(0x23272B),
    line: hex(0x2E3338),
    canvas: hex(0x0B0C0E),
    text: hex(0xE4E7EA),
    text2: hex(0xA3ABB3),
    text3: hex(0x8C959E),
    accent: hex(0x8E9BFF),
    accent_bg: hex(0x2C3157),
    ok: hex(0x6CC5A1),
    warn: hex(0xFFB020),
    warn_bg: hex(0x2E2616),
    bad: hex(0xFF6B82),
    bad_bg: hex(0x331B22),
    residual: [hex(0x5F8FAE), hex(0xFFB020), hex(0xFF5470)],
};

/// Colours of the light theme.
pub const LIGHT: Palette = Palette {
    bg: hex(0xE9EBED),
    panel: hex(0xF7F8F9),
    raised: hex(0xFFFFFF),
    line: hex(0xD3D7DB),
    canvas: hex(0xC9CDD1),
    text: hex(0x1B1F23),
    text2: hex(0x4F5861),
    text3: hex(0x606A74),
    accent: hex(0x4450C8),
    accent_bg: hex(0xE2E5FB),
    ok: hex(0x17704D),
    warn: hex(0x8A5800),
    warn_bg: hex(0xFFF3D9),
    bad: hex(0xB3153A),
    bad_bg: hex(0xFDE6EA),
    residual: [hex(0x3E7FA8), hex(0xB87400), hex(0xC2183F)],
};

/// Colours on images, independent of the theme.
pub mod on_image {
    use calib_draw::Rgb;
    use egui::Color32;

    use super::{colour, with_alpha};

    /// Colour of control points, marks, links, grid and horizon.
    pub const WHITE: Color32 = colour(Rgb::WHITE);
    /// Colour of a link that needs another view, and of its epipolar line.
    pub const WAITING: Color32 = colour(Rgb::INCOMPLETE);
    /// Colour of uncertain values.
    pub const DOUBT: Color32 = colour(Rgb::UNKNOWN);
    /// Colour of rejected lines (outliers) and of other errors.
    pub const BAD: Color32 = colour(Rgb::BAD);
    /// Colour of dragged, selected or focused handles.
    pub const ACCENT: Color32 = colour(Rgb::ACCENT);
    /// Colour of the outline of every line, 1 point on each side.
    pub const OUTLINE: Color32 = with_alpha(Rgb::OUTLINE, 153);
    /// Background colour of labels.
    pub const TAG: Color32 = with_alpha(Rgb::TAG, 209);
}

/// Radius of a handle, in points.
pub const HANDLE: f32 = 3.5;
/// Radius within which a press hits a handle, in points.
pub const HIT: f32 = 8.0;
/// Distance at which a handle responds to a finger, in points.
pub const TOUCH_HIT: f32 = 24.0;

/// Returns the colour of an annotation kind on images.
#[must_use]
pub fn kind(kind: Kind) -> Color32 {
    colour(KindLook::of(kind).colour)
}

/// Returns the icon colour of an annotation kind in panels.
#[must_use]
pub fn kind_icon(kind: Kind, dark: bool) -> Color32 {
    let look = KindLook::of(kind);
    colour(if dark { look.colour } else { look.on_light })
}

/// Returns the colour of the camera with this number, from `Session::camera_slot`.
#[must_use]
pub fn camera(slot: usize) -> Color32 {
    colour(Rgb::camera(slot))
}

/// Returns the letter that accompanies a camera's colour: A to Z, then AA, AB and so on.
#[must_use]
pub fn camera_letter(index: usize) -> String {
    let letter = |i: usize| char::from(b'A' + (i % 26) as u8);
    match index / 26 {
        0 => letter(index).to_string(),
        more => format!("{}{}", letter(more - 1), letter(index)),
    }
}

/// Returns the colours of the current theme.
#[must_use]
pub fn palette(ctx: &egui::Context) -> &'static Palette {
    match ctx.theme() {
        Theme::Dark => &DARK,
        Theme::Light => &LIGHT,
    }
}

/// Returns the colour of a residual; `over_sigma` is the residual divided by its sigma.
#[must_use]
pub fn residual(palette: &Palette, over_sigma: f64) -> Color32 {
    palette.residual[if over_sigma > 3.0 { 2 } else { usize::from(over_sigma > 1.5) }]
}

/// Returns the medium font at a size in points.
#[must_use]
pub fn medium(size: f32) -> FontId {
    FontId::new(size, FontFamily::Name("medium".into()))
}

/// Returns the regular font at a size in points.
#[must_use]
pub fn regular(size: f32) -> FontId {
    FontId::proportional(size)
}

/// Installs fonts, spacing and both themes.
pub fn install(ctx: &egui::Context) {
    let mut fonts = egui::FontDefinitions::default();
    let mut add = |name: &str, bytes: &'static [u8]| {
        fonts.font_data.insert(name.into(), Arc::new(FontData::from_static(bytes)));
    };
    add("plex", include_bytes!("../assets/IBMPlexSans-Regular.ttf"));
    // The browser page has one weight only, because a second one would add 5 % to its size.
    add("plex-medium", Here::MEDIUM_FONT);
    let fallback = fonts.families.get(&FontFamily::Proportional).cloned().unwrap_or_default();
    let before = |first: &str| -> Vec<String> {
        std::iter::once(first.to_owned()).chain(fallback.iter().cloned()).collect()
    };
    fonts.families.insert(FontFamily::Proportional, before("plex"));
    fonts.families.insert(FontFamily::Name("medium".into()), before("plex-medium"));
    // Monospace digits are needed; the digits of this font have equal width.
    fonts.families.entry(FontFamily::Monospace).or_default().push("plex".into());
    ctx.set_fonts(fonts);
    for (theme, palette) in [(Theme::Dark, &DARK), (Theme::Light, &LIGHT)] {
        let mut style = theme.default_style();
        style.visuals = visuals(theme.default_visuals(), palette);
        style.text_styles = [
            (TextStyle::Small, regular(11.0)),
            (TextStyle::Body, regular(12.0)),
            (TextStyle::Button, regular(12.0)),
            (TextStyle::Heading, medium(13.0)),
            (TextStyle::Monospace, FontId::monospace(12.0)),
        ]
        .into();
        style.spacing.item_spacing = egui::vec2(8.0, 4.0);
        style.spacing.button_padding = egui::vec2(8.0, 3.0);
        style.spacing.interact_size = egui::vec2(24.0, 20.0);
        style.spacing.scroll = egui::style::ScrollStyle::thin();
        style.interaction.tooltip_delay = 0.4;
        if Here::wants_stillness() {
            style.animation_time = 0.0;
        }
        ctx.set_style_of(theme, style);
    }
}

/// Whether animations are off, as with reduced motion.
#[must_use]
pub fn is_still(ctx: &egui::Context) -> bool {
    ctx.global_style().animation_time <= 0.0
}

fn visuals(base: Visuals, p: &Palette) -> Visuals {
    let mut v = base;
    let radius = CornerRadius::same(4);
    v.panel_fill = p.panel;
    v.window_fill = p.panel;
    v.window_stroke = Stroke::new(1.0, p.line);
    v.extreme_bg_color = p.bg;
    // A text field is lighter than its panel in the light theme, and darker in the dark theme.
    v.text_edit_bg_color = Some(if v.dark_mode { p.bg } else { p.raised });
    v.faint_bg_color = p.raised;
    v.hyperlink_color = p.accent;
    v.warn_fg_color = p.warn;
    v.error_fg_color = p.bad;
    v.selection.bg_fill = p.accent_bg;
    v.selection.stroke = Stroke::new(1.0, p.accent);
    v.override_text_color = None;
    v.weak_text_color = Some(p.text3);
    let w = &mut v.widgets;
    for (state, fill, text) in [
        (&mut w.noninteractive, p.panel, p.text),
        (&mut w.inactive, p.raised, p.text),
        (&mut w.hovered, p.line, p.text),
        (&mut w.active, p.accent_bg, p.text),
        (&mut w.open, p.raised, p.text),
    ] {
        state.bg_fill = fill;
        state.weak_bg_fill = fill;
        state.bg_stroke = Stroke::new(1.0, p.line);
        state.fg_stroke = Stroke::new(1.0, text);
        state.corner_radius = radius;
        state.expansion = 0.0;
    }
    // Focused widgets are painted like active ones, so that the keyboard focus is visible.
    w.active.bg_stroke = Stroke::new(1.5, p.accent);
    v
}
