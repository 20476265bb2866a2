//! Cache of lens fits. While the operator drags a line, lenses with unchanged edges are not fitted again.

use calib_core::single::{Edge, LensFit, LensOptions};

/// Cache of lens fits, keyed by edges and options. It does not affect the results: a lens with other edges or
/// options is fitted again.
#[derive(Clone, Debug, Default)]
pub struct LensCache(Vec<CachedFit>);

/// Fit of a lens, with the edges and options from which it was computed.
#[derive(Clone, Debug)]
struct CachedFit {
    edges: Vec<Edge>,
    options: LensOptions,
    fit: Option<LensFit>,
}

impl LensCache {
    /// Returns the stored fit for these edges and options.
    fn find(&self, edges: &[Edge], options: &LensOptions) -> Option<&CachedFit> {
        self.0.iter().find(|known| known.edges == edges && known.options == *options)
    }

    /// Returns the fit of a lens to these edges from the cache, or computes it.
    pub(crate) fn fit(&self, edges: &[Edge], options: &LensOptions) -> Option<LensFit> {
        match self.find(edges, options) {
            Some(known) => known.fit.clone(),
            None => LensFit::new(edges, options),
        }
    }

    /// Stores the fit to these edges. The fit is copied from `before` if available, otherwise computed.
    pub(crate) fn keep(&mut self, edges: Vec<Edge>, options: LensOptions, before: &Self) {
        if self.find(&edges, &options).is_none() {
            let fit = before.fit(&edges, &options);
            self.0.push(CachedFit { edges, options, fit });
        }
    }
}
