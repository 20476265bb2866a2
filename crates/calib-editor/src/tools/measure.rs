//! Tool that measures lengths, heights, areas and speeds in the images. On the plan, the operator clicks two points
//! and enters their distance in the panel, which determines the scale of the plan.
//!
//! Also the tool that draws the region of a plane other than the floor, corner by corner.

use calib_core::{FloorPoint, Pixel};
use calib_image::CameraChange;
use calib_site::{Measurement, MeasurementKind, MeasurementPoint};

use crate::newer::{image_time, nanoseconds};
use crate::planes::{add_plane, set_region};
use crate::session::{RulerSettings, Session};
use crate::tools::corners::Corners;
use crate::tools::{Pane, Phase, Pointer, Tool, plan_scale};

/// Tool that measures between points of the images, or selects two points of the plan, whose distance the
/// operator enters.
#[derive(Debug, Default)]
pub(super) struct Measure {
    from: Option<[f64; 2]>,
    to: Option<[f64; 2]>,
    /// Points of the measurement in progress in the images; the last one follows the pointer.
    clicks: Vec<RulerClick>,
    /// Image in which the button was pressed last. A release on the same camera belongs to this image, even if a newer
    /// one is shown by then. `None` if the press was refused.
    pressed: Option<RulerImage>,
}

/// Image in which a point was clicked.
#[derive(Clone, Debug, PartialEq)]
struct RulerImage {
    /// Index of the camera.
    camera: usize,
    /// Name of the newer image, if the click was on it.
    newer: Option<String>,
    /// Capture time in the EXIF data of the image (RFC 3339).
    captured: Option<String>,
}

/// Click of a measurement.
#[derive(Clone, Debug)]
struct RulerClick {
    image: RulerImage,
    /// Raw pixel.
    pixel: Pixel,
}

/// Source of the time of an image. Both times of a speed have the same source, because clocks differ.
#[derive(Clone, Copy, Debug, PartialEq)]
enum TimeSource {
    /// Name of the image.
    Name,
    /// EXIF data.
    Exif,
}

impl RulerClick {
    /// Returns the capture time of the image (RFC 3339). `None` if it is unknown, or if this camera entry is not
    /// valid at that time.
    fn time(&self, session: &Session, source: TimeSource) -> Option<String> {
        let entry = session.site.cameras.get(self.image.camera)?;
        let time = match source {
            TimeSource::Name => image_time(session, self.image.newer.as_ref().or(entry.image.as_ref())?)?,
            TimeSource::Exif => self.image.captured.clone()?,
        };
        let found = session.site.camera_at(&entry.id, Some(&time)).ok()?;
        std::ptr::eq(found, entry).then_some(time)
    }
}

impl Measure {
    /// Processes an event in an image. The points may be in different images.
    fn measure(&mut self, session: &mut Session, (camera, pixel): (usize, Pixel), pointer: &Pointer) {
        let newer = pointer.newer.as_ref().map(|newer| newer.image.clone());
        let shown = RulerImage { camera, newer, captured: pointer.captured.clone() };
        if pointer.phase == Phase::Press {
            let refusal = pointer.newer.as_ref().and_then(|newer| refusal(newer.change));
            self.pressed = refusal.is_none().then(|| shown.clone());
            if let Some(refusal) = refusal {
                let id = session.site.cameras.get(camera).map_or("", |entry| &entry.id);
                session.note = Some(format!("{id}: {refusal}"));
                return;
            }
        }
        let image = match pointer.phase {
            Phase::Drag | Phase::Release => {
                let Some(pressed) = &self.pressed else { return };
                // A drag ends in another camera's image, or in the image in which it began.
                if pressed.camera == camera { pressed.clone() } else { shown }
            }
            Phase::Hover | Phase::Press => shown,
        };
        let click = RulerClick { image, pixel };
        let Some(last) = self.clicks.last_mut() else {
            // The second press of a double click starts no new measurement.
            if pointer.phase == Phase::Press && !pointer.double {
                (self.from, self.to) = (None, None);
                session.select_camera(camera);
                self.clicks = vec![click.clone(), click];
            }
            return;
        };
        *last = click;
        if pointer.phase == Phase::Release {
            self.release(session, pointer);
        }
    }

