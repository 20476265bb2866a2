//! Image files: new cameras, replaced and newer images, floor plans with their world files, imported lenses.
//! Files are read in the background.

use std::path::Path;

use calib_editor::images::{camera_name, has_ending, is_image, mime};
use calib_editor::{Action, NewImage, import_any, is_importable, parse, plan_from_world_file, world_endings};
use calib_formats::{File, Format, Imported};
use calib_input::time_in_name;
use calib_plan::ImagePosition;
use calib_site::Plan;
use egui::Context;

use crate::choice::Chosen;
use crate::drawing::{plan_from_drawing, plan_on_map};
use crate::platform::{Here, Platform as _, Task};
use crate::state::{App, Comparing, Mode, Planning, Read, ReadPicture};

/// Advice for a file that cannot be opened.
const KNOWN_FILES: &str = "Use a site (.json), an image (such as .png or .jpg), a video, a plan (PDF, DXF or SVG), \
                           a calibration from another program, or a table of points (.csv).";

/// Whether a file is a world file, which georeferences a plan image.
pub(crate) fn is_world_file(file: &Chosen) -> bool {
    world_endings().iter().any(|ending| has_ending(Path::new(&file.name), ending))
}

/// Whether a world file belongs to an image, as `plan.pgw` to `plan.png`. A drawing has no pixels and
/// therefore no world file.
fn belongs_to_image(world: &Chosen, picture: &Chosen) -> bool {
    let stem = |file: &Chosen| Path::new(&file.name).file_stem().map(ToOwned::to_owned);
    is_image(Path::new(&picture.name)) && stem(world) == stem(picture)
}

/// Reads the plan entry of the site from a world file.
fn plan_from_file(file: Chosen) -> Result<Plan, String> {
    let name = file.name.clone();
    let bytes = file.into_bytes().map_err(|error| format!("{name}: {error}"))?;
    plan_from_world_file(File { name, bytes })
}

/// Returns the world file in the folder of an image on disk, if it exists.
fn neighbouring_world_file(picture: &Chosen) -> Option<Chosen> {
    let path = picture.path.as_deref().filter(|path| is_image(path))?;
    let path = world_endings().iter().map(|end| path.with_extension(end)).find(|path| path.is_file())?;
    let name = path.file_name()?.to_string_lossy().into_owned();
    Some(Chosen { name, path: Some(path), bytes: None })
}

impl App {
    /// Loads chosen files as the floor plan: an image, a world file, or both. A site has one plan; an error
    /// names the files that were not loaded.
    pub fn load_plan(&mut self, ctx: &Context, chosen: Vec<Chosen>) {
        let (worlds, mut pictures): (Vec<_>, Vec<_>) = chosen.into_iter().partition(is_world_file);
        let mut worlds = worlds.into_iter();
        if pictures.is_empty() {
            if let Some(world) = worlds.next() {
                self.take_world_file(world);
            }
        } else {
            let picture = pictures.remove(0);
            let (mut own, others): (Vec<_>, Vec<_>) =
                worlds.partition(|world| belongs_to_image(world, &picture));
            let own = if own.is_empty() { neighbouring_world_file(&picture) } else { Some(own.remove(0)) };
            self.read_plan(ctx, picture, own);
            worlds = others.into_iter();
        }
        let left: Vec<String> = pictures.into_iter().chain(worlds).map(|file| file.name).collect();
        if !left.is_empty() {
            self.act(Action::AddError(format!(
                "A site can have only one plan. Not loaded: {}.",
                left.join(", ")
            )));
        }
    }

    /// Starts reading a plan image; the world file `world` contains its georeference.
    fn read_plan(&mut self, ctx: &Context, picture: Chosen, world: Option<Chosen>) {
        let world_file = world.map(plan_from_file).transpose().unwrap_or_else(|error| {
            self.act(Action::AddError(error));
            None
        });
        self.jobs.planning = Some(Planning { picture: self.read_still(ctx, picture), world_file });
    }

    /// Checks whether the plan image has been read; if so, shows it as the plan or reports the
    /// error.
    pub(crate) fn poll_plan(&mut self) {
        let Some(planning) = self.jobs.planning.take() else { return };
        match planning.picture.poll() {
            None => self.jobs.planning = Some(planning),
            Some(Ok(still)) => self.show_plan(still, planning.world_file),
            Some(Err(error)) => self.act(Action::AddError(error)),
        }
    }

