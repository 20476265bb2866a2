//! From where the scene is looked at: turned, moved and zoomed by the pointer.

use calib_core::{FloorPoint, WorldPoint};
use calib_editor::Session;
use egui::{Pos2, Rect, Vec2};

/// From where the scene is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// The point in the middle, in metres.
    pub target: [f64; 3],
    /// Distance from it, in metres.
    pub distance: f64,
    /// Turn about the vertical, in radians.
    pub yaw: f64,
    /// Above the floor, in radians.
    pub pitch: f64,
}

/// Nearer than this to the eye nothing is drawn, in metres.
pub(crate) const NEAR: f64 = 0.05;

impl Orbit {
    /// Sees the whole site.
    #[must_use]
    pub fn of(session: &Session) -> Self {
        let count = session.site.cameras.len();
        let points: Vec<FloorPoint> = (0..count)
            .filter_map(|i| session.solved.solution(i))
            .flat_map(|solution| solution.efov_m.iter().copied())
            .chain((0..count).filter_map(|i| session.solved.pose(i)).map(|pose| pose.position.on_floor()))
            .collect();
        let range = |of: fn(&FloorPoint) -> f64| {
            let values = || points.iter().map(of);
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
        };
        let ((x0, x1), (y0, y1)) = (range(|p| p.x), range(|p| p.y));
        if points.is_empty() {
            return Self { target: [0.0, 4.0, 0.0], distance: 15.0, yaw: 0.5, pitch: 0.6 };
        }
        let target = [0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5];
        Self { target, distance: 1.1 * (x1 - x0).hypot(y1 - y0).clamp(3.0, 500.0), yaw: 0.5, pitch: 0.7 }
    }

    fn axes(&self) -> [[f64; 3]; 3] {
        let ((sy, cy), (sp, cp)) = (self.yaw.sin_cos(), self.pitch.sin_cos());
        [[cy, sy, 0.0], [sy * sp, -cy * sp, -cp], [-sy * cp, cy * cp, -sp]]
    }

    /// Right, down and forward of a point as the eye has it, in metres.
    pub(crate) fn seen(&self, point: WorldPoint) -> [f64; 3] {
        let by = [point.x - self.target[0], point.y - self.target[1], point.z - self.target[2]];
        let mut seen = self.axes().map(|axis| axis.iter().zip(by).map(|(a, b)| a * b).sum::<f64>());
        seen[2] += self.distance;
        seen
    }

    /// Where the screen shows what the eye has there.
    pub(crate) fn screen(rect: Rect, [x, y, z]: [f64; 3]) -> Pos2 {
        let focal = 0.9 * f64::from(rect.height().min(rect.width()));
        rect.center() + Vec2::new((focal * x / z) as f32, (focal * y / z) as f32)
    }

    /// Where the screen shows a point; `None` behind the eye.
    #[must_use]
    pub fn project(&self, rect: Rect, point: WorldPoint) -> Option<Pos2> {
        let seen = self.seen(point);
        (seen[2] > NEAR).then(|| Self::screen(rect, seen))
    }

    /// Turns by a drag of so many points.
    pub fn turn(&mut self, by: Vec2) {
        self.yaw -= 0.008 * f64::from(by.x);
        self.pitch = (self.pitch + 0.008 * f64::from(by.y)).clamp(-0.2, 1.57);
    }

    /// Moves the point in the middle by a drag of so many points.
    pub fn pan(&mut self, by: Vec2) {
        let [right, down, _] = self.axes();
        let share = self.distance / 700.0;
        for axis in 0..3 {
            self.target[axis] -= share * (f64::from(by.x) * right[axis] + f64::from(by.y) * down[axis]);
        }
    }

    /// Comes nearer or goes farther.
    pub fn zoom(&mut self, factor: f64) {
        self.distance = (self.distance / factor).clamp(0.2, 1e4);
    }
}
