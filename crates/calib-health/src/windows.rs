//! Windows of time with an adaptive width, so that an archive of any length has a bounded number of them.

use std::collections::BTreeMap;

use crate::moments::Moments;
use crate::stature::Heights;

/// Largest number of windows; above it, every two windows are merged.
pub(crate) const MAX_WINDOWS: usize = 192;
/// Initial width of a window, in nanoseconds.
const MIN_WIDTH_NS: i64 = 10_000_000_000;

/// Evidence of one window of time.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Window {
    /// Heights, by camera.
    pub(crate) heights: Vec<Heights>,
    /// Sampled moments at which several cameras saw people.
    pub(crate) moments: Moments,
}

/// Time windows that contain observations of people. All have the same width and start at multiples of
/// it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Windows {
    /// Number of cameras.
    cameras: usize,
    /// Width of every window, in nanoseconds.
    width: i64,
    /// Windows by index: their start divided by `width`.
    list: BTreeMap<i64, Window>,
}

impl Windows {
    pub(crate) const fn new(cameras: usize) -> Self {
        Self { cameras, width: MIN_WIDTH_NS, list: BTreeMap::new() }
    }

    /// Returns the window that contains a time, in nanoseconds since 1970, if the window has evidence.
    pub(crate) fn find(&self, at: i64) -> Option<&Window> {
        self.list.get(&at.div_euclid(self.width))
    }

    /// Returns the window that contains a time, in nanoseconds since 1970; a missing window is created.
    pub(crate) fn at(&mut self, at: i64) -> &mut Window {
        while self.list.len() >= MAX_WINDOWS && !self.list.contains_key(&at.div_euclid(self.width)) {
            self.widen();
        }
        let empty = || Window { heights: vec![Heights::default(); self.cameras], ..Window::default() };
        self.list.entry(at.div_euclid(self.width)).or_insert_with(empty)
    }

    /// Doubles the width of all windows by merging every two.
    fn widen(&mut self) {
        self.width = self.width.saturating_mul(2);
        for (index, window) in std::mem::take(&mut self.list) {
            match self.list.get_mut(&index.div_euclid(2)) {
                None => {
                    self.list.insert(index.div_euclid(2), window);
                }
                Some(whole) => {
                    whole.heights.iter_mut().zip(&window.heights).for_each(|(all, some)| all.add(some));
                    whole.moments.merge(window.moments);
                }
            }
        }
    }

    /// Returns the start and end of every window, in nanoseconds since 1970, with its evidence.
    pub(crate) fn iter(&self) -> impl Iterator<Item = ([i64; 2], &Window)> {
        let begin = |index: i64| index.saturating_mul(self.width);
        self.list.iter().map(move |(&index, window)| ([begin(index), begin(index.saturating_add(1))], window))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_stay_few_and_keep_all_evidence() {
        let mut windows = Windows::new(1);
        for minute in 0..100_000 {
            windows.at(minute * 60_000_000_000).heights[0].tracks += 1;
        }
        assert!(windows.list.len() <= MAX_WINDOWS && windows.list.len() > MAX_WINDOWS / 4);
        assert_eq!(windows.iter().map(|(_, window)| window.heights[0].tracks).sum::<u64>(), 100_000);
        let ends: Vec<[i64; 2]> = windows.iter().map(|(span, _)| span).collect();
        assert!(ends.windows(2).all(|pair| pair[0][1] <= pair[1][0]));
    }

    #[test]
    fn times_without_evidence_have_no_windows() {
        let mut windows = Windows::new(1);
        for day in 0..20 {
            windows.at(day * 86_400_000_000_000).heights[0].tracks += 1;
        }
        assert_eq!((windows.list.len(), windows.width), (20, MIN_WIDTH_NS));
    }
}