    /// Loads a plan image that was read. `world_file` is the plan entry that its world file contains, if it has one.
    fn show_plan(&mut self, still: ReadPicture, world_file: Option<Plan>) {
        let drawing = still.drawing.clone();
        let on_map = still.position.and_then(|position| {
            let plan = plan_on_map(self.editor.site(), still.still.size, position);
            plan.map_err(|error| self.act(Action::AddError(error))).ok()?
        });
        let world_file = world_file.map(|plan| (plan, "Scale read from the world file.".to_owned()));
        let scaled = on_map
            .or(world_file)
            .or_else(|| self.kept_scale(&still))
            .or_else(|| plan_from_drawing(drawing.as_ref()?));
        let notes = drawing.map(|drawing| drawing.notes.join(" ")).unwrap_or_default();
        let still = self.stored(still);
        self.act(Action::LoadPlan(still, scaled.map(Box::new)));
        if !notes.is_empty() {
            let scale = self.editor.session().note.clone().unwrap_or_default();
            self.act(Action::Note(format!("{scale} {notes}").trim().to_owned()));
        }
        self.show(Mode::Plan);
        self.view.panes.views.clear();
    }

    /// Returns the entry of the existing plan for a new plan image that replaces it, with a note. `None` if the new
    /// image has another size, scale or origin.
    fn kept_scale(&self, new: &ReadPicture) -> Option<(Plan, String)> {
        let old = self.plan_picture().filter(|old| old.size() == new.still.size)?;
        let plan = self.editor.site().plan.clone()?;
        let stated = new.drawing.as_ref().and_then(|drawing| drawing.metres_per_px);
        let is_same = stated.is_none_or(|stated| (stated / plan.metres_per_px - 1.0).abs() < 1e-6)
            && old.drawing.as_ref().map(|old| old.origin_px) == new.drawing.as_ref().map(|new| new.origin_px);
        let note = "The new plan has the same size. The position and scale of the old plan were kept.".into();
        is_same.then_some((Plan { page: None, layers: None, ..plan }, note))
    }

    /// Applies a world file to the existing plan.
    fn take_world_file(&mut self, file: Chosen) {
        let name = file.name.clone();
        self.act(match plan_from_file(file) {
            Ok(told) => Action::ApplyWorldFile(told, name),
            Err(error) => Action::AddError(error),
        });
    }

    /// Removes world files and the images of the same name from the dropped files, and loads them as the
    /// plan.
    pub(crate) fn take_plans(&mut self, ctx: &Context, dropped: &mut Vec<Chosen>) {
        if !dropped.iter().any(is_world_file) {
            return;
        }
        let (worlds, others): (Vec<_>, Vec<_>) = std::mem::take(dropped).into_iter().partition(is_world_file);
        let (pictures, others): (Vec<_>, Vec<_>) =
            others.into_iter().partition(|file| worlds.iter().any(|world| belongs_to_image(world, file)));
        *dropped = others;
        self.load_plan(ctx, pictures.into_iter().chain(worlds).collect());
    }
}

impl App {
    /// Starts reading an image that becomes a camera.
    pub fn add_still(&mut self, ctx: &Context, file: Chosen) {
        self.add_video_still(ctx, file, 1.0);
    }

    /// Starts reading an image that becomes a camera. `pixel_aspect` is from the metadata of its video; 1 for square
    /// pixels.
    pub(crate) fn add_video_still(&mut self, ctx: &Context, file: Chosen, pixel_aspect: f64) {
        let title = camera_name(file.path.as_deref().unwrap_or(Path::new(&file.name)));
        self.add_named_still(ctx, file, title, pixel_aspect);
    }

    /// Starts reading an image that becomes a camera of this name.
    pub(crate) fn add_named_still(&mut self, ctx: &Context, file: Chosen, title: String, pixel_aspect: f64) {
        /// Range of the pixel aspects that a site accepts.
        const ACCEPTED: std::ops::RangeInclusive<f64> = 0.1..=10.0;
        /// Deviation from 1 below which pixels are square.
        const NEGLIGIBLE: f64 = 1e-3;
        if !ACCEPTED.contains(&pixel_aspect) {
            let text = format!(
                "The pixel aspect {pixel_aspect:.4} of {title} is implausible and was ignored. \
                 Enter the correct pixel aspect in Known values."
            );
            self.act(Action::Note(text));
        }
        let is_used = |aspect: &f64| (aspect - 1.0).abs() > NEGLIGIBLE && ACCEPTED.contains(aspect);
        let task = self.read_named_still(ctx, file, title, Some(pixel_aspect).filter(is_used));
        self.jobs.has_added &= !self.jobs.adding.is_empty();
        self.jobs.adding.push(task);
    }