    /// Sets the point that follows the pointer, and finishes a measurement that has all its points.
    fn release(&mut self, session: &mut Session, pointer: &Pointer) {
        /// Smallest distance of two points in one image, in raw pixels.
        const MIN_DISTANCE_PX: f64 = 2.0;
        let [.., before, last] = &self.clicks[..] else { return };
        let set = self.clicks.len() - 1;
        let is_first_click = set == 1 && !pointer.moved && before.image == last.image;
        if is_first_click && before.pixel.distance(last.pixel) <= 0.5 * pointer.radius {
            return;
        }
        let kind = self.kind(session, pointer);
        if kind == MeasurementKind::Height && before.image != last.image {
            session.note = Some("The upper end must be in the same image as the lower end.".into());
            return;
        }
        if kind != MeasurementKind::Area {
            let is_short = before.image == last.image && before.pixel.distance(last.pixel) < MIN_DISTANCE_PX;
            if is_short {
                self.clicks.clear();
            } else {
                self.finish(session, kind);
            }
            return;
        }
        let first = &self.clicks[0];
        let closes = first.image == last.image && first.pixel.distance(last.pixel) <= pointer.radius;
        if set >= 3 && (closes || pointer.double) {
            self.clicks.pop();
            self.finish(session, kind);
        } else if before.image != last.image || before.pixel.distance(last.pixel) >= MIN_DISTANCE_PX {
            self.clicks.push(last.clone());
        }
    }

    /// Returns the quantity of the measurement in progress. Shift turns a length into a height.
    fn kind(&self, session: &Session, pointer: &Pointer) -> MeasurementKind {
        match session.tool.ruler.kind {
            MeasurementKind::Length if pointer.modifiers.shift => MeasurementKind::Height,
            kind => kind,
        }
    }

    /// Adds the measurement of the clicked points to the site. The points of a speed are in the order of their times.
    fn finish(&mut self, session: &mut Session, kind: MeasurementKind) {
        let mut clicks = std::mem::take(&mut self.clicks);
        let is_speed = kind == MeasurementKind::Speed;
        let times_by = |clicks: &[RulerClick], source: TimeSource| -> Vec<Option<String>> {
            clicks.iter().map(|click| click.time(session, source)).collect()
        };
        let times_of = |clicks: &[RulerClick]| {
            let by_name = times_by(clicks, TimeSource::Name);
            let is_named = by_name.iter().all(Option::is_some);
            if is_named { by_name } else { times_by(clicks, TimeSource::Exif) }
        };
        let instant = |time: Option<&Option<String>>| nanoseconds(time?.as_ref()?);
        let mut times = times_of(&clicks);
        if is_speed && instant(times.first()) > instant(times.last()) {
            clicks.reverse();
            times.reverse();
        }
        let has_times =
            is_speed && times.iter().all(Option::is_some) && instant(times.first()) != instant(times.last());
        let periods: Vec<Option<String>> =
            clicks.iter().zip(&times).map(|(click, time)| period_time(session, click, time)).collect();
        if is_speed && !has_times && periods.first() != periods.last() {
            let what = "The two points belong to different calibrations. For a speed between them, the file \
                        names or EXIF data of both images must contain the time to the second.";
            session.note = Some(what.into());
            return;
        }
        let height = Some(session.tool.ruler.height).filter(|height| *height != 0.0);
        let points = clicks.iter().zip(times.into_iter().zip(periods)).enumerate();
        let points: Vec<MeasurementPoint> = points
            .filter_map(|(index, (click, (time, period)))| {
                let entry = session.site.cameras.get(click.image.camera)?;
                let is_head = kind == MeasurementKind::Height && index > 0;
                Some(MeasurementPoint {
                    at: time.filter(|_| has_times).or(period),
                    height_m: height.filter(|_| !is_head),
                    ..MeasurementPoint::new(entry.id.clone(), click.pixel)
                })
            })
            .collect();
        session.site.measurements.push(Measurement::new(kind, points));
        session.commit(format!(
            "measure {} {}",
            if kind == MeasurementKind::Area { "an" } else { "a" },
            kind.name()
        ));
        if is_speed && !has_times {
            let what = "Enter the time between the points, in seconds, in the Measurements panel.";
            session.note = Some(what.into());
        }
    }
}

