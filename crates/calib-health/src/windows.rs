//! Windows of time that grow: however long an archive is, a bounded number of them.

use std::collections::BTreeMap;

use crate::moments::Moments;
use crate::stature::Heights;

/// Most windows; where there would be more, every two become one.
pub(crate) const MOST: usize = 192;
/// Nanoseconds of the first windows.
const NARROWEST: i64 = 10_000_000_000;

/// What was seen in one window.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Window {
    /// By camera.
    pub(crate) heights: Vec<Heights>,
    pub(crate) moments: Moments,
}

/// All windows in which something was seen, aligned to multiples of their width.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Windows {
    cameras: usize,
    width: i64,
    list: BTreeMap<i64, Window>,
}

impl Windows {
    pub(crate) const fn new(cameras: usize) -> Self {
        Self { cameras, width: NARROWEST, list: BTreeMap::new() }
    }

    /// The window of a time, if anything was seen in it.
    pub(crate) fn find(&self, at: i64) -> Option<&Window> {
        self.list.get(&at.div_euclid(self.width))
    }

    /// The window of a time.
    pub(crate) fn at(&mut self, at: i64) -> &mut Window {
        while self.list.len() >= MOST && !self.list.contains_key(&at.div_euclid(self.width)) {
            self.widen();
        }
        let empty = || Window { heights: vec![Heights::default(); self.cameras], ..Window::default() };
        self.list.entry(at.div_euclid(self.width)).or_insert_with(empty)
    }

    fn widen(&mut self) {
        self.width = self.width.saturating_mul(2);
        for (index, window) in std::mem::take(&mut self.list) {
            match self.list.get_mut(&index.div_euclid(2)) {
                None => {
                    self.list.insert(index.div_euclid(2), window);
                }
                Some(whole) => {
                    whole.heights.iter_mut().zip(&window.heights).for_each(|(all, some)| all.add(some));
                    whole.moments.join(window.moments);
                }
            }
        }
    }

    /// Begin and end of every window, with what was seen.
    pub(crate) fn iter(&self) -> impl Iterator<Item = ([i64; 2], &Window)> {
        let begin = |index: i64| index.saturating_mul(self.width);
        self.list.iter().map(move |(&index, window)| ([begin(index), begin(index.saturating_add(1))], window))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_stay_few_and_lose_nothing() {
        let mut windows = Windows::new(1);
        for minute in 0..100_000 {
            windows.at(minute * 60_000_000_000).heights[0].tracks += 1;
        }
        assert!(windows.list.len() <= MOST && windows.list.len() > MOST / 4);
        assert_eq!(windows.iter().map(|(_, window)| window.heights[0].tracks).sum::<u64>(), 100_000);
        let ends: Vec<[i64; 2]> = windows.iter().map(|(span, _)| span).collect();
        assert!(ends.windows(2).all(|pair| pair[0][1] <= pair[1][0]));
    }

    #[test]
    fn nights_take_no_windows() {
        let mut windows = Windows::new(1);
        for day in 0..20 {
            windows.at(day * 86_400_000_000_000).heights[0].tracks += 1;
        }
        assert_eq!((windows.list.len(), windows.width), (20, NARROWEST));
    }
}