    /// Starts comparing newer images with their cameras. A file belongs to the camera whose id is at the beginning
    /// of its name, otherwise to the current camera.
    pub fn add_newer(&mut self, ctx: &Context, files: Vec<Chosen>) {
        let in_hand = self.editor.session().entry().map(|entry| entry.id.clone());
        for file in files {
            let named = self.camera_from_file_name(&file.name).or_else(|| in_hand.clone());
            if let Some(camera) = named {
                let opening = self.read_still(ctx, file);
                self.jobs.comparing.push_back(Comparing::new(camera, opening));
            }
        }
    }

    /// Returns the id of the camera with which a file name begins; `None` without such a camera.
    fn camera_from_file_name(&self, name: &str) -> Option<String> {
        self.editor.site().camera_id_from_name(&camera_name(Path::new(name))).map(str::to_owned)
    }

    /// Whether a file is a newer image of a solved camera, judged by its name, which must contain a time.
    pub(crate) fn is_newer(&self, file: &Chosen) -> bool {
        let name = Path::new(&file.name);
        let taken = time_in_name(&camera_name(name)).filter(|_| is_image(name));
        let index =
            || self.editor.site().entry_index_at(&self.camera_from_file_name(&file.name)?, taken.as_deref());
        let is_solved = |index: usize| self.editor.session().solved.pose(index).is_some();
        taken.is_some() && index().is_some_and(is_solved)
    }

    /// Starts reading an image file.
    pub(crate) fn read_still(&mut self, ctx: &Context, file: Chosen) -> Task<Read> {
        let title = camera_name(file.path.as_deref().unwrap_or(Path::new(&file.name)));
        self.read_named_still(ctx, file, title, None)
    }

    /// Starts reading an image file. `title` is the name that the operator sees. `pixel_aspect` is `None` for square
    /// pixels.
    fn read_named_still(
        &mut self,
        ctx: &Context,
        file: Chosen,
        title: String,
        pixel_aspect: Option<f64>,
    ) -> Task<Read> {
        if let Some(path) = &file.path {
            self.allow_chosen(path);
        }
        let name = match (&file.path, file.bytes) {
            (Some(path), _) => path.to_string_lossy().into_owned(),
            (None, Some(bytes)) => self.editor.store_image(bytes.into(), mime(&file.name), Some(&file.name)),
            (None, None) => file.name.clone(),
        };
        let read = self.editor.session().images.reader(&name);
        Here::still(ctx, file.name, read, move |bytes, decoded, drawn| ReadPicture {
            taken: time_in_name(&title).or_else(|| calib_input::capture_time(bytes)),
            still: NewImage {
                image: name,
                title,
                size: decoded.image.dimensions().into(),
                image_circle: calib_image::image_circle(&decoded.image),
                pixel_aspect,
            },
            drawn,
            position: ImagePosition::from_geotiff(bytes).map(|position| {
                position.reduced(decoded.drawing.as_ref().map_or(1, |drawing| drawing.reduction))
            }),
            drawing: decoded.drawing,
        })
    }

    /// Adds cameras for the images that have been read, and replaces the image of a camera if its new image has been
    /// read.
    pub(crate) fn poll_stills(&mut self) {
        let was_empty = self.editor.site().cameras.is_empty();
        // Threads finish in any order; cameras keep the order of their files.
        while let Some(still) = self.jobs.adding.first().and_then(Task::outcome) {
            self.jobs.adding.remove(0);
            match still.map_err(|_| "An image could not be read. Add it again.".to_owned()).flatten() {
                // An image with a map position is a floor plan, not the image of a camera.
                Ok(picture) if picture.position.is_some() && self.editor.site().plan.is_none() => {
                    self.show_plan(picture, None);
                }
                Ok(picture) => {
                    let still = self.stored(picture);
                    let joins_last = std::mem::replace(&mut self.jobs.has_added, true);
                    self.act(Action::AddCamera { image: still, joins_last });
                }
                Err(error) => self.act(Action::AddError(error)),
            }
        }
        if was_empty && !self.editor.site().cameras.is_empty() {
            self.act(Action::SelectCamera(0));
            self.show(Mode::Image);
        }
        if let Some(task) = self.jobs.replacing.take() {
            match task.poll() {
                None => self.jobs.replacing = Some(task),
                Some(Ok(picture)) => {
                    let still = self.stored(picture);
                    self.act(Action::ReplaceImage(self.jobs.replaced.clone(), still));
                }
                Some(Err(error)) => self.act(Action::AddError(error)),
            }
        }
    }

