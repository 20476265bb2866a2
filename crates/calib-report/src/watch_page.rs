//! Result of drift detection, as text and with a plot for every camera.

use std::fmt::Write as _;

use calib_core::camera::PanTiltZoom;

use calib_health::{CameraHealth, Change, DriftStatus, Watch};

use calib_draw::Rgb;
use calib_site::counted;

use crate::frame::{PAGE_END, page_start};
use crate::svg::{Anchor, Stroke, Svg, escape};

/// Camera with the result of its drift detection.
#[derive(Clone, Copy, Debug)]
pub struct WatchedCamera<'a> {
    /// Id of the camera.
    pub id: &'a str,
    /// Result of its drift detection.
    pub health: &'a CameraHealth,
}

/// Function that formats a time, given in nanoseconds since 1970.
type Instant<'a> = &'a dyn Fn(i64) -> String;

/// Returns the HTML page with the result and the plot of every camera.
#[must_use]
pub fn watch_page(title: &str, cameras: &[WatchedCamera<'_>], instant: Instant<'_>) -> String {
    let mut html = page_start(title);
    html.push_str("<table><thead><tr><th>Camera<th>Status<th class=n>Tracks<th class=n>Matches with other cameras</tr></thead><tbody>\n");
    for WatchedCamera { id, health } in cameras {
        let class = if health.status == DriftStatus::Moved { " class=bad" } else { "" };
        let is_unknown = health.status == DriftStatus::CannotTell;
        let (id, status) = (escape(id), if is_unknown { "unknown" } else { health.status.name() });
        let _ = writeln!(
            html,
            "<tr{class}><td><a href=\"#{id}\">{id}</a><td>{status}<td class=n>{}<td class=n>{}</tr>",
            health.tracks, health.matches
        );
    }
    html.push_str("</tbody></table>\n");
    for WatchedCamera { id, health } in cameras {
        let id = escape(id);
        let text = escape(&watch_text(health, instant));
        let _ = writeln!(html, "<section id=\"{id}\"><h2>{id}</h2><p class=\"note\">{text}</p>");
        if let Some(plot) = plot(health, instant) {
            let _ = writeln!(html, "<figure>{}</figure>", plot.finish(PLOT_BACKGROUND));
        }
        html.push_str("</section>\n");
    }
    html.push_str(PAGE_END);
    html
}

/// Describes the result of the drift detection of a camera in one line.
#[must_use]
pub fn watch_text(health: &CameraHealth, instant: Instant<'_>) -> String {
    let tracks = counted(usize::try_from(health.tracks).unwrap_or(usize::MAX), "track", "tracks");
    match (&health.change, health.status) {
        (Some(change), _) => format!(
            "moved at {} (between {} and {}): {}; {}; {tracks}",
            instant(change.since),
            instant(change.between[0]),
            instant(change.between[1]),
            movement_text(change),
            evidence_text(change)
        ),
        (None, DriftStatus::CannotTell) => {
            format!("unknown: not enough information in {tracks}; {}", detectable_text(health))
        }
        (None, _) => format!("unchanged: {tracks}; {}", detectable_text(health)),
    }
}

/// Describes the detected movement of a camera: pan, tilt, roll and zoom with their standard deviations.
fn movement_text(change: &Change) -> String {
    let PanTiltZoom { pan, tilt, roll, zoom } = change.movement;
    let [pan_sigma, tilt_sigma, roll_sigma, zoom_sigma] = change.sigmas;
    let turn = |name: &str, by: f64, sigma: f64| {
        let (by, sigma) = (by.to_degrees(), sigma.to_degrees());
        sigma.is_finite().then(|| format!("{name} {by:+.2}\u{b0} \u{b1} {sigma:.2}\u{b0}"))
    };
    let zoom = zoom_sigma
        .is_finite()
        .then(|| format!("zoom {:+.1} % \u{b1} {:.1} %", 100.0 * zoom.exp_m1(), 100.0 * zoom_sigma));
    let parts =
        [turn("pan", pan, pan_sigma), turn("tilt", tilt, tilt_sigma), turn("roll", roll, roll_sigma), zoom];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Returns the kind of evidence for a change.
fn evidence_text(change: &Change) -> &'static str {
    match (change.is_seen_in_heights, change.is_seen_by_others) {
        (true, false) => "the apparent heights of people changed",
        (false, true) => "the positions of people contradict other cameras",
        _ => "the apparent heights of people changed, and their positions contradict other cameras",
    }
}

/// Describes the smallest detectable pan, tilt and zoom of a camera.
fn detectable_text(health: &CameraHealth) -> String {
    let [pan, tilt, _, zoom] = health.smallest_detectable;
    let pan = if pan.is_finite() && pan < 0.5 {
        format!("pan {:.1}\u{b0}, ", pan.to_degrees())
    } else {
        "pan undetectable (too few people also seen by another camera), ".into()
    };
    if !(tilt.is_finite() && zoom.is_finite()) {
        return "no change is detectable".into();
    }
    format!(
        "smallest detectable change: {pan}tilt {:.1}\u{b0}, zoom {:.0} %",
        tilt.to_degrees(),
        100.0 * zoom.exp_m1()
    )
}

/// SVG code of the background of a plot.
const PLOT_BACKGROUND: &str = r#"<rect width="1000" height="300" fill="white"/>"#;
/// Left, top, right and bottom of the plot area, in pixels of the drawing.
const PLOT_AREA_PX: [f64; 4] = [60.0, 20.0, 980.0, 250.0];
/// Largest relative difference of heights that the plot shows; larger differences are drawn at its edge.
const MAX_HEIGHT_DIFFERENCE: f64 = 0.1;

/// Draws the heights of people over time, the significance of a change at every time, and the detected
/// change.
fn plot(health: &CameraHealth, instant: Instant<'_>) -> Option<Svg> {
    let spans = health.heights.iter().map(|then| then.span);
    let first = spans.clone().map(|span| span[0]).min()?;
    let last = spans.map(|span| span[1]).max()?;
    let mut svg = Svg::new([1000.0, 300.0], 1.0);
    let [left, top, right, bottom] = PLOT_AREA_PX;
    let x = |at: i64| left + (right - left) * (at - first) as f64 / (last - first).max(1) as f64;
    let y = |height: f64| {
        0.5 * (top + bottom)
            - 0.5 * (bottom - top) * height.clamp(-MAX_HEIGHT_DIFFERENCE, MAX_HEIGHT_DIFFERENCE)
                / MAX_HEIGHT_DIFFERENCE
    };
    let ink = Stroke { outlined: false, ..Stroke::new(Rgb::INK, 1.0) };
    if let Some(change) = &health.change {
        let [low, high] = change.between.map(|at| x(at).clamp(left, right));
        svg.fill(&[[low, top], [high, top], [high, bottom], [low, bottom]], Rgb::BAD_ON_LIGHT, 0.15);
        let since = x(change.since);
        svg.line(
            &[[since, top], [since, bottom]],
            false,
            Stroke { outlined: false, ..Stroke::new(Rgb::BAD_ON_LIGHT, 2.0) },
        );
    }
    svg.line(&[[left, y(0.0)], [right, y(0.0)]], false, ink.faint(0.4));
    for then in &health.heights {
        let at = 0.5 * (x(then.span[0]) + x(then.span[1]));
        let bar = [then.height - then.sigma, then.height + then.sigma];
        svg.line(&bar.map(|end| [at, y(end)]), false, ink.faint(0.5));
        svg.line(
            &[[at - 1.5, y(then.height)], [at + 1.5, y(then.height)]],
            false,
            Stroke { width: 3.0, ..ink },
        );
    }
    let most = health.statistics.iter().map(|(_, clear)| *clear).fold(1.5 * Watch::ALARM, f64::max);
    let clear = |value: f64| bottom - (bottom - top) * value / most;
    let points: Vec<[f64; 2]> = health.statistics.iter().map(|&(at, value)| [x(at), clear(value)]).collect();
    let red = Stroke { outlined: false, ..Stroke::new(Rgb::BAD_ON_LIGHT, 1.5) };
    svg.line(&points, false, red);
    svg.line(
        &[[left, clear(Watch::ALARM)], [right, clear(Watch::ALARM)]],
        false,
        Stroke { dash: &[4.0, 4.0], ..red },
    );
    for (height, text) in
        [(MAX_HEIGHT_DIFFERENCE, "+10 %"), (0.0, "height"), (-MAX_HEIGHT_DIFFERENCE, "\u{2212}10 %")]
    {
        svg.ink([4.0, y(height) + 4.0], text, Rgb::INK, Anchor::Start);
    }
    svg.ink([left, bottom + 18.0], &instant(first), Rgb::INK, Anchor::Start);
    svg.ink([right - 150.0, bottom + 18.0], &instant(last), Rgb::INK, Anchor::Start);
    let legend = "black: relative heights of people; red: significance of a change at each time (dashed: alarm threshold)";
    svg.ink([left, bottom + 38.0], legend, Rgb::INK, Anchor::Start);
    Some(svg)
}
