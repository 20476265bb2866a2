//! Report of a site: one self-contained HTML page for the customer.

use std::fmt::Write as _;

use calib_core::{Pixel, Residual, ResidualOf};

use calib_core::single::line_name;

use calib_site::{CoverageOptions, Sigmas, Site, SiteCamera, Solution, Stage};

use crate::coverage_page::CoveragePage;
use crate::frame::{PAGE_END, page_start};
use crate::measurement_section::measurement_section;
use crate::overlay::overlay;
use crate::plan_view::{BACKGROUND, PLAN_OPACITY, PlanBackground, coverage_view, plan_view};
use crate::planes::planes_section;
use crate::site_section::site_section;
use crate::summary::write_summary;
use crate::svg::{Svg, escape};
use crate::walk_page::WalkPage;
use crate::words::is_lens_estimated;
use crate::words::{scene_errors_text, straight_down_text};

/// Embedded image of the page.
#[derive(Clone, Debug)]
pub struct EmbeddedImage {
    /// URI for `href`: a `data:` URI, so that the page is complete without other files.
    pub href: String,
    /// Width and height of the image, in pixels.
    pub size: [u32; 2],
}

/// Request for an image that the page needs.
#[derive(Clone, Copy, Debug)]
pub enum ImageRequest<'a> {
    /// Image of a camera.
    Camera(&'a SiteCamera),
    /// Image of the floor plan.
    Plan,
}