    /// Converts an image that was read to an image for the site. If the reader created a PNG of the image, the PNG
    /// is first stored in the site. The reader does so for an SVG drawing and for a format that only the browser
    /// decodes.
    pub(crate) fn stored(&mut self, picture: ReadPicture) -> NewImage {
        let ReadPicture { still, drawn, .. } = picture;
        let Some(png) = drawn else { return still };
        let name = format!("{}.png", still.title);
        let image = self.editor.store_image(png.into(), "image/png", Some(&name));
        NewImage { image, ..still }
    }
}

impl App {
    /// Imports lenses, cameras and points from files of other programs. If no format accepts all files together, the
    /// files are grouped by their file name extension. Each group is then imported separately.
    pub(crate) fn import(&mut self, chosen: Vec<Chosen>) {
        let files: Vec<File> = chosen.into_iter().filter_map(|file| self.read_importable(file)).collect();
        let Some(first) = files.first() else { return };
        let error = match import_any(&files) {
            Ok((format, imported)) => return self.take_imported(&first.name, format, imported),
            Err(error) => error,
        };
        let ending = |file: &File| Path::new(&file.name).extension().map(std::ffi::OsStr::to_ascii_lowercase);
        let own = ending(first);
        let (alike, others): (Vec<File>, Vec<File>) = files.into_iter().partition(|file| ending(file) == own);
        if others.is_empty() {
            self.refuse_import(&alike, &error);
            return;
        }
        for files in [alike, others] {
            let chosen = |File { name, bytes }| Chosen { name, path: None, bytes: Some(bytes) };
            self.import(files.into_iter().map(chosen).collect());
        }
    }

    /// Reads a file whose type can be imported; reports an error otherwise.
    fn read_importable(&mut self, file: Chosen) -> Option<File> {
        let name = file.name.clone();
        let read = match is_importable(&name) {
            true => file.into_bytes().map_err(|error| format!("{error}.")),
            false => Err(format!("the type of this file is unknown. {KNOWN_FILES}")),
        };
        match read {
            Ok(bytes) => Some(File { name, bytes }),
            Err(error) => {
                self.act(Action::AddError(format!("Cannot open {name}: {error}")));
                None
            }
        }
    }

    /// Reports files that no importer accepts. For a JSON file, the message contains the error of reading it as a site
    /// file.
    fn refuse_import(&mut self, files: &[File], error: &str) {
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        let sites = files.iter().filter(|file| has_ending(Path::new(&file.name), "json"));
        let as_site = sites
            .map(|file| String::from_utf8_lossy(&file.bytes))
            .find_map(|text| parse(&text, None).err())
            .map_or_else(String::new, |error| format!(": not a valid site ({error})"));
        let names = names.join(", ");
        self.act(Action::AddError(format!("Cannot open {names}{as_site}. {error} {KNOWN_FILES}")));
    }

    /// Adds the cameras, the lenses or the plan of imported files to the site.
    fn take_imported(&mut self, name: &str, format: &Format, Imported { site, notes }: Imported) {
        // A world file alone georeferences the existing plan.
        let open = self.editor.site();
        if let (Some(plan), true, Some(_)) = (&site.plan, site.cameras.is_empty(), &open.plan) {
            self.act(Action::ApplyWorldFile(plan.clone(), name.to_owned()));
            return;
        }
        let is_empty = open.cameras.is_empty() && open.plan.is_none() && open.ground_points.is_empty();
        if is_empty && site.ground_points.is_empty() && self.waiting() == 0 {
            let images = self.editor.session().images.clone();
            self.open_site(site, images, None);
            let notes = if notes.is_empty() { String::new() } else { format!(": {}", notes.join("; ")) };
            self.act(Action::Note(format!("Read {name} as {}{notes}.", format.name)));
            return;
        }
        self.act(Action::Import(Box::new(site), notes));
    }
}
