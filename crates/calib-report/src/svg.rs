//! A drawing as SVG: into a page as it is, or onto an image by what paints SVG.

use std::fmt::Write as _;

use calib_draw::{Look, Outline, Rgb};

use crate::style;

/// Width of a letter over its height, on average.
pub(crate) const TAG_LETTER: f64 = 0.49;

/// How a line looks.
#[derive(Clone, Copy, Debug)]
pub struct Stroke<'a> {
    /// Of the line.
    pub colour: Rgb,
    /// In pixels of the screen.
    pub width: f64,
    /// From 0 to 1.
    pub opacity: f64,
    /// Lengths of dashes and gaps; empty for a full line.
    pub dash: &'a [f64],
    /// Outlined in dark, to be legible on any ground.
    pub outlined: bool,
}

impl<'a> Stroke<'a> {
    /// A full line.
    #[must_use]
    pub const fn new(colour: Rgb, width: f64) -> Self {
        Self { colour, width, opacity: 1.0, dash: &[], outlined: true }
    }

    /// As a meaning looks.
    #[must_use]
    pub fn of(look: Look) -> Self {
        let Look { colour, width, dash, opacity, outline } = look;
        Self { colour, width, opacity, dash, outlined: outline == Outline::Dark }
    }

    /// The same, so far opaque, without an outline.
    #[must_use]
    pub const fn faint(self, opacity: f64) -> Self {
        Self { opacity, outlined: false, ..self }
    }
}

/// Where a text stands relative to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// Its middle is there.
    Middle,
    /// It ends there.
    End,
}

impl Anchor {
    const fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

/// A drawing in the making, in pixels of its ground.
#[derive(Clone, Debug)]
pub struct Svg {
    size: [f64; 2],
    /// How much larger than on screen everything is.
    pub scale: f64,
    body: String,
}

impl Svg {
    /// Width and height of its ground, in pixels.
    #[must_use]
    pub const fn size(&self) -> [f64; 2] {
        self.size
    }

    /// An empty drawing on a ground of this size; `scale` is how much larger than on screen things are.
    #[must_use]
    pub fn new(size: [f64; 2], scale: f64) -> Self {
        Self { size, scale, body: String::new() }
    }