/// Returns a time (RFC 3339) in the calibration period of a click, by which the site file refers to the period.
/// `None` if the camera has only one period, or if no such time is known.
fn period_time(session: &Session, click: &RulerClick, time: &Option<String>) -> Option<String> {
    let entry = session.site.cameras.get(click.image.camera)?;
    let is_period = session.site.cameras.iter().filter(|other| other.id == entry.id).count() > 1;
    entry.valid_from.clone().or_else(|| time.clone()).filter(|_| is_period)
}

/// Returns why measurements in the newer image of a camera with this change are refused; `None` if they are allowed.
const fn refusal(change: CameraChange) -> Option<&'static str> {
    match change {
        CameraChange::Unchanged => None,
        CameraChange::Moved => Some(
            "the camera has moved since its calibration. Recover it before you measure in the newer image.",
        ),
        CameraChange::Windowed => Some(
            "zoom, crop or resolution have changed. Recover the camera before you measure in the newer image.",
        ),
        CameraChange::Shifted => {
            Some("the camera is at another position. Calibrate it with the newer image to measure in it.")
        }
        CameraChange::DifferentView => {
            Some("the newer image shows another view. Calibrate it as another camera to measure in it.")
        }
        CameraChange::TooDark | CameraChange::Blind | CameraChange::TooFewEdges => Some(
            "it is unknown whether the camera has moved since its calibration. Measure in the calibrated image.",
        ),
    }
}

