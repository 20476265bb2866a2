//! Background work: reading images, detecting edges, automatic calibration, refinement. Also the plan image
//! and its extent.

use std::sync::Arc;

use calib_core::{FloorPoint, PlanPixel};
use calib_editor::{Action, AutomaticResult, plan_scale};
use calib_site::SiteCamera;
use egui::{Context, Id};

use crate::canvas::Mapping;
use crate::detail::Visible;
use crate::drawing::plan_view;
use crate::edges::Proposing;
use crate::edges::Refining;
use crate::picture::{Picture, Piece, picture_key};
use crate::state::App;

impl App {
    /// Returns the number of chosen files that are not read yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.jobs.adding.len()
            + usize::from(self.jobs.replacing.is_some())
            + usize::from(self.jobs.planning.is_some())
    }

    /// Whether any background work is running.
    #[must_use]
    pub fn is_working(&self) -> bool {
        self.waiting() > 0
            || self.jobs.refining.is_some()
            || self.jobs.proposing.is_some()
            || self.jobs.automatic.is_some()
            || self.is_comparing()
            || self.pictures.loading() > 0
            || self.edges.pending() > 0
    }

    /// Whether running work or an open file chooser can change the site when it ends.
    pub(crate) fn awaits(&self) -> bool {
        self.waiting() > 0
            || self.dialogs.dialog.is_some()
            || self.jobs.refining.is_some()
            || self.jobs.proposing.is_some()
            || self.jobs.automatic.is_some()
            || self.is_comparing()
            || !self.jobs.arriving.is_empty()
    }

    /// Cancels the first running work in this order: refinement, automatic calibration, comparisons and recovery,
    /// reading and edge detection.
    pub fn stop_work(&mut self) {
        if self.jobs.refining.take().is_some() {
            self.act(Action::Note("Refinement cancelled. No camera pose was changed.".into()));
            return;
        }
        if self.jobs.proposing.take().is_some() {
            self.act(Action::Note("Automatic calibration cancelled. No lines were added.".into()));
            return;
        }
        if self.jobs.automatic.is_some() {
            self.stop_automatic();
            return;
        }
        if self.is_comparing() {
            let note = if self.jobs.recovering.is_some() {
                "Recovery cancelled. No camera was changed."
            } else {
                "Comparison cancelled. The remaining newer images were not compared."
            };
            self.stop_comparing();
            self.act(Action::Note(note.into()));
            return;
        }
        let count = self.waiting();
        self.jobs.adding.clear();
        self.jobs.importing.clear();
        (self.jobs.replacing, self.jobs.planning) = (None, None);
        self.pictures.stop();
        self.edges.stop();
        self.act(Action::Note(match count {
            0 => "Cancelled. Use \u{201c}Reload images and detect edges again\u{201d} to continue.".into(),
            1 => "Cancelled. One file was not read. Add it again if needed.".into(),
            count => format!("Cancelled. {count} files were not read. Add them again if needed."),
        }));
    }

    /// Starts the joint refinement of all cameras.
    pub(crate) fn refine(&mut self, ctx: &Context) {
        if self.jobs.refining.is_none() {
            self.jobs.refining = Some(Refining::begin(ctx, self.editor.site()));
        }
    }

    /// Returns the indices of the cameras with an image, but without annotations and calibration.
    pub(crate) fn blank_cameras(&self) -> impl Iterator<Item = usize> {
        let session = self.editor.session();
        let is_blank = |(index, camera): &(usize, &SiteCamera)| {
            camera.annotations.is_empty() && camera.image.is_some() && session.solved.pose(*index).is_none()
        };
        session.site.cameras.iter().enumerate().filter(is_blank).map(|(index, _)| index)
    }

    /// Starts the automatic calibration of the current image.
    pub(crate) fn propose(&mut self) {
        if self.jobs.automatic.is_some() {
            let note =
                "All images are being calibrated. Wait for the result, or cancel the calibration first.";
            return self.act(Action::Note(note.into()));
        }
        let session = self.editor.session();
        let Some(entry) = session.entry() else { return };
        let (Some(camera), Some(image)) = (session.without_annotations(session.camera), entry.image.clone())
        else {
            let note = format!(
                "{} has no image. Choose \u{201c}Replace the image of this camera\u{201d}.",
                entry.id
            );
            return self.act(Action::Note(note));
        };
        self.act(Action::CancelGesture);
        self.jobs.proposing = Some(Proposing::new(camera, image));
    }

    pub(crate) fn poll_proposing(&mut self, ctx: &Context) {
        let Some(mut proposing) = self.jobs.proposing.take() else { return };
        let of = proposing.of();
        let camera = of.camera.clone();
        let is_asked =
            |entry: &SiteCamera| of.matches(entry) && entry.image.as_deref() == Some(proposing.image());
        // The result is dropped if its camera was removed or has another image now.
        if !self.editor.site().cameras.iter().any(is_asked) {
            return;
        }
        if let Some(error) = self.pictures.error(proposing.image()) {
            let error = format!(
                "Automatic calibration of {camera} failed because the image could not be read: {error}"
            );
            return self.act(Action::AddError(error));
        }
        let picture = self.pictures.ready(proposing.image()).map(|picture| Arc::clone(&picture.image));
        match proposing.poll(ctx, picture.as_ref()) {
            Some(Ok(proposal)) => {
                self.act(Action::Automatic(AutomaticResult::Calibration(of, Box::new(proposal))));
            }
            Some(Err(error)) => {
                self.act(Action::AddError(format!("Automatic calibration of {camera} failed: {error}.")));
            }
            None => self.jobs.proposing = Some(proposing),
        }
    }

    pub(crate) fn poll_refining(&mut self) {
        let Some(refining) = self.jobs.refining.take() else { return };
        match refining.poll() {
            Some(Ok(refined)) => self.act(Action::Refined(Box::new((refining.from.clone(), refined)))),
            Some(Err(error)) => self.act(Action::AddError(format!("The refinement failed: {error}."))),
            None => self.jobs.refining = Some(refining),
        }
    }
}

