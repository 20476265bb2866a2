//! What a camera did between two stills, were all that it sees on the floor: a turn, a zoom, and a step.

use calib_core::{Camera, Pixel};

use calib_core::camera::{Turn, Turned, floor_nearness, ray_in_camera};

use crate::{STEP, TurnFit};

/// Of a pixel's ray, in radians, and of a step, in metres of a thing a metre away: what derivatives are differences of.
const ASIDE: f64 = 1e-5;

/// What the old camera sees at a pixel, in its axes.
#[derive(Clone, Copy)]
pub(crate) struct Sight {
    /// The ray, with depth 1.
    pub(crate) ray: [f64; 3],
    /// One over the depth of the floor there, per metre; 0 above the horizon.
    pub(crate) nearness: f64,
}

/// A turn with zoom, and a step beside it.
#[derive(Clone, Copy, Default)]
pub(crate) struct Motion {
    pub(crate) turn: Turn,
    /// In the old camera's axes, in metres.
    pub(crate) step: [f64; STEP],
}

/// A camera after a motion, and turned a little from there.
pub(crate) struct Moved {
    here: Turned,
    beside: [Turned; Turn::SIZE],
    step: [f64; STEP],
}

/// Derivatives of a pixel.
#[derive(Default)]
pub(crate) struct Slopes {
    pub(crate) turn: [[f64; 2]; Turn::SIZE],
    pub(crate) step: [[f64; 2]; STEP],
}

impl Sight {
    pub(crate) fn new(camera: &Camera, at: Pixel) -> Option<Self> {
        let ray = ray_in_camera(camera, at)?;
        Some(Self { ray, nearness: floor_nearness(camera, ray) })
    }
}

impl From<Turn> for Motion {
    fn from(turn: Turn) -> Self {
        Self { turn, ..Self::default() }
    }
}

impl Motion {
    /// This motion, and what offsets from it tell besides.
    pub(crate) fn then(&self, fit: &TurnFit) -> Self {
        let step = fit.step();
        Self { turn: self.turn.then(&fit.turn()), step: std::array::from_fn(|k| self.step[k] + step[k]) }
    }

    pub(crate) fn at(&self, camera: &Camera) -> Moved {
        let beside = std::array::from_fn(|k| {
            let mut step = [0.0; Turn::SIZE];
            step[k] = ASIDE;
            self.turn.then(&Turn::of(step)).at(camera)
        });
        Moved { here: self.turn.at(camera), beside, step: self.step }
    }
}

impl Moved {
    /// Where the new still shows it.
    pub(crate) fn shown(&self, sight: &Sight) -> Option<Pixel> {
        self.here.shown(self.ray(sight))
    }

    /// How fast what is shown moves with a turn and with a step.
    pub(crate) fn slopes(&self, sight: &Sight) -> Option<Slopes> {
        let (ray, at) = (self.ray(sight), self.shown(sight)?);
        let slope = |to: Pixel| [(to.u - at.u) / ASIDE, (to.v - at.v) / ASIDE];
        let mut slopes = Slopes::default();
        for (by, beside) in slopes.turn.iter_mut().zip(&self.beside) {
            *by = slope(beside.shown(ray)?);
        }
        for (k, by) in slopes.step.iter_mut().enumerate() {
            let mut aside = ray;
            aside[k] -= ASIDE;
            *by = slope(self.here.shown(aside)?).map(|c| sight.nearness * c);
        }
        Some(slopes)
    }

    fn ray(&self, sight: &Sight) -> [f64; 3] {
        std::array::from_fn(|k| sight.ray[k] - sight.nearness * self.step[k])
    }
}
