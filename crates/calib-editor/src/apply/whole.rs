//! Actions on the whole document: open, save, attach images, import from other programs.
//!
//! The file also applies changes of links, marks, distances and points in the tables of the app.

use std::path::PathBuf;

use calib_site::{ControlPointEntry, Distance, GroundPoint, Link, Mark, Site, SiteCamera, counted};

use crate::action::{Opened, PointAction};
use crate::editor::Editor;
use crate::images::images_mut;
use crate::import;
use crate::session::Session;
use crate::tools::{is_on_pins, move_to_pins, tool_index};

impl Editor {
    fn set_control(&mut self, index: usize, point: ControlPointEntry) {
        self.cancel();
        let name = point.label(index);
        if let Some(own) = self.session.entry_mut().and_then(|entry| entry.control_points.get_mut(index)) {
            *own = point;
        }
        self.session.commit(format!("change {name}"));
    }

    pub(super) fn apply_to_points(&mut self, action: PointAction) {
        match action {
            PointAction::Choose(id) => self.choose_ground_point(id),
            PointAction::SetGroundPoint(point) => self.set_ground_point(*point),
            PointAction::RemoveGroundPoint(id) => self.remove_ground_point(&id),
            PointAction::SetControl(index, point) => self.set_control(index, *point),
            PointAction::SetGrid(grid) => self.set_grid(grid),
        }
    }

    /// Sets the map grid of the site. If points of the site are invalid in the new grid, reports an error and keeps
    /// the old grid.
    fn set_grid(&mut self, crs: Option<String>) {
        self.cancel();
        let changed = Site { crs, ..self.session.site.clone() };
        match changed.check() {
            Ok(()) => {
                self.session.site.crs = changed.crs;
                self.session.commit("change the coordinate grid");
            }
            Err(error) => {
                self.error =
                    Some(format!("The coordinate grid does not fit the points of the site: {error}"));
            }
        }
    }

    fn choose_ground_point(&mut self, id: Option<String>) {
        if id.is_some() {
            self.select_tool(tool_index("Control point"));
        }
        self.session.tool.ground_point = id;
    }

    fn set_ground_point(&mut self, point: GroundPoint) {
        self.cancel();
        let id = point.id.clone();
        self.session.site.set_ground_point(point);
        self.session.commit(format!("change {id}"));
        self.choose_ground_point(Some(id));
    }

    fn remove_ground_point(&mut self, id: &str) {
        self.cancel();
        self.session.site.ground_points.retain(|point| point.id != id);
        self.session.tool.ground_point = None;
        self.session.commit(format!("remove {id}"));
    }

    pub(super) fn set_link(&mut self, index: usize, link: Link) {
        self.cancel();
        let name = link.id.clone().unwrap_or_default();
        if let Some(own) = self.session.site.links.get_mut(index) {
            *own = link;
        }
        self.session.commit(format!("change {name}"));
    }

    pub(super) fn set_mark(&mut self, index: usize, mark: Mark, name: String) {
        self.cancel();
        let follows_pins = is_on_pins(&self.session, index);
        if let Some(own) = self.session.site.marks.get_mut(index) {
            let is_resized = own.size_m != mark.size_m;
            let is_moved = own.at_m != mark.at_m;
            *own = mark;
            if is_moved {
                own.remove_map_coordinates();
            }
            if is_resized && follows_pins {
                self.session.solve();
                move_to_pins(&mut self.session, index);
            }
        }
        self.session.commit(name);
    }

    pub(super) fn set_distances(&mut self, distances: Vec<Distance>) {
        self.cancel();
        self.session.site.distances = distances;
        self.session.commit("change the distances");
    }
}

impl Editor {
    pub(super) fn open(&mut self, opened: Opened) {
        let Opened { site, images, path, is_unsaved } = opened;
        let snap = self.session.tool.snap;
        self.session = Session::new(site, images, path);
        self.session.tool.snap = snap;
        self.session.revision.generation = u64::from(is_unsaved);
        (self.compared_site, self.error, self.family, self.replaced_image) = (None, None, None, None);
        self.preview = None;
        self.newer.clear();
        self.select_tool(0);
    }

    pub(super) fn change(&mut self, site: Site, name: String) {
        self.cancel();
        self.session.site = site;
        self.session.commit(name);
    }

