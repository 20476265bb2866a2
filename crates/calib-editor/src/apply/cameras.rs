//! Actions on the list of cameras and on their images: select, add, replace, rename, remove.
//!
//! The file also stores comparisons with newer images, and applies recoveries of cameras from newer images.

use calib_site::{LensEntry, PixelAspectEntry, Recovered, Site, SiteCamera, counted};

use crate::action::NewImage;
use crate::command::Cameras;
use crate::editor::{Editor, ReplacedImage};
use crate::joint::remove_results;
use crate::newer::{NewerAction, NewerImage};
use crate::period::Period;
use crate::{edit, import, steps};

impl Editor {
    pub(super) fn on_cameras(&mut self, command: Cameras) {
        self.cancel();
        let count = self.session.site.cameras.len();
        let own = self.session.camera;
        let step = |by: usize, wanted: &dyn Fn(usize) -> bool| {
            (1..=count).map(|i| (own + i * by) % count).find(|&camera| wanted(camera))
        };
        let back = count.saturating_sub(1);
        let is_open = |camera: usize| !steps::is_finished(&self.session, camera);
        let to = match command {
            Cameras::NextCamera => step(1, &|_| true),
            Cameras::PreviousCamera => step(back, &|_| true),
            Cameras::NextUnfinished => step(1, &is_open),
            Cameras::PreviousUnfinished => step(back, &is_open),
            Cameras::RemoveCamera => return self.remove_camera(),
        };
        if let Some(camera) = to {
            self.session.select_camera(camera);
        }
    }

    pub(super) fn add_camera(&mut self, new: NewImage, joins_last: bool) {
        let NewImage { image, title, size, image_circle, pixel_aspect } = new;
        let site = &mut self.session.site;
        let is_used = |id: &str| site.cameras.iter().any(|camera| camera.id == id);
        let id = std::iter::once(title.clone())
            .chain((2..).map(|number| format!("{title}-{number}")))
            .find(|id| !is_used(id))
            .unwrap_or_default();
        let lens = LensEntry {
            image_circle_px: image_circle,
            pixel_aspect: pixel_aspect.map(PixelAspectEntry::Known),
            ..LensEntry::default()
        };
        let lens = (lens != LensEntry::default()).then_some(lens);
        site.cameras.push(SiteCamera { image: Some(image), lens, ..SiteCamera::new(id.clone(), size) });
        let added = site.cameras.len() - 1;
        let before = self.session.history.depth();
        self.session.commit(format!("add {id}"));
        // A refused image adds no step. After another gesture or an undo, the steps are not joined.
        let is_next = joins_last && self.session.added_at == Some(before);
        if is_next && self.session.history.depth() == before + 1 {
            self.session.history.join_last(|count| format!("add {count} images"));
        }
        self.session.added_at = Some(self.session.history.depth());
        // If several cameras are added, the first one is selected. An unfinished gesture is not interrupted.
        let is_begun =
            self.session.entry().is_some_and(|entry| !entry.annotations.is_empty() || entry.is_given());
        if is_begun && self.tool().is_idle() {
            self.session.select_camera(added);
        }
    }

    pub(super) fn replace_image(&mut self, of: Period, new: NewImage) {
        let NewImage { image, size, image_circle, .. } = new;
        let Some(entry) = self.session.site.cameras.iter_mut().find(|entry| of.matches(entry)) else {
            return;
        };
        // The image circle of an image of another size is scaled together with the annotations.
        if entry.image_circle().is_none() && image_circle.is_some() && entry.size_px == size {
            entry.lens.get_or_insert_default().image_circle_px = image_circle;
        }
        let (old, from) = (entry.image.replace(image), std::mem::replace(&mut entry.size_px, size));
        let size = Some(from).filter(|from| *from != size);
        let camera = of.camera.clone();
        self.session.commit(format!("replace the image of {camera}"));
        self.replaced_image = old.map(|image| ReplacedImage { of, image, opacity: 0.5, size });
        if let Some([w, h]) = size {
            self.session.note = Some(format!(
                "The old image of {camera} had a different size, {w} \u{d7} {h} px. \
                 Press \u{201c}Rescale the annotations\u{201d}."
            ));
        }
    }

    pub(super) fn blend_replaced(&mut self, share: Option<f32>) {
        match (share, &mut self.replaced_image) {
            (Some(share), Some(old)) => old.opacity = share,
            (None, shown) => *shown = None,
            (Some(_), None) => {}
        }
    }

    /// Scales all annotations of the camera from the size of the replaced image to the size of the new one.
    pub(super) fn rescale_to_image(&mut self) {
        let Some(ReplacedImage { of, size, .. }) = &mut self.replaced_image else { return };
        let (of, Some(from)) = (of.clone(), size.take()) else { return };
        let site = &mut self.session.site;
        let Some(index) = of.index(site) else { return };
        let entry = &mut site.cameras[index];
        let ratio = [0, 1].map(|axis| f64::from(entry.size_px[axis]) / f64::from(from[axis].max(1)));
        // With a window, the lens values belong to the calibrated image, whose size does not change.
        if let Some(lens) = entry.lens.as_mut().filter(|lens| lens.window_px.is_none()) {
            import::scale_lens(lens, ratio[0]);
        }
        edit::scale_camera(site, index, ratio);
        self.session.commit(format!("rescale the annotations of {}", of.camera));
    }

    pub(super) fn name_camera(&mut self, name: String) {
        let Some(entry) = self.session.entry_mut() else { return };
        entry.name = Some(name).filter(|name| !name.trim().is_empty());
        let step = format!("change the name of {}", entry.id);
        self.session.commit(step);
    }

