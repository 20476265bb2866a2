//! The straight edges of every still, found once and off the frame's path.

use std::collections::BTreeMap;
use std::sync::Arc;

use calib_editor::Edge;
use egui::Context;
use image::RgbImage;

use crate::platform::{Here, Platform as _, Task};

#[derive(Debug)]
enum State {
    Looking(Task<Vec<Edge>>),
    Found(Vec<Edge>),
}

/// The edges of every still that was asked for.
#[derive(Debug, Default)]
pub struct Edges {
    stills: BTreeMap<String, State>,
    stopped: bool,
}

impl Edges {
    /// The edges of a still; the first question starts the search.
    pub fn of(&mut self, ctx: &Context, name: &str, image: &Arc<RgbImage>) -> &[Edge] {
        if self.stopped && !self.stills.contains_key(name) {
            return &[];
        }
        let look = || State::Looking(Here::find_edges(ctx, image));
        match self.stills.entry(name.to_owned()).or_insert_with(look) {
            State::Found(edges) => edges,
            State::Looking(_) => &[],
        }
    }

    /// Begins a frame: finished work arrives, whether anybody asks for it or not.
    pub fn begin_frame(&mut self) {
        for state in self.stills.values_mut() {
            if let State::Looking(task) = state
                && let Some(edges) = task.poll()
            {
                *state = State::Found(edges);
            }
        }
    }

    /// How many stills are being searched.
    #[must_use]
    pub fn looking(&self) -> usize {
        self.stills.values().filter(|state| matches!(state, State::Looking(_))).count()
    }

    /// Looks no further, until it is told to.
    pub fn stop(&mut self) {
        self.stopped = true;
        self.stills.retain(|_, state| matches!(state, State::Found(_)));
    }

    /// Looks on.
    pub const fn resume(&mut self) {
        self.stopped = false;
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.stills.clear();
        self.stopped = false;
    }
}