    /// A polyline of pixels; closed ones come back to their start.
    pub fn line(&mut self, points: &[[f64; 2]], closed: bool, stroke: Stroke) {
        let path = self.path(points, closed);
        if path.is_empty() {
            return;
        }
        let Stroke { colour, width, opacity, dash, outlined } = stroke;
        let width = width * self.scale;
        if outlined {
            let wide = width + 2.0 * self.scale;
            let _ = writeln!(
                self.body,
                r#"<path d="{path}" fill="none" stroke="{}" stroke-width="{wide:.2}" stroke-opacity="{:.2}" stroke-linecap="round" stroke-linejoin="round"/>"#,
                Rgb::OUTLINE,
                0.6 * opacity,
            );
        }
        let dash: Vec<String> = dash.iter().map(|d| format!("{:.1}", d * self.scale)).collect();
        let dash = if dash.is_empty() {
            String::new()
        } else {
            format!(r#" stroke-dasharray="{}""#, dash.join(" "))
        };
        let _ = writeln!(
            self.body,
            r#"<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width:.2}" stroke-opacity="{opacity:.2}" stroke-linejoin="round"{dash}/>"#,
        );
    }

    /// A filled polygon.
    pub fn fill(&mut self, points: &[[f64; 2]], colour: Rgb, opacity: f64) {
        let path = self.path(points, true);
        let _ = writeln!(self.body, r#"<path d="{path}" fill="{colour}" fill-opacity="{opacity:.3}"/>"#);
    }

    /// A dot with a dark rim.
    pub fn dot(&mut self, [x, y]: [f64; 2], radius: f64, colour: Rgb) {
        let (radius, rim) = (radius * self.scale, self.scale);
        let _ = writeln!(
            self.body,
            r#"<circle cx="{x:.2}" cy="{y:.2}" r="{radius:.2}" fill="{colour}" stroke="{}" stroke-opacity="0.6" stroke-width="{rim:.2}"/>"#,
            Rgb::OUTLINE
        );
    }

    /// A ring.
    pub fn ring(&mut self, [x, y]: [f64; 2], radius: f64, stroke: Stroke) {
        let Stroke { colour, width, opacity, outlined, .. } = stroke;
        let (radius, width) = (radius * self.scale, width * self.scale);
        if outlined {
            let wide = width + 2.0 * self.scale;
            let _ = writeln!(
                self.body,
                r#"<circle cx="{x:.2}" cy="{y:.2}" r="{radius:.2}" fill="none" stroke="{}" stroke-width="{wide:.2}" stroke-opacity="{:.2}"/>"#,
                Rgb::OUTLINE,
                0.6 * opacity,
            );
        }
        let _ = writeln!(
            self.body,
            r#"<circle cx="{x:.2}" cy="{y:.2}" r="{radius:.2}" fill="none" stroke="{colour}" stroke-width="{width:.2}" stroke-opacity="{opacity:.2}"/>"#,
        );
    }

    /// A text with a dark halo.
    pub fn text(&mut self, [x, y]: [f64; 2], text: &str, colour: Rgb, anchor: Anchor) {
        let size = style::TEXT * self.scale;
        let anchor = anchor.name();
        let _ = writeln!(
            self.body,
            r#"<text x="{x:.1}" y="{y:.1}" font-size="{size:.1}" text-anchor="{anchor}" fill="{colour}" stroke="{}" stroke-opacity="0.85" stroke-width="{:.1}" stroke-linejoin="round" paint-order="stroke">{}</text>"#,
            Rgb::OUTLINE,
            3.0 * self.scale,
            escape(text)
        );
    }

    /// A text on a light ground, in a dark colour without a halo.
    pub(crate) fn ink(&mut self, [x, y]: [f64; 2], text: &str, colour: Rgb, anchor: Anchor) {
        let size = style::TEXT * self.scale;
        let anchor = anchor.name();
        let _ = writeln!(
            self.body,
            r#"<text x="{x:.1}" y="{y:.1}" font-size="{size:.1}" text-anchor="{anchor}" fill="{colour}">{}</text>"#,
            escape(text)
        );
    }

    /// Width that a text takes, about.
    pub(crate) fn text_width(&self, text: &str) -> f64 {
        style::TEXT * self.scale * TAG_LETTER * text.chars().count() as f64
    }

    /// Width and height of the ground of a tag.
    pub(crate) fn tag_size(&self, text: &str) -> [f64; 2] {
        let size = style::TEXT * self.scale;
        [self.text_width(text) + size, 1.6 * size]
    }

    /// A text on a dark ground, its upper left corner at this pixel.
    pub fn tag(&mut self, [x, y]: [f64; 2], text: &str, colour: Rgb) {
        let size = style::TEXT * self.scale;
        let [width, height] = self.tag_size(text);
        let _ = writeln!(
            self.body,
            r#"<rect x="{x:.1}" y="{y:.1}" width="{width:.1}" height="{height:.1}" rx="{:.1}" fill="{}" fill-opacity="0.82"/><text x="{:.1}" y="{:.1}" font-size="{size:.1}" fill="{colour}">{}</text>"#,
            0.25 * size,
            Rgb::TAG,
            x + 0.5 * size,
            y + 1.15 * size,
            escape(text)
        );
    }

    fn path(&self, points: &[[f64; 2]], closed: bool) -> String {
        // What is far off the ground is not drawn: huge numbers break rasterisers.
        const FAR: f64 = 1e5;
        let mut path = String::new();
        for [x, y] in points.iter().filter(|[x, y]| x.abs() < FAR && y.abs() < FAR) {
            let _ = write!(path, "{}{x:.2} {y:.2}", if path.is_empty() { "M" } else { "L" });
        }
        if closed && !path.is_empty() {
            path.push('Z');
        }
        path
    }

    /// The drawing as an SVG element, with something beneath it.
    #[must_use]
    pub fn finish(&self, beneath: &str) -> String {
        let [w, h] = self.size;
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 {w} {h}" width="{w}" height="{h}" font-family="Ubuntu, 'Segoe UI', Roboto, 'Helvetica Neue', sans-serif">{beneath}{}</svg>"#,
            self.body
        )
    }
}

/// Text that is safe between the tags of a page.
pub(crate) fn escape(text: &str) -> String {
    // XML has no control characters.
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
