//! The floor and its plan as they are shown: how far they reach, the plan's picture, how much shines through.

use calib_core::{FloorPoint, PlanPixel};
use calib_editor::plan_scale;
use egui::{Context, Id};

use super::App;
use crate::picture::Piece;

impl App {
    /// The floor that is worth looking at, in metres.
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

    /// Where the corners of the plan's picture lie on the floor.
    fn plan_corners(&self) -> Vec<FloorPoint> {
        let name = self.editor.session().site.plan.as_ref().and_then(|plan| plan.image.as_ref());
        let Some(picture) = name.and_then(|name| self.pictures.ready(name)) else { return Vec::new() };
        let [w, h] = picture.size().map(f64::from);
        let scale = plan_scale(self.editor.site());
        let corner = |[x, y]: [f64; 2]| scale.floor_from_plan(PlanPixel::new(x, y));
        [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(corner).to_vec()
    }

    /// Starts decoding of the plan.
    pub fn ask_for_plan(&mut self, ctx: &Context) {
        let name = self.editor.session().site.plan.as_ref().and_then(|plan| plan.image.clone());
        if let Some(name) = name {
            let images = &self.editor.session().images;
            self.pictures.get(ctx, &name, || images.reader(&name));
        }
    }

    /// The plan's picture, in pieces, as sharp as it is.
    pub fn plan_pieces(&mut self, ctx: &Context) -> Vec<Piece> {
        let name = self.editor.session().site.plan.as_ref().and_then(|plan| plan.image.clone());
        let Some(name) = name else { return Vec::new() };
        let images = &self.editor.session().images;
        let picture = self.pictures.get(ctx, &name, || images.reader(&name));
        picture.map(|picture| picture.pieces(ctx)).unwrap_or_default()
    }

    /// Opacity of images on the plan, remembered for every site.
    #[must_use]
    pub fn opacity(&self, ctx: &Context) -> f32 {
        ctx.data_mut(|data| data.get_persisted(self.opacity_id())).unwrap_or(0.8)
    }

    /// Sets the opacity of images on the plan.
    pub fn set_opacity(&self, ctx: &Context, opacity: f32) {
        ctx.data_mut(|data| data.insert_persisted(self.opacity_id(), opacity));
    }

    fn opacity_id(&self) -> Id {
        Id::unique(("opacity", &self.editor.session().site.name, &self.editor.session().path))
    }
}