    pub(super) fn saved(&mut self, path: PathBuf, folder: Option<PathBuf>) {
        // From now on, image paths are relative to the folder of the file.
        if let Some(folder) = folder.filter(|folder| self.session.images.folder.as_ref() != Some(folder)) {
            let images = self.session.images.clone();
            let names = self.newer.iter_mut().flat_map(|newer| [Some(&mut newer.image), newer.old.as_mut()]);
            let old = self.replaced_image.as_mut().map(|replaced| &mut replaced.image);
            for name in names.chain([old]).flatten() {
                *name = images.rebased_name(name, &folder);
            }
            self.session.rebase(&folder);
        }
        self.session.revision.saved = self.session.revision.generation;
        self.session.note = Some(format!("Saved {}.", path.display()));
        self.session.path = Some(path);
    }

    pub(super) fn add_error(&mut self, error: String) {
        match &mut self.error {
            Some(shown) if !shown.contains(&error) => *shown = format!("{shown}\n{error}"),
            Some(_) => {}
            none => *none = Some(error),
        }
    }

    pub(super) fn attach(&mut self, names: &[(String, String)]) {
        let rename = |site: &Site| {
            let mut site = site.clone();
            for image in images_mut(&mut site) {
                if let Some((_, stored)) = names.iter().find(|(name, _)| name == image) {
                    image.clone_from(stored);
                }
            }
            site
        };
        let session = &mut self.session;
        session.site = rename(&session.site);
        session.history.map(rename);
        // The new generation makes autosave store the new images.
        session.revision.generation += u64::from(session.revision.generation > 0);
    }

    pub(super) fn import(&mut self, site: Site, notes: &[String]) {
        let is_alone = site.cameras.len() == 1;
        let (mut lenses, mut added, mut lens_of) = (0, 0, String::new());
        if site.ground_points.iter().any(|point| point.crs_m.is_some()) && self.session.site.crs.is_none() {
            let error = "The points have grid coordinates. Enter the coordinate grid (such as EPSG:25832) in \
                         the Points to click panel, then import the file again.";
            self.error = Some(error.into());
            return;
        }
        let points = self.import_ground_points(site.ground_points);
        for camera in site.cameras {
            match self.import_camera(camera, is_alone) {
                Ok(None) => added += 1,
                Ok(Some(id)) => (lenses, lens_of) = (lenses + 1, id),
                Err(error) => {
                    self.session.revert();
                    self.error = Some(error);
                    return;
                }
            }
        }
        let notes = if notes.is_empty() { String::new() } else { format!(" Note: {}.", notes.join("; ")) };
        if let Err(error) = self.session.site.check() {
            self.session.revert();
            self.error = Some(format!("The imported data does not fit the site: {error}"));
            return;
        }
        if points > 0 && lenses + added == 0 {
            let points = counted(points, "point", "points");
            self.session.commit(format!("import {points}"));
            self.session.note = Some(format!("Imported: {points}.{notes}"));
            return;
        }
        let added_in_words = counted(added, "camera", "cameras");
        let lenses_in_words = match lenses {
            1 => format!("the lens of {lens_of}"),
            _ => counted(lenses, "lens", "lenses"),
        };
        self.session.commit(match (lenses, added) {
            (_, 0) => format!("import {lenses_in_words}"),
            (0, _) => format!("import {added_in_words}"),
            _ => format!("import {lenses_in_words} and {added_in_words}"),
        });
        self.session.note = Some(match (lenses, added) {
            (_, 0) => format!("Imported: {lenses_in_words}.{notes}"),
            (0, _) => format!("Added: {added_in_words}.{notes}"),
            _ => format!("Imported: {lenses_in_words}. Added: {added_in_words}.{notes}"),
        });
    }

    /// Adds ground points, or replaces points with the same id; returns their number.
    fn import_ground_points(&mut self, points: Vec<GroundPoint>) -> usize {
        let count = points.len();
        points.into_iter().for_each(|point| self.session.site.set_ground_point(point));
        count
    }

    /// Imports a camera. Only its lens is imported if the site contains the camera. If it is the only imported camera
    /// (`is_alone`), its lens is assigned to the selected camera. Otherwise the camera is added. Returns the id of
    /// the camera that got a lens; `None` if a camera was added.
    fn import_camera(&mut self, camera: SiteCamera, is_alone: bool) -> Result<Option<String>, String> {
        let session = &mut self.session;
        let known = session.site.cameras.iter().position(|own| own.id == camera.id);
        let own = known.or_else(|| is_alone.then_some(session.camera));
        let Some(entry) = own.and_then(|own| session.site.cameras.get_mut(own)) else {
            session.site.cameras.push(camera);
            return Ok(None);
        };
        entry.lens = Some(import::scaled(&camera, entry.size_px)?);
        Ok(Some(entry.id.clone()))
    }
}
