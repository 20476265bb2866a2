//! Numbers that determine the letters and colours of cameras. They stay when other cameras are removed or added.

use std::collections::BTreeSet;

use calib_site::SiteCamera;

use crate::period::Period;

/// Numbers of the cameras of a session. They are not stored in the site file.
#[derive(Clone, Debug, Default)]
pub(crate) struct CameraSlots {
    /// Cameras of the site in their order, each with its number.
    current: Vec<(Period, usize)>,
    /// All cameras that the session has had, each with its last number, so that undo restores it.
    known: Vec<(Period, usize)>,
}

impl CameraSlots {
    /// Returns the number of the camera with this index.
    pub(crate) fn get(&self, index: usize) -> usize {
        self.current.get(index).map_or(index, |(_, slot)| *slot)
    }

    /// Updates the numbers after a change of the camera list. A renamed camera keeps its number, and a camera that
    /// returns gets its old one. A new camera gets the smallest free number.
    pub(crate) fn update(&mut self, cameras: &[SiteCamera]) {
        let is_same = |((period, _), camera): (&(Period, usize), &SiteCamera)| period.matches(camera);
        if self.current.len() == cameras.len() && self.current.iter().zip(cameras).all(is_same) {
            return;
        }
        let mut used = BTreeSet::new();
        let kept: Vec<Option<usize>> = (0..cameras.len())
            .map(|index| self.earlier(cameras, index).filter(|slot| used.insert(*slot)))
            .collect();
        let slots = kept.into_iter().map(|slot| {
            slot.unwrap_or_else(|| {
                let free = (0..).find(|slot| !used.contains(slot)).unwrap_or_default();
                used.insert(free);
                free
            })
        });
        let slots: Vec<usize> = slots.collect();
        self.current = cameras.iter().map(Period::from_camera).zip(slots).collect();
        for (period, slot) in &self.current {
            match self.known.iter_mut().find(|(known, _)| known == period) {
                Some((_, own)) => *own = *slot,
                None => self.known.push((period.clone(), *slot)),
            }
        }
    }

    /// Returns the earlier number of a camera, also if the camera had another id then; `None` for a new camera.
    fn earlier(&self, cameras: &[SiteCamera], index: usize) -> Option<usize> {
        let camera = cameras.get(index)?;
        let of = |list: &[(Period, usize)]| {
            list.iter().find(|(period, _)| period.matches(camera)).map(|own| own.1)
        };
        let renamed = || {
            let (period, slot) = self.current.get(index).filter(|_| self.current.len() == cameras.len())?;
            cameras.iter().all(|other| !period.matches(other)).then_some(*slot)
        };
        of(&self.current).or_else(renamed).or_else(|| of(&self.known))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras(ids: &[&str]) -> Vec<SiteCamera> {
        ids.iter().map(|id| SiteCamera::new(*id, [640, 480])).collect()
    }

    fn slots(slots: &CameraSlots, count: usize) -> Vec<usize> {
        (0..count).map(|index| slots.get(index)).collect()
    }

    #[test]
    fn numbers_stay_when_another_camera_is_removed_and_return_with_undo() {
        let mut own = CameraSlots::default();
        own.update(&cameras(&["a", "b", "c"]));
        assert_eq!(slots(&own, 3), [0, 1, 2]);
        own.update(&cameras(&["b", "c"]));
        assert_eq!(slots(&own, 2), [1, 2]);
        own.update(&cameras(&["a", "b", "c"]));
        assert_eq!(slots(&own, 3), [0, 1, 2]);
        own.update(&cameras(&["c", "a", "b"]));
        assert_eq!(slots(&own, 3), [2, 0, 1], "another order");
    }

    #[test]
    fn new_camera_gets_a_free_number_and_a_renamed_camera_keeps_its_own() {
        let mut own = CameraSlots::default();
        own.update(&cameras(&["a", "b", "c"]));
        own.update(&cameras(&["a", "c"]));
        own.update(&cameras(&["a", "c", "d"]));
        assert_eq!(slots(&own, 3), [0, 2, 1]);
        own.update(&cameras(&["a", "door", "d"]));
        assert_eq!(slots(&own, 3), [0, 2, 1], "renamed");
        own.update(&cameras(&["a", "door", "d", "b"]));
        assert_eq!(slots(&own, 4), [0, 2, 1, 3], "no number is used twice");
    }
}
