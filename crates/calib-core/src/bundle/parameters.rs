//! A place in the blocks of the joint fit for every unknown.

use crate::camera::Covariance;

/// Unknowns of a camera, its lens among them.
pub(crate) const CAMERA_PARAMS: usize = Covariance::SIZE;

/// Block and place in it of every unknown of a camera that is free.
pub(crate) type CameraLayout = [Option<(usize, usize)>; CAMERA_PARAMS];

/// Blocks as they are handed out.
#[derive(Debug, Default)]
pub(crate) struct LayoutBuilder {
    pub(crate) sizes: Vec<usize>,
    pub(crate) keep: Vec<bool>,
    pub(crate) common: Vec<Vec<usize>>,
}

impl LayoutBuilder {
    /// A block of this size; none for no unknown.
    pub(crate) fn block(&mut self, size: usize, keep: bool) -> Option<usize> {
        (size > 0).then(|| {
            self.sizes.push(size);
            self.keep.push(keep);
            self.sizes.len() - 1
        })
    }

    pub(crate) fn common(&mut self, blocks: impl Iterator<Item = usize>) {
        self.common.push(blocks.collect());
    }

    /// The block of a view, its own lens in it or beside it.
    pub(crate) fn camera_layout(
        &mut self,
        free: &[bool; CAMERA_PARAMS],
        shared: Option<usize>,
    ) -> CameraLayout {
        let of_lens = |k: usize| k >= Covariance::FOCAL;
        let is_own = |k: usize| free[k] && !(shared.is_some() && of_lens(k));
        let own = self.block((0..CAMERA_PARAMS).filter(|&k| is_own(k)).count(), true);
        let (mut next, mut next_shared) = (0, 0);
        let camera_layout = std::array::from_fn(|k| {
            let counter = if is_own(k) { &mut next } else { &mut next_shared };
            let block = if is_own(k) { own } else { shared.filter(|_| free[k] && of_lens(k)) }?;
            *counter += 1;
            Some((block, *counter - 1))
        });
        self.common(own.into_iter().chain(shared));
        camera_layout
    }

    /// Blocks of the directions and lengths of a view that are used.
    pub(crate) fn nuisance_blocks(
        &mut self,
        used: &[bool],
        camera_layout: &CameraLayout,
    ) -> Vec<Option<usize>> {
        used.iter()
            .map(|&is_used| {
                let block = self.block(usize::from(is_used), false)?;
                self.common(camera_layout.iter().flatten().map(|parameter| parameter.0).chain([block]));
                Some(block)
            })
            .collect()
    }
}
