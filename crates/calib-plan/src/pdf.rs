//! Pages of PDF documents.

use std::sync::Arc;

use hayro_svg::hayro_interpret::font::GlyphRun;
use hayro_svg::hayro_interpret::hayro_cmap::BfString;
use hayro_svg::hayro_interpret::{
    BlendMode, ClipPath, Context, Device, DrawMode, DrawProps, Image, ImageDrawProps, InterpreterCache,
    InterpreterSettings, SoftMask, interpret_page,
};
use hayro_svg::hayro_syntax::page::Page;
use hayro_svg::hayro_syntax::{LoadPdfError, Pdf};
use hayro_svg::{RenderCache, SvgRenderSettings};
use kurbo::{Affine, BezPath, Rect};

use crate::drawing::{Drawing, DrawingFacts, DrawingKind, Picture, ScaleSource};
use crate::error::PlanError;
use crate::guard::guarded;
use crate::scale::denominators;

/// Resolution of a page, in pixels per inch.
const PIXELS_PER_INCH: f64 = 150.0;
/// Largest side of a page, in pixels. A0 has 7,022 pixels at the resolution above.
const MAX_SIDE: f64 = 6144.0;
/// Points of a PDF per inch, for a user unit of 1.
const POINTS_PER_INCH: f64 = 72.0;
/// Length of an inch, in metres.
const METRES_PER_INCH: f64 = 0.0254;
/// Largest text of a page that is searched for a scale, in bytes.
const MAX_TEXT_BYTES: usize = 1 << 20;

/// Reads the page with the number `page` of a document; the first page has the number 1.
pub(crate) fn read(bytes: &[u8], page: u32) -> Result<Drawing, PlanError> {
    let bytes = bytes.to_vec();
    guarded("PDF", move || read_page(bytes, page))
}

fn damaged(reason: &str) -> PlanError {
    PlanError::Damaged { kind: "PDF", reason: reason.into() }
}

fn read_page(bytes: Vec<u8>, number: u32) -> Result<Drawing, PlanError> {
    let pdf = Pdf::new(Arc::new(bytes)).map_err(|error| match error {
        LoadPdfError::Decryption(_) => PlanError::Password,
        LoadPdfError::Invalid => damaged("it is not a valid PDF"),
    })?;
    let pages = pdf.pages();
    let index = number.checked_sub(1).and_then(|index| usize::try_from(index).ok());
    let page = index
        .and_then(|index| pages.get(index))
        .ok_or(PlanError::Page { page: number, pages: pages.len() })?;
    let user_unit =
        page.raw().get::<f64>(b"UserUnit").filter(|unit| (1e-3..1e6).contains(unit)).unwrap_or(1.0);
    let (width, height) = page.render_dimensions();
    let points = [width, height].map(f64::from);
    let longer = points[0].max(points[1]);
    if !(points[0].min(points[1]) >= 1e-3 * longer && longer.is_finite()) {
        return Err(damaged("the page has no size"));
    }
    let pixels_per_point = (PIXELS_PER_INCH * user_unit / POINTS_PER_INCH).min(MAX_SIDE / longer);
    let paper_metres_per_px = METRES_PER_INCH * user_unit / (POINTS_PER_INCH * pixels_per_point);
    let scales_in_text = denominators(&text_of(page));
    let scale = match scales_in_text[..] {
        [only] => Some(only),
        _ => None,
    };
    let size = points.map(|side| (side * pixels_per_point).round().max(1.0) as u32);
    let facts = DrawingFacts {
        paper_metres_per_px: Some(paper_metres_per_px),
        metres_per_px: scale.map(|scale| paper_metres_per_px * f64::from(scale)),
        scale_source: scale.map(ScaleSource::Text),
        scales_in_text,
        pages: pages.len(),
        ..DrawingFacts::new(DrawingKind::Pdf, size)
    };
    Ok(Drawing { picture: Picture::Svg(document(page)), facts })
}

/// Returns the SVG document of a page, on white.
fn document(page: &Page<'_>) -> String {
    let settings = SvgRenderSettings { bg_color: [255; 4] };
    hayro_svg::convert(page, &RenderCache::new(), &InterpreterSettings::default(), &settings)
}

/// Returns the texts of a page in the order in which the page draws them.
fn text_of(page: &Page<'_>) -> String {
    let cache = InterpreterCache::new();
    let target = Rect::new(0.0, 0.0, 1e4, 1e4);
    let mut context =
        Context::new(Affine::IDENTITY, target, &cache, page.xref(), InterpreterSettings::default());
    let mut text = PageText::default();
    interpret_page(page, &mut context, &mut text);
    text.text
}

/// Device that collects the texts of a page instead of drawing.
#[derive(Default)]
struct PageText {
    text: String,
    /// Whether the last run has a single character. Programs write some texts character by character.
    ends_with_single: bool,
}

impl<'a> Device<'a> for PageText {
    fn draw_path(&mut self, _: &BezPath, _: DrawProps<'a>, _: &DrawMode) {}

    fn push_clip_path(&mut self, _: &ClipPath) {}

    fn push_transparency_group(&mut self, _: f32, _: Option<SoftMask<'a>>, _: BlendMode) {}

    fn draw_glyph_run(&mut self, run: &GlyphRun<'_, 'a>, _: DrawProps<'a>, _: &DrawMode) {
        if self.text.len() > MAX_TEXT_BYTES {
            return;
        }
        let glyphs = run.glyphs();
        let is_single = glyphs.len() == 1;
        if !(is_single && self.ends_with_single) {
            self.text.push(' ');
        }
        self.ends_with_single = is_single;
        for glyph in glyphs {
            match glyph.as_unicode() {
                Some(BfString::Char(c)) => self.text.push(c),
                Some(BfString::String(text)) => self.text.push_str(&text),
                None => self.text.push('\u{fffd}'),
            }
        }
    }

    fn draw_image(&mut self, _: Image<'a, '_>, _: ImageDrawProps<'a>) {}

    fn pop_clip(&mut self) {}

    fn pop_transparency_group(&mut self) {}
}
