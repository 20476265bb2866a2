//! Cameras of automatically calibrated images, placed relative to each other by the colours of the images.
//!
//! The positions are start values for the joint refinement: they can be wrong by half a metre, and in a scene
//! that repeats itself by more. Therefore the confidence is never higher than *check*.

use calib_core::Camera;
use calib_image::{PairDecision, SiteColours, SiteRegistration, View, join, register_pair};
use calib_site::{FixedEntry, PlacementEntry, Site, Stage, counted};
use image::RgbImage;

use crate::files::ThreadsArgs;
use crate::progress::Pulse;
use crate::stop::CommandError;

/// Largest number of images whose cameras are placed. The work grows with the number of pairs.
const MAX_IMAGES: usize = 16;

/// Places of the cameras of a site, and the reasons where they are unknown.
pub(crate) struct Placing {
    /// Indices of the calibrated cameras, in the order of the views.
    views: Vec<usize>,
    registration: Option<SiteRegistration>,
    /// Why no camera was placed.
    refusal: Option<String>,
}

impl Placing {
    /// Places the calibrated cameras of a site. `read` returns the image of the camera with an index.
    pub(crate) fn new(
        site: &Site,
        threads: ThreadsArgs,
        read: impl Fn(usize) -> Result<RgbImage, CommandError>,
    ) -> Result<Self, CommandError> {
        let calibrated = |&index: &usize| {
            let solution = site.cameras[index].solution.as_ref();
            solution.is_some_and(|solution| solution.stage >= Stage::Partial)
                && site.cameras[index].camera().is_some()
        };
        let views: Vec<usize> = (0..site.cameras.len()).filter(calibrated).collect();
        let refusal = match views.len() {
            0 | 1 => Some("fewer than two images have an accepted calibration".to_owned()),
            count if count > MAX_IMAGES => Some(format!(
                "{count} images are too many; give at most {MAX_IMAGES} that show the same place"
            )),
            _ => None,
        };
        if refusal.is_some() {
            return Ok(Self { views, registration: None, refusal });
        }
        let pulse = Pulse::new("placing the cameras");
        let cameras: Vec<Camera> = views.iter().filter_map(|&index| site.cameras[index].camera()).collect();
        let images = views.iter().map(|&index| read(index)).collect::<Result<Vec<_>, _>>()?;
        let view = |((&index, camera), image): ((&usize, _), _)| View {
            camera,
            image,
            is_height_known: site.cameras[index].height_m.is_some(),
        };
        let all: Vec<View> = views.iter().zip(&cameras).zip(&images).map(view).collect();
        let colours = SiteColours::new(&all);
        let pairs = threads.run(
            colours.pairs(),
            |pair| Ok::<_, CommandError>(register_pair(&colours, pair)),
            |_| (),
        )?;
        let registration = join(&colours, &pairs, &mut |_| true);
        drop(pulse);
        Ok(Self { views, registration, refusal: None })
    }

    /// Returns the site with the placements as start values.
    pub(crate) fn write_into(&self, mut site: Site) -> Site {
        for (&index, camera) in self.views.iter().zip(self.registration.iter().flat_map(|all| &all.cameras)) {
            let Some(camera) = camera else { continue };
            site.cameras[index].placement = Some(PlacementEntry {
                move_m: camera.position.on_floor(),
                turn_deg: camera.yaw.to_degrees(),
                // The colours determine only the ratios of the heights.
                scale: None,
                fixed: false,
                held: FixedEntry::default(),
                estimated: true,
            });
        }
        site
    }

    /// Returns the view of a camera by its index in the site; `None` if it is not calibrated.
    fn view(&self, camera: usize) -> Option<usize> {
        self.views.iter().position(|&index| index == camera)
    }

    /// Returns the group of a camera by its index in the site; `None` if it is not placed.
    fn group(&self, camera: usize) -> Option<usize> {
        let view = self.view(camera)?;
        self.registration.as_ref()?.groups.iter().position(|group| group.contains(&view))
    }

    /// Returns why a camera is not placed, or what is known of its place.
    fn reason(&self, camera: usize) -> String {
        if let Some(refusal) = &self.refusal {
            return refusal.clone();
        }
        let Some(view) = self.view(camera) else { return "the image has no accepted calibration".into() };
        let Some(group) = self.group(camera) else {
            let is_ambiguous = self
                .registration
                .iter()
                .flat_map(|all| &all.pairs)
                .any(|pair| pair.decision == PairDecision::Ambiguous && pair.views.contains(&view));
            return if is_ambiguous {
                "several places agree with the colours of another image".into()
            } else {
                "no other image clearly shows the same place".into()
            };
        };
        let members = self.registration.as_ref().map_or(0, |all| all.groups[group].len());
        format!(
            "placed by colours together with {}; the position can be wrong by half a metre",
            counted(members - 1, "other camera", "other cameras")
        )
    }

    /// Returns the confidence and the reason of the site.
    fn site(&self, count: usize) -> (&'static str, String) {
        if let Some(refusal) = &self.refusal {
            return ("none", refusal.clone());
        }
        let Some(all) = &self.registration else { return ("none", "the placement was cancelled".into()) };
        let placed: usize = all.groups.iter().map(Vec::len).sum();
        let against = all.agreement.iter().filter(|pair| !pair.agrees).count();
        match all.groups.len() {
            0 => ("none", "no two images clearly show the same place".into()),
            1 if placed == count && against == 0 => (
                "check",
                "every camera is placed by colours; link points to check and refine the positions".into(),
            ),
            1 if placed == count => {
                let pairs = counted(against, "pair contradicts", "pairs contradict");
                ("none", format!("{pairs} the common placement"))
            }
            groups => (
                "none",
                format!("{placed} of {count} cameras are placed, in {}", counted(groups, "group", "groups")),
            ),
        }
    }

    /// Returns the lines of the text report.
    pub(crate) fn text(&self, site: &Site) -> String {
        let (confidence, reason) = self.site(site.cameras.len());
        let mut out = format!("places: {confidence}: {reason}\n");
        for group in self.registration.iter().flat_map(|all| &all.groups) {
            let names: Vec<&str> =
                group.iter().map(|&view| site.cameras[self.views[view]].id.as_str()).collect();
            out.push_str(&format!("  together: {}\n", names.join(", ")));
        }
        out
    }

    /// Returns the JSON of the site and of its pairs.
    pub(crate) fn json(&self, site: &Site) -> serde_json::Value {
        let (confidence, reason) = self.site(site.cameras.len());
        let id = |view: usize| site.cameras[self.views[view]].id.as_str();
        let pairs = self.registration.iter().flat_map(|all| &all.pairs).map(|pair| {
            serde_json::json!({
                "cameras": pair.views.map(id),
                "decision": match pair.decision {
                    PairDecision::Found => "found",
                    PairDecision::Ambiguous => "ambiguous",
                    PairDecision::NotShown => "not-shown",
                },
                "score": pair.score,
                "ratio": pair.ratio,
            })
        });
        serde_json::json!({ "confidence": confidence, "reason": reason, "pairs": pairs.collect::<Vec<_>>() })
    }

    /// Returns the JSON of the place of a camera by its index in the site.
    pub(crate) fn camera_json(&self, camera: usize) -> serde_json::Value {
        let group = self.group(camera);
        serde_json::json!({
            "confidence": if group.is_some() { "check" } else { "none" },
            "group": group,
            "reason": self.reason(camera),
        })
    }
}