impl Tool for Measure {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if let Some(pixel) = pointer.pixel() {
            self.measure(session, pixel, pointer);
            return;
        }
        match (self.from, pointer.phase) {
            (None, Phase::Press) => {
                self.clicks.clear();
                (self.from, self.to) = (Some(pointer.at), Some(pointer.at));
            }
            (Some(from), Phase::Release) => {
                let far = (from[0] - pointer.at[0]).hypot(from[1] - pointer.at[1]);
                if far > pointer.radius {
                    let scale = plan_scale(&session.site);
                    session.tool.measured =
                        Some([from, pointer.at].map(|at| scale.plan_from_floor(at.into())));
                    let what = "In the panel on the right, enter the distance between the two points.";
                    session.note = Some(what.into());
                    self.cancel();
                }
            }
            (Some(_), _) => self.to = Some(pointer.at),
            _ => {}
        }
    }

    fn accept(&mut self, session: &mut Session) {
        if self.clicks.is_empty() || session.tool.ruler.kind != MeasurementKind::Area {
            return;
        }
        if self.clicks.len() < 4 {
            session.note = Some("Click at least three corners.".into());
            return;
        }
        self.clicks.pop();
        self.finish(session, MeasurementKind::Area);
    }

    fn step_back(&mut self, _session: &mut Session) -> bool {
        let Some(end) = self.clicks.pop() else { return false };
        self.clicks.pop();
        if !self.clicks.is_empty() {
            self.clicks.push(end);
        }
        true
    }

    fn cancel(&mut self) {
        *self = Self::default();
    }

    fn is_idle(&self) -> bool {
        self.from.is_none() && self.clicks.is_empty()
    }

    fn hint(&self, session: &Session) -> String {
        let RulerSettings { kind, height } = session.tool.ruler;
        let (set, where_to) = (self.clicks.len().saturating_sub(1), place_text(session, height));
        match (self.from, session.tool.measured) {
            _ if set > 0 => match kind {
                MeasurementKind::Length => {
                    "Click the other end, in this or another image.  Shift: measure a height".into()
                }
                MeasurementKind::Height => "Click the upper end, vertically above the lower end.".into(),
                MeasurementKind::Speed => {
                    "Click the same point of the object at the other time, in this or another image.".into()
                }
                MeasurementKind::Area if set < 3 => "Click the next corner.  Backspace: remove the last corner".into(),
                MeasurementKind::Area => {
                    "Click the next corner, or the first one to close.  Enter: finish  Backspace: remove the last corner"
                        .into()
                }
            },
            (Some(_), _) => "Click the other end of the known distance.".into(),
            (None, Some(_)) => "Enter the distance in the panel on the right, or measure again.".into(),
            (None, None) => match kind {
                MeasurementKind::Length => format!(
                    "Click two points {where_to} in the images, or two points on the plan whose distance \
                     you know."
                ),
                MeasurementKind::Height => format!("Click the lower end {where_to}, then the upper end."),
                MeasurementKind::Area => format!("Click the corners of the area {where_to} in the images."),
                MeasurementKind::Speed => format!("Click a point of the moving object, {where_to}, at the earlier time."),
            },
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        let in_image = self.clicks.last().map(|click| (Pane::Image(click.image.camera), click.pixel.into()));
        in_image.or_else(|| self.to.map(|to| (Pane::Plan, to)))
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        match (pane, self.from, self.to) {
            (Pane::Plan, Some(from), Some(to)) => vec![vec![from, to]],
            (Pane::Image(camera), ..) => {
                let pairs = self.clicks.windows(2);
                let own = pairs.filter(|pair| pair.iter().all(|click| click.image.camera == camera));
                own.map(|pair| pair.iter().map(|click| click.pixel.into()).collect()).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// Describes the location of the points of a measurement: on the floor, or `height` metres above it.
fn place_text(session: &Session, height: f64) -> String {
    if height == 0.0 {
        return "on the floor".into();
    }
    format!("{} above the floor", session.site.units.trimmed_length(height))
}

/// Tool that draws the region of the selected plane, or of a new one.
#[derive(Debug, Default)]
pub(super) struct Region {
    corners: Corners,
    is_done: bool,
}

impl Region {
    /// Writes the unfinished region into the site, and returns the index of its plane. `None` with fewer than
    /// three corners.
    fn show(session: &mut Session, corners: &[FloorPoint]) -> Option<usize> {
        session.revert();
        if corners.len() < 3 {
            return None;
        }
        let chosen = session.tool.plane.filter(|&plane| plane < session.site.planes.len());
        let index = chosen.unwrap_or_else(|| add_plane(&mut session.site));
        set_region(&mut session.site.planes[index], corners.to_vec());
        Some(index)
    }

    /// Finishes the region without the corner that follows the pointer. Fewer than three corners are
    /// discarded.
    fn finish(&mut self, session: &mut Session) {
        let corners = self.corners.take();
        let Some(index) = Self::show(session, &corners) else {
            session.note = Some("Click at least three corners.".into());
            return;
        };
        let name = format!("draw the region of {}", session.site.planes[index].id);
        session.tool.plane = Some(index);
        session.commit(name);
        self.is_done = true;
    }
}

impl Tool for Region {
    fn pointer(&mut self, session: &mut Session, pointer: &Pointer) {
        if pointer.pane != Pane::Plan {
            return;
        }
        if self.corners.follow(pointer.at.into(), pointer, 3).is_some() {
            self.finish(session);
        } else if !self.corners.is_empty() {
            Self::show(session, self.corners.all());
        }
    }

    fn accept(&mut self, session: &mut Session) {
        if !self.corners.is_empty() {
            self.finish(session);
        }
    }

    fn step_back(&mut self, session: &mut Session) -> bool {
        let has_gesture = self.corners.step_back();
        if has_gesture {
            Self::show(session, self.corners.all());
        }
        has_gesture
    }

    fn cancel(&mut self) {
        self.corners.clear();
    }

    fn is_idle(&self) -> bool {
        self.corners.is_empty()
    }

    fn is_done(&self) -> bool {
        self.is_done
    }

    fn hint(&self, session: &Session) -> String {
        let plane = session.tool.plane.and_then(|plane| session.site.planes.get(plane));
        let of = plane.map_or("a new plane", |plane| plane.id.as_str());
        match 3_usize.saturating_sub(self.corners.set()) {
            _ if self.corners.is_empty() => format!("Click the corners of {of} on the plan."),
            0 => "Click the next corner, or the first one to close.  Enter: close".into(),
            left => format!("Click the next corner; {left} more needed."),
        }
    }

    fn dragged_point(&self) -> Option<(Pane, [f64; 2])> {
        self.corners.dragged_point()
    }

    fn preview_lines(&self, pane: Pane) -> Vec<Vec<[f64; 2]>> {
        self.corners.preview_lines(pane)
    }
}
