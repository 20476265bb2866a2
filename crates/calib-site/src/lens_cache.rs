//! Fits of lenses that were made, by what they were made of: while a camera's edges stay as they are,
//! a line that is dragged need not fit its lens again.

use calib_core::single::{Edge, LensFit, LensOptions};

/// Lenses that are known. Whatever differs from what they were fitted to is fitted anew: with them or
/// without, results are the same.
#[derive(Clone, Debug, Default)]
pub struct LensCache(Vec<Known>);

#[derive(Clone, Debug)]
struct Known {
    edges: Vec<Edge>,
    options: LensOptions,
    fit: Option<LensFit>,
}

impl LensCache {
    fn known(&self, edges: &[Edge], options: &LensOptions) -> Option<&Known> {
        self.0.iter().find(|known| known.edges == edges && known.options == *options)
    }

    /// The fit of a lens to these edges: the one that is known, or made here.
    pub(crate) fn fit(&self, edges: &[Edge], options: &LensOptions) -> Option<LensFit> {
        match self.known(edges, options) {
            Some(known) => known.fit.clone(),
            None => LensFit::new(edges, options),
        }
    }

    /// Keeps the fit to these edges, taken from `before` where it was made already.
    pub(crate) fn keep(&mut self, edges: Vec<Edge>, options: LensOptions, before: &Self) {
        if self.known(&edges, &options).is_none() {
            let fit = before.fit(&edges, &options);
            self.0.push(Known { edges, options, fit });
        }
    }
}
