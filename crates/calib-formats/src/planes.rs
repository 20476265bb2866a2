//! Planes other than the floor that cover a part of the plan, and their treatment by a format.

use calib_core::Plane;

use calib_site::{PlaneEntry, Site};

use crate::export::{Export, Loss};

/// Treatment of planes other than the floor by a format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaneTreatment {
    /// The planes are written with their regions.
    Written,
    /// Programs that read the file map all pixels to the floor, also pixels of another plane. The export
    /// reports a loss.
    Misleading,
    /// The file is correct without the planes. The export reports a note.
    LeftOut,
}

/// Returns the planes of a site that have a region.
pub(crate) fn covering(site: &Site) -> Vec<(&PlaneEntry, Plane)> {
    let entries = site.planes.iter().filter(|entry| !entry.region.is_empty());
    entries.map(|entry| (entry, site.plane_or_floor(Some(&entry.id)))).collect()
}

impl Export {
    /// Reports the planes of a site that a format does not contain.
    pub(crate) fn report_planes(&mut self, site: &Site, treatment: PlaneTreatment) {
        let ids: Vec<String> = covering(site).iter().map(|(entry, _)| format!("{:?}", entry.id)).collect();
        if ids.is_empty() {
            return;
        }
        let noun = if ids.len() == 1 { "plane" } else { "planes" };
        let planes = format!("{noun} {}", ids.join(", "));
        match treatment {
            PlaneTreatment::Written => {}
            PlaneTreatment::Misleading => self.losses.push(Loss {
                camera: None,
                description: format!("{planes}: pixels are mapped to the floor instead"),
            }),
            PlaneTreatment::LeftOut => self.notes.push(format!("not exported: {planes}")),
        }
    }
}
