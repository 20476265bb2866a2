//! Colours, type, radii and strokes, in a dark and a light theme.

use std::sync::Arc;

use calib_core::Kind;
use egui::{Color32, CornerRadius, FontData, FontFamily, FontId, Stroke, TextStyle, Theme, Visuals};

/// The colours of the chrome; lines on images have one colour in both themes.
#[derive(Clone, Copy, Debug)]
pub struct Palette {
    /// Behind the panels.
    pub bg: Color32,
    /// Of a panel.
    pub panel: Color32,
    /// Of buttons and fields.
    pub raised: Color32,
    /// Between panels.
    pub line: Color32,
    /// Around images.
    pub canvas: Color32,
    /// Of what is read first.
    pub text: Color32,
    /// Of what is read second.
    pub text2: Color32,
    /// Of captions.
    pub text3: Color32,
    /// Of what is selected or in focus.
    pub accent: Color32,
    /// Behind what is selected.
    pub accent_bg: Color32,
    /// Of what is done.
    pub ok: Color32,
    /// Of what wants a look.
    pub warn: Color32,
    /// Behind it.
    pub warn_bg: Color32,
    /// Of what is wrong.
    pub bad: Color32,
    /// Behind it.
    pub bad_bg: Color32,
    /// Residuals: as expected, to be looked at, suspect.
    pub residual: [Color32; 3],
}

const fn hex(rgb: u32) -> Color32 {
    Color32::from_rgb((rgb >> 16) as u8, (rgb >> 8) as u8, rgb as u8)
}

/// The dark theme.
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

/// The light theme.
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

/// On every image, whatever the theme.
pub mod on_image {
    use egui::Color32;

    use super::hex;

    /// Control points, marks, links, grid, horizon.
    pub const WHITE: Color32 = Color32::WHITE;
    /// A link that waits for another view, and its epipolar line.
    pub const WAITING: Color32 = hex(0xF2DF4A);
    /// What is not known yet.
    pub const DOUBT: Color32 = hex(0xFFB020);
    /// A suspected line.
    pub const BAD: Color32 = hex(0xFF5470);
    /// What is held or in focus.
    pub const ACCENT: Color32 = hex(0x8E9BFF);
    /// Under every line, 1 px to each side.
    pub const OUTLINE: Color32 = Color32::from_rgba_premultiplied(4, 5, 7, 153);
    /// Behind tags.
    pub const TAG: Color32 = Color32::from_rgba_premultiplied(11, 12, 15, 209);
}

/// Drawn radius of a handle, and the radius within which it is hit, in points.
pub const HANDLE: f32 = 3.5;
/// Radius within which a handle is hit, in points.
pub const HIT: f32 = 8.0;

/// The colour of lines of a kind on images.
#[must_use]
pub fn kind(kind: Kind) -> Color32 {
    const COLOURS: [Color32; 7] = [
        hex(0x5BB8F5),
        hex(0xFFB020),
        hex(0x38D391),
        hex(0xF48FC3),
        hex(0xF2DF4A),
        hex(0xEEF1F4),
        hex(0xFF7F57),
    ];
    COLOURS[kind.row().colour % COLOURS.len()]
}

/// The colour of a kind's icon in the panels.
#[must_use]
pub fn kind_icon(kind_of: Kind, dark: bool) -> Color32 {
    const LIGHT_ICONS: [Color32; 7] = [
        hex(0x0B76B8),
        hex(0xA86B00),
        hex(0x0B8A55),
        hex(0xB83A80),
        hex(0x857300),
        hex(0x3C444C),
        hex(0xC4401B),
    ];
    if dark { kind(kind_of) } else { LIGHT_ICONS[kind_of.row().colour % LIGHT_ICONS.len()] }
}

/// The colour of a camera; after eight they start again, the letters go on.
#[must_use]
pub fn camera(index: usize) -> Color32 {
    const COLOURS: [Color32; 8] = [
        hex(0xFF9D7A),
        hex(0x6FE0D2),
        hex(0xC3A6FF),
        hex(0xE6DC6A),
        hex(0x8DB7FF),
        hex(0xF7A1C4),
        hex(0xA9D66B),
        hex(0xD9B38C),
    ];
    COLOURS[index % COLOURS.len()]
}

/// The letter that always goes with a camera's colour: A to Z, then AA, AB and so on.
#[must_use]
pub fn camera_letter(index: usize) -> String {
    let letter = |i: usize| char::from(b'A' + (i % 26) as u8);
    match index / 26 {
        0 => letter(index).to_string(),
        more => format!("{}{}", letter(more - 1), letter(index)),
    }
}

/// The colours of the theme in use.
#[must_use]
pub fn palette(ctx: &egui::Context) -> &'static Palette {
    match ctx.theme() {
        Theme::Dark => &DARK,
        Theme::Light => &LIGHT,
    }
}

/// Which of the three residual colours: by the residual over sigma.
#[must_use]
pub fn residual(palette: &Palette, over_sigma: f64) -> Color32 {
    palette.residual[if over_sigma > 3.0 { 2 } else { usize::from(over_sigma > 1.5) }]
}

/// Medium weight.
#[must_use]
pub fn medium(size: f32) -> FontId {
    FontId::new(size, FontFamily::Name("medium".into()))
}

/// Regular weight.
#[must_use]
pub fn regular(size: f32) -> FontId {
    FontId::proportional(size)
}

/// Installs type, spacing and both palettes.
pub fn install(ctx: &egui::Context) {
    let mut fonts = egui::FontDefinitions::default();
    let mut add = |name: &str, bytes: &'static [u8]| {
        fonts.font_data.insert(name.into(), Arc::new(FontData::from_static(bytes)));
    };
    add("plex", include_bytes!("../assets/IBMPlexSans-Regular.ttf"));
    // A second weight would be a twentieth of the page.
    #[cfg(target_arch = "wasm32")]
    add("plex-medium", include_bytes!("../assets/IBMPlexSans-Regular.ttf"));
    #[cfg(not(target_arch = "wasm32"))]
    add("plex-medium", include_bytes!("../assets/IBMPlexSans-Medium.ttf"));
    let fallback = fonts.families.get(&FontFamily::Proportional).cloned().unwrap_or_default();
    let before = |first: &str| -> Vec<String> {
        std::iter::once(first.to_owned()).chain(fallback.iter().cloned()).collect()
    };
    fonts.families.insert(FontFamily::Proportional, before("plex"));
    fonts.families.insert(FontFamily::Name("medium".into()), before("plex-medium"));
    // Digits of one width are wanted of it, and ours have one.
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
        #[cfg(target_arch = "wasm32")]
        if crate::web::wants_stillness() {
            style.animation_time = 0.0;
        }
        ctx.set_style_of(theme, style);
    }
}

/// Whether nothing is to move by itself.
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
    v
}