/// Callback that returns a requested image, or the reason why the image is missing.
pub type ImageSource<'a> = &'a mut dyn FnMut(ImageRequest<'_>) -> Result<EmbeddedImage, String>;

/// Returns the HTML of the report: summary for customers, numbers of all cameras, site, planes, plan,
/// acceptance walk, measurements, then every camera. A missing image is replaced by the reason why it is
/// missing. `created` is the time of the report, in seconds since 1970.
#[must_use]
pub fn page(site: &Site, created: u64, walk: Option<&WalkPage<'_>>, pictures: ImageSource<'_>) -> String {
    let mut html = page_start(site.name.as_deref().unwrap_or("Camera calibration"));
    let _ = writeln!(
        html,
        "<p class=dim>Camera calibration{} \u{b7} calib {}</p>",
        date_text(created),
        env!("CARGO_PKG_VERSION")
    );
    write_summary(&mut html, site);
    write_numbers(&mut html, &site.cameras);
    site_section(&mut html, site);
    planes_section(&mut html, site);
    write_plan_section(&mut html, site, pictures);
    if let Some(walk) = walk {
        walk.section(&mut html);
    }
    measurement_section(&mut html, site);
    for camera in &site.cameras {
        write_section(&mut html, site, camera, pictures);
    }
    html.push_str(PAGE_END);
    html
}

/// Writes the site from above, and its coverage if it has areas of interest.
fn write_plan_section(html: &mut String, site: &Site, pictures: ImageSource<'_>) {
    let has_image = site.plan.as_ref().is_some_and(|plan| plan.image.is_some());
    let plan = has_image.then(|| resolve_image(html, pictures(ImageRequest::Plan))).flatten();
    if !site.cameras.iter().any(SiteCamera::is_placed) {
        return;
    }
    let sides = plan.as_ref().map(|plan| plan.size);
    let figure = plan_figure(plan.as_ref(), &plan_view(site, sides));
    let _ = write!(html, "<h2>View from above</h2><figure>{figure}</figure>");
    if site.areas.is_empty() {
        return;
    }
    match site.coverage(&CoverageOptions::default()) {
        Ok(coverage) => {
            let figure = plan_figure(plan.as_ref(), &coverage_view(site, sides, &coverage));
            CoveragePage { site, coverage: &coverage }.section(html, &figure);
        }
        Err(error) => {
            let _ = write!(html, "<h2>Coverage</h2><p class=\"note bad\">{}</p>", escape(&error.to_string()));
        }
    }
}

/// Returns the coverage of a site as a self-contained HTML page. The plan image is left out if it is missing.
#[must_use]
pub fn coverage_html(page: &CoveragePage<'_>, plan: Option<&EmbeddedImage>) -> String {
    let view = coverage_view(page.site, plan.map(|plan| plan.size), page.coverage);
    page.html(&plan_figure(plan, &view))
}

/// Returns an SVG element with a view from above on top of the plan image.
fn plan_figure(plan: Option<&EmbeddedImage>, (ground, svg): &(PlanBackground, Svg)) -> String {
    let ([w, h], [r, g, b]) = (ground.size, BACKGROUND);
    let mut beneath = format!(r#"<rect width="{w}" height="{h}" fill="rgb({r},{g},{b})"/>"#);
    if let Some(EmbeddedImage { href, size: [w, h] }) = plan.filter(|_| ground.has_image) {
        let _ = write!(
            beneath,
            r#"<rect width="{w}" height="{h}" fill="white"/><image href="{href}" width="{w}" height="{h}" opacity="{PLAN_OPACITY}"/>"#
        );
    }
    svg.finish(&beneath)
}

/// Returns the image with an escaped URI. If the image is missing, writes the reason as a note on the page.
fn resolve_image(html: &mut String, picture: Result<EmbeddedImage, String>) -> Option<EmbeddedImage> {
    let picture = picture.map_err(|why| write!(html, "<p class=\"note bad\">{}</p>", escape(&why))).ok()?;
    Some(EmbeddedImage { href: picture.href.replace('"', "&quot;"), ..picture })
}

/// Returns an SVG element with an overlay on top of its image.
fn figure(EmbeddedImage { href, size: [w, h] }: &EmbeddedImage, svg: &Svg) -> String {
    svg.finish(&format!(r#"<image href="{href}" width="{w}" height="{h}"/>"#))
}

/// Returns the date of a time in seconds since 1970, in UTC; empty for a time without a calendar date.
fn date_text(seconds: u64) -> String {
    let time = i64::try_from(seconds).ok().and_then(|seconds| jiff::Timestamp::from_second(seconds).ok());
    // The text of a time starts with its date: year, month and day.
    let date = time.map(|time| time.to_string().chars().take_while(|&c| c != 'T').collect::<String>());
    date.map_or_else(String::new, |date| format!(" \u{b7} {date}"))
}

/// Writes the table with the numbers of every camera.
fn write_numbers(html: &mut String, cameras: &[SiteCamera]) {
    html.push_str(
        "<h2>Numbers</h2><div class=wide><table><thead><tr><th>Camera<th>Stage<th class=n>Focal length, px<th class=n>Pitch<th class=n>Roll<th class=n>Yaw\
         <th class=n>x, m<th class=n>y, m<th class=n>Height, m<th class=n>Lengths on the floor<th class=n>RMS residual, px</tr></thead><tbody>\n",
    );
    for camera in cameras {
        let id = escape(&camera.id);
        let Some(solution) = &camera.solution else {
            let why = camera.error.as_ref().map_or("Not solved", |error| &error.message);
            let _ = writeln!(
                html,
                "<tr><td><a href=\"#{id}\">{id}</a><td colspan=10 class=bad>{}</tr>",
                escape(why)
            );
            continue;
        };
        let sigma = solution.sigma.as_ref();
        let placed = solution.stage >= Stage::Placed;
        let down = straight_down_text(solution);
        let own_turn = |angle: Option<f64>| angle.filter(|_| down.is_none());
        let floor = sigma
            .and_then(|s| s.floor_length_rel)
            .filter(|rel| *rel < 1.0)
            .map(|rel| format!("\u{b1} {:.1} %", 100.0 * rel));
        let cells = [
            with_sigma(Some(solution.focal_px), sigma.and_then(|s| s.focal_px), 1, ""),
            with_sigma(solution.pitch_deg, sigma.and_then(|s| s.pitch_deg), 2, "\u{b0}"),
            with_sigma(own_turn(solution.roll_deg), sigma.and_then(|s| s.roll_deg), 2, "\u{b0}"),
            with_sigma(
                own_turn(solution.yaw_deg).filter(|_| placed),
                sigma.and_then(|s| s.yaw_deg),
                2,
                "\u{b0}",
            ),
            with_sigma(solution.position_m.filter(|_| placed).map(|p| p.x), sigma.and_then(|s| s.x_m), 2, ""),
            with_sigma(solution.position_m.filter(|_| placed).map(|p| p.y), sigma.and_then(|s| s.y_m), 2, ""),
            with_sigma(solution.position_m.map(|p| p.z), sigma.and_then(|s| s.z_m), 2, ""),
            floor.unwrap_or_else(|| "\u{2013}".into()),
            solution.rms_px.map_or_else(|| "\u{2013}".into(), |rms| format!("{rms:.2}")),
        ];
        let _ = write!(html, "<tr><td><a href=\"#{id}\">{id}</a><td>{}", stage_text(solution.stage));
        for cell in cells {
            let _ = write!(html, "<td class=n>{cell}");
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody></table></div>\n");
}

/// Returns the name of a calibration stage for the reader of the report.
fn stage_text(stage: Stage) -> &'static str {
    match stage {
        Stage::Lens => "lens only",
        Stage::Partial => "not placed",
        Stage::Placed => "placed",
        Stage::Refined => "refined",
    }
}

/// Formats a value with its standard deviation and unit; a dash if the value is missing.
fn with_sigma(value: Option<f64>, sigma: Option<f64>, digits: usize, unit: &str) -> String {
    let Some(value) = value else { return "\u{2013}".into() };
    let plus_minus = sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {sigma:.digits$}"));
    format!("{value:.digits$}{plus_minus}{unit}").replace('-', "\u{2212}")
}

/// Writes the section of a camera: its image with overlay, and its results or its error.
fn write_section(html: &mut String, site: &Site, camera: &SiteCamera, pictures: ImageSource<'_>) {
    let id = escape(&camera.id);
    let name = camera.name.as_ref().map_or_else(String::new, |name| format!(" \u{2013} {}", escape(name)));
    let _ = writeln!(html, "<section id=\"{id}\"><h2>{id}{name}</h2>");
    let has_image = camera.image.is_some();
    if let Some(picture) =
        has_image.then(|| resolve_image(html, pictures(ImageRequest::Camera(camera)))).flatten()
    {
        let svg = overlay(site, camera, is_lens_estimated(camera));
        let _ = write!(html, "<figure>{}</figure>", figure(&picture, &svg));
    }
    match (&camera.solution, &camera.error) {
        (Some(solution), _) => write_details(html, site, camera, solution),
        (None, Some(error)) => {
            let _ = write!(
                html,
                "<p class=\"note bad\"><b>{}</b> {} <i>{}</i></p>",
                error.code,
                escape(&error.message),
                escape(&error.advice)
            );
        }
        (None, None) => {}
    }
    html.push_str("</section>\n");
}

/// Writes the results of a camera: pose, lens, warnings and residuals.
fn write_details(html: &mut String, site: &Site, camera: &SiteCamera, solution: &Solution) {
    for warning in &solution.warnings {
        let _ = writeln!(
            html,
            "<p class=\"note\"><b>{}</b> {} <i>{}</i></p>",
            warning.code,
            escape(&warning.message),
            escape(&warning.advice)
        );
    }
    if let Some(next) = &solution.draw_next {
        let _ = writeln!(html, "<p class=\"note\"><b>Next</b> {}</p>", escape(&next.message));
    }
    for other in &solution.alternatives {
        let _ = writeln!(
            html,
            "<p class=\"note\">Another solution fits equally well: focal length {:.0} px, field of view {:.0}\u{b0}, pitch {:.1}\u{b0} (chi-square {:.1}).</p>",
            other.focal_px, other.hfov_deg, other.pitch_deg, other.chi2
        );
    }
    if let Some(Sigmas { cx_px: Some(cx), cy_px: Some(cy), .. }) = solution.sigma {
        let Pixel { u, v } = solution.principal_point_px;
        let _ = writeln!(
            html,
            "<p class=dim>Estimated principal point: ({u:.0} \u{b1} {cx:.0}, {v:.0} \u{b1} {cy:.0}) px. The \u{b1} \
             of the focal length, pitch and heights includes the uncertainty of the principal point.</p>"
        );
    }
    if !camera.annotations.is_empty() {
        let errors = scene_errors_text(&site.scene_errors(camera));
        let _ = writeln!(html, "<p class=dim>{}.</p>", escape(&errors));
    }
    html.push_str("<table><thead><tr><th>Line or point<th class=n>Residual, px<th></tr></thead><tbody>\n");
    let sigma = solution.sigma_px.unwrap_or(1.0);
    for residual in &solution.residuals {
        let sigma = own_sigma(site, camera, residual).unwrap_or(sigma);
        let class = if residual.outlier || residual.px.abs() > 3.0 * sigma { " class=bad" } else { "" };
        let note = if residual.outlier { "rejected" } else { "" };
        let _ = writeln!(
            html,
            "<tr{class}><td>{}<td class=n>{:.2}<td>{note}</tr>",
            residual_label(camera, residual),
            residual.px.abs()
        );
    }
    html.push_str("</tbody></table>\n");
}

/// Returns the standard deviation in pixels that was entered for the control point or link of a residual, if
/// any.
fn own_sigma(site: &Site, camera: &SiteCamera, residual: &Residual) -> Option<f64> {
    let id = residual.id.as_ref()?;
    match residual.of {
        ResidualOf::ControlPoint => {
            camera.control_points.iter().find(|point| point.id.as_ref() == Some(id))?.sigma_px
        }
        ResidualOf::Link => {
            let link = site.links.iter().find(|link| link.id.as_ref() == Some(id))?;
            link.seen.iter().find(|seen| seen.camera == camera.id)?.sigma_px
        }
        _ => None,
    }
}

/// Returns the name of the annotation, control point, link or mark of a residual, as HTML.
fn residual_label(camera: &SiteCamera, residual: &Residual) -> String {
    match (residual.of, residual.annotation) {
        (ResidualOf::Annotation, Some(index)) => {
            let annotation = camera.annotations.get(index).map_or_else(String::new, |a| a.label(index));
            let name = line_name(&camera.annotations, index, residual.segment.unwrap_or(0));
            format!("{name} {}", escape(&annotation))
        }
        (ResidualOf::ControlPoint, _) => {
            format!("Control point {}", escape(residual.id.as_deref().unwrap_or("")))
        }
        (ResidualOf::Link, _) => format!("Link {}", escape(residual.id.as_deref().unwrap_or(""))),
        _ => format!("Mark {}", escape(residual.id.as_deref().unwrap_or(""))),
    }
}
