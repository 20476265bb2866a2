//! Planes besides the floor that cover a part of the plan: what becomes of them in a format.

use calib_core::Plane;

use calib_site::{PlaneEntry, Site};

use crate::export::{Export, Loss};

/// What becomes of planes besides the floor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OfPlanes {
    /// They are written with their regions.
    Written,
    /// Its readers map pixels to the floor, those that show a plane, too: what is written misleads there.
    Misleading,
    /// What is written is right without them.
    LeftOut,
}

/// The planes with a region, and where they are.
pub(crate) fn covering(site: &Site) -> Vec<(&PlaneEntry, Plane)> {
    let entries = site.planes.iter().filter(|entry| !entry.region.is_empty());
    entries.map(|entry| (entry, site.plane_or_floor(Some(&entry.id)))).collect()
}

impl Export {
    /// Says what becomes of the planes of a site in a format that does not write them.
    pub(crate) fn tell_of_planes(&mut self, site: &Site, of_planes: OfPlanes) {
        let ids: Vec<String> = covering(site).iter().map(|(entry, _)| format!("{:?}", entry.id)).collect();
        if ids.is_empty() {
            return;
        }
        let ids = ids.join(", ");
        match of_planes {
            OfPlanes::Written => {}
            OfPlanes::Misleading => self.losses.push(Loss {
                camera: None,
                what: format!("the planes {ids}: pixels that show them are mapped to the floor behind them"),
            }),
            OfPlanes::LeftOut => self.notes.push(format!("the planes {ids} are not in it")),
        }
    }
}
