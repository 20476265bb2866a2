//! SVG drawing, for HTML pages and for rasterising onto images.

use std::fmt::Write as _;

use calib_draw::{Look, Outline, Rgb};

use crate::style;

/// Average width of a letter divided by the letter height.
pub(crate) const TAG_LETTER: f64 = 0.49;

/// Appearance of a line. Lengths are in screen pixels and are multiplied by [`Svg::scale`].
#[derive(Clone, Copy, Debug)]
pub struct Stroke<'a> {
    /// Colour of the line.
    pub colour: Rgb,
    /// Width of the line, in screen pixels.
    pub width: f64,
    /// Opacity of the line, from 0 to 1.
    pub opacity: f64,
    /// Lengths of dashes and gaps, in screen pixels; empty for a solid line.
    pub dash: &'a [f64],
    /// Whether the line has a dark outline, for contrast with any background.
    pub outlined: bool,
}

impl<'a> Stroke<'a> {
    /// Creates an opaque, solid line with a dark outline; `width` is in screen pixels.
    #[must_use]
    pub const fn new(colour: Rgb, width: f64) -> Self {
        Self { colour, width, opacity: 1.0, dash: &[], outlined: true }
    }

    /// Creates the stroke with the appearance of an overlay item.
    #[must_use]
    pub fn of(look: Look) -> Self {
        let Look { colour, width, dash, opacity, outline } = look;
        Self { colour, width, opacity, dash, outlined: outline == Outline::Dark }
    }

    /// Returns the stroke with another opacity and without outline.
    #[must_use]
    pub const fn faint(self, opacity: f64) -> Self {
        Self { opacity, outlined: false, ..self }
    }
}

/// Position of a text relative to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Text starting at the point.
    Start,
    /// Text centred at the point.
    Middle,
    /// Text ending at the point.
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

/// SVG drawing. Coordinates are pixels of its background.
#[derive(Clone, Debug)]
pub struct Svg {
    size: [f64; 2],
    /// Length of a screen pixel in pixels of the background.
    pub scale: f64,
    body: String,
}

impl Svg {
    /// Returns the width and height of the background, in pixels.
    #[must_use]
    pub const fn size(&self) -> [f64; 2] {
        self.size
    }

    /// Creates an empty drawing on a background of this width and height. `scale` is the length of a screen
    /// pixel in pixels of the background.
    #[must_use]
    pub fn new(size: [f64; 2], scale: f64) -> Self {
        Self { size, scale, body: String::new() }
    }

    /// Draws a polyline; `closed` connects its end with its start.
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

    /// Draws a filled polygon without outline; `opacity` is from 0 to 1.
    pub fn fill(&mut self, points: &[[f64; 2]], colour: Rgb, opacity: f64) {
        let path = self.path(points, true);
        let _ = writeln!(self.body, r#"<path d="{path}" fill="{colour}" fill-opacity="{opacity:.3}"/>"#);
    }

    /// Draws a filled polygon that adjoins others without a visible seam; `opacity` is from 0 to 1.
    pub fn tile(&mut self, points: &[[f64; 2]], colour: Rgb, opacity: f64) {
        let path = self.path(points, true);
        let _ = writeln!(
            self.body,
            r#"<path d="{path}" fill="{colour}" fill-opacity="{opacity:.3}" shape-rendering="crispEdges"/>"#
        );
    }

    /// Draws a dot with a dark rim; `radius` is in screen pixels.
    pub fn dot(&mut self, [x, y]: [f64; 2], radius: f64, colour: Rgb) {
        let (radius, rim) = (radius * self.scale, self.scale);
        let _ = writeln!(
            self.body,
            r#"<circle cx="{x:.2}" cy="{y:.2}" r="{radius:.2}" fill="{colour}" stroke="{}" stroke-opacity="0.6" stroke-width="{rim:.2}"/>"#,
            Rgb::OUTLINE
        );
    }

    /// Draws a ring; `radius` is in screen pixels.
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

    /// Draws a text with a dark halo; the anchor is at the point, on the baseline.
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

    /// Draws a text without halo, for dark colours on a light background.
    pub(crate) fn ink(&mut self, [x, y]: [f64; 2], text: &str, colour: Rgb, anchor: Anchor) {
        let size = style::TEXT * self.scale;
        let anchor = anchor.name();
        let _ = writeln!(
            self.body,
            r#"<text x="{x:.1}" y="{y:.1}" font-size="{size:.1}" text-anchor="{anchor}" fill="{colour}">{}</text>"#,
            escape(text)
        );
    }

    /// Returns the approximate width of a text, in pixels of the background.
    pub(crate) fn text_width(&self, text: &str) -> f64 {
        style::TEXT * self.scale * TAG_LETTER * text.chars().count() as f64
    }

    /// Returns the width and height of a tag with this text, in pixels of the background.
    pub(crate) fn tag_size(&self, text: &str) -> [f64; 2] {
        let size = style::TEXT * self.scale;
        [self.text_width(text) + size, 1.6 * size]
    }

    /// Draws a tag: a text on a dark rectangle whose upper left corner is at the point.
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

    /// Returns the path data of a polyline.
    fn path(&self, points: &[[f64; 2]], closed: bool) -> String {
        // Largest coordinate of a drawn point, in pixels. Points farther away are skipped, because
        // rasterisers fail on huge numbers.
        const MAX_COORDINATE_PX: f64 = 1e5;
        let mut path = String::new();
        for [x, y] in
            points.iter().filter(|[x, y]| x.abs() < MAX_COORDINATE_PX && y.abs() < MAX_COORDINATE_PX)
        {
            let _ = write!(path, "{}{x:.2} {y:.2}", if path.is_empty() { "M" } else { "L" });
        }
        if closed && !path.is_empty() {
            path.push('Z');
        }
        path
    }

    /// Returns the drawing as an SVG element. `beneath` is SVG code that is drawn below it, for example an
    /// image.
    #[must_use]
    pub fn finish(&self, beneath: &str) -> String {
        let [w, h] = self.size;
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 {w} {h}" width="{w}" height="{h}" font-family="Ubuntu, 'Segoe UI', Roboto, 'Helvetica Neue', sans-serif">{beneath}{}</svg>"#,
            self.body
        )
    }
}

/// Escapes text for HTML and SVG.
pub(crate) fn escape(text: &str) -> String {
    // XML does not allow control characters; they become spaces.
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