impl App {
    /// Returns the bounds of the floor that the plan canvas shows, in metres.
    #[must_use]
    pub fn floor_bounds(&self) -> [[f64; 2]; 2] {
        let session = self.editor.session();
        let count = session.site.cameras.len();
        let fields = (0..count).filter_map(|i| session.solved.solution(i)).flat_map(|s| &s.efov_m);
        let feet = (0..count).filter_map(|i| session.solved.pose(i)).map(|pose| pose.position.on_floor());
        let points: Vec<[f64; 2]> =
            fields.copied().chain(feet).chain(self.plan_corners()).map(Into::into).collect();
        if points.is_empty() {
            return [[-5.0, -2.0], [5.0, 10.0]];
        }
        let low = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let margin = 0.06 * (high(0) - low(0)).hypot(high(1) - low(1));
        [[low(0) - margin, low(1) - margin], [high(0) + margin, high(1) + margin]]
    }

    /// Returns the floor positions of the corners of the plan image; empty until the image is decoded.
    fn plan_corners(&self) -> Vec<FloorPoint> {
        let Some(picture) = self.plan_picture() else { return Vec::new() };
        let [w, h] = picture.size().map(f64::from);
        let scale = plan_scale(self.editor.site());
        let corner = |[x, y]: [f64; 2]| scale.floor_from_plan(PlanPixel::new(x, y));
        [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(corner).to_vec()
    }

    /// Starts decoding the plan image.
    pub fn ask_for_plan(&mut self, ctx: &Context) {
        self.loaded_plan(ctx);
    }

    /// Returns the plan image if it is already decoded.
    #[must_use]
    pub fn plan_picture(&self) -> Option<&Picture> {
        self.pictures.ready(&picture_key(self.editor.site().plan.as_ref()?)?)
    }

    /// Returns the reason why the plan image cannot be shown.
    #[must_use]
    pub fn plan_error(&self) -> Option<String> {
        let key = picture_key(self.editor.site().plan.as_ref()?)?;
        self.pictures.error(&key).map(str::to_owned)
    }

    /// Returns the plan image once it is decoded; the first call starts the decoding.
    pub(super) fn loaded_plan(&mut self, ctx: &Context) -> Option<&mut Picture> {
        let session = self.editor.session();
        let plan = session.site.plan.as_ref()?;
        let name = plan.image.as_ref()?;
        let part = || (session.images.reader(name), plan_view(plan));
        self.pictures.get_part(ctx, &picture_key(plan)?, part)
    }

    /// Returns the plan image as texture tiles, for the part of the floor that a canvas shows.
    pub fn plan_pieces(&mut self, ctx: &Context, mapping: &Mapping) -> Vec<Piece> {
        let scale = plan_scale(self.editor.site());
        let rect = mapping.rect;
        let corners = [rect.left_top(), rect.right_top(), rect.left_bottom(), rect.right_bottom()];
        let corners = corners.map(|at| {
            let [x, y] = mapping.document(at);
            scale.plan_from_floor(FloorPoint::new(x, y))
        });
        let bound = |pick: fn(f64, f64) -> f64, start: f64| {
            [corners.iter().fold(start, |a, p| pick(a, p.x)), corners.iter().fold(start, |a, p| pick(a, p.y))]
        };
        let visible = Visible {
            corners: [bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY)],
            zoom: mapping.view.zoom * scale.metres_per_px * f64::from(ctx.pixels_per_point()),
        };
        self.loaded_plan(ctx).map(|picture| picture.pieces_of_plan(ctx, visible)).unwrap_or_default()
    }

    /// Returns the opacity of projected images on the plan, 0 to 1; the opacity is stored for each site.
    #[must_use]
    pub fn opacity(&self, ctx: &Context) -> f32 {
        ctx.data_mut(|data| data.get_persisted(self.opacity_id())).unwrap_or(0.8)
    }

    /// Sets the opacity of projected images on the plan, 0 to 1.
    pub fn set_opacity(&self, ctx: &Context, opacity: f32) {
        ctx.data_mut(|data| data.insert_persisted(self.opacity_id(), opacity));
    }

    fn opacity_id(&self) -> Id {
        Id::unique(("opacity", &self.editor.session().site.name, &self.editor.session().path))
    }
}