    pub(super) fn rename_camera(&mut self, id: &str) {
        let session = &mut self.session;
        let Some(old) = session.entry().map(|entry| entry.id.clone()) else { return };
        if old == id {
            return;
        }
        if id.is_empty() || session.site.cameras.iter().any(|camera| camera.id == id) {
            let why = if id.is_empty() { "the ID is empty" } else { "another camera has this ID" };
            session.note = Some(format!("{old} was not renamed: {why}. Enter another ID."));
            return;
        }
        let periods = session.site.cameras.iter_mut().map(|camera| &mut camera.id);
        periods.filter(|own| **own == old).for_each(|own| id.clone_into(own));
        let links =
            session.site.links.iter_mut().flat_map(|link| &mut link.seen).map(|seen| &mut seen.camera);
        let marks =
            session.site.marks.iter_mut().flat_map(|mark| &mut mark.seen).map(|seen| &mut seen.camera);
        let measured = session.site.measurements.iter_mut().flat_map(|measurement| &mut measurement.points);
        let measured = measured.map(|point| &mut point.camera);
        let proposed =
            std::sync::Arc::make_mut(&mut session.pending.proposed).iter_mut().map(|own| &mut own.of.camera);
        let like = session.site.cameras.iter_mut().filter_map(|camera| camera.lens.as_mut()?.like.as_mut());
        for name in
            links.chain(marks).chain(measured).chain(like).chain(proposed).filter(|name| **name == old)
        {
            id.clone_into(name);
        }
        session.commit(format!("rename {old}"));
        if let Some(old_image) = self.replaced_image.as_mut().filter(|replaced| replaced.of.camera == old) {
            id.clone_into(&mut old_image.of.camera);
        }
        // Undo restores the old id, so the newer image is stored with both ids.
        for newer in self.newer.iter_mut().filter(|newer| newer.ids.contains(&old)) {
            newer.ids.insert(id.to_owned());
        }
    }

    /// Removes the selected camera and all references to it.
    fn remove_camera(&mut self) {
        let session = &mut self.session;
        if session.camera >= session.site.cameras.len() {
            return;
        }
        let had_shared = session.site.owns_links(session.camera);
        let removed = session.site.cameras.remove(session.camera);
        let of = Period::from_camera(&removed);
        let id = removed.id;
        // Links and marks belong to the image of the newest calibration period only.
        if had_shared {
            edit::remove_observations(&mut session.site, &id);
        }
        if session.site.cameras.iter().all(|camera| camera.id != id) {
            let lenses = session.site.cameras.iter_mut().filter_map(|camera| camera.lens.as_mut());
            lenses.for_each(|lens| drop(lens.like.take_if(|like| *like == id)));
        }
        edit::remove_dangling_distances(&mut session.site);
        session.selection.clear();
        session.camera = session.camera.min(session.site.cameras.len().saturating_sub(1));
        if self.replaced_image.as_ref().is_some_and(|old| old.of == of) {
            self.replaced_image = None;
        }
        self.session.commit(format!("remove {id}"));
    }
}

impl Editor {
    pub(super) fn on_newer(&mut self, action: NewerAction) {
        match action {
            NewerAction::Compared(newer) => self.add_newer(*newer),
            NewerAction::SetSince(time) => {
                if let Some(newer) = self.selected_newer_mut() {
                    newer.since = time;
                }
            }
            NewerAction::Dismiss => {
                let own = self.selected_newer().cloned();
                self.newer.retain(|newer| Some(newer) != own.as_ref());
            }
            NewerAction::Recovered(camera, found) => self.apply_recovered(&camera, &found.0, found.1),
        }
    }

    fn add_newer(&mut self, newer: NewerImage) {
        let camera = newer.ids.first().cloned().unwrap_or_default();
        let became = newer.comparison.change;
        // Comparisons finish in any order: the newest image determines the current status.
        if let Some(known) =
            self.newer.iter().find(|known| newer.is_same_camera(known) && newer.is_before(known))
        {
            let (title, kept, since) = (&newer.title, &known.title, &known.since);
            self.session.note =
                Some(format!("{camera}: {title} was ignored, because it is older than {kept} ({since})."));
            return;
        }
        self.session.note = Some(format!("{camera}: {became}."));
        self.newer.retain(|known| !newer.is_same_camera(known));
        self.newer.push(newer);
    }

    fn selected_newer_mut(&mut self) -> Option<&mut NewerImage> {
        let entry = self.session.entry()?;
        self.newer.iter_mut().find(|newer| newer.is_of(entry))
    }

    /// Replaces the site by a site with a new calibration period of the camera. `from` is the site from which
    /// it was computed; a site that has changed since is not replaced.
    fn apply_recovered(&mut self, camera: &str, from: &Site, found: Recovered) {
        self.cancel();
        if self.session.site != *from {
            self.session.note = Some(format!(
                "{camera} was not recovered: the site was changed in the meantime. Start the recovery again."
            ));
            return;
        }
        let Recovered { mut site, left_out, carried } = found;
        remove_results(&mut site);
        self.session.site = site;
        self.session.selection.clear();
        self.session.commit(format!("recover {camera}"));
        let left_out = match left_out.len() {
            0 => String::new(),
            _ => format!(" Not visible in the new image, so not transferred: {}.", left_out.join(", ")),
        };
        let carried = counted(carried, "line or point", "lines and points");
        self.session.note = Some(format!("{camera}: {carried} transferred to the new image.{left_out}"));
    }
}
