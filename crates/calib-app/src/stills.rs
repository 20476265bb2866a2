//! Stills that come in: read off the frame's path, then taken as cameras or in place of another.
//!
//! Lenses and cameras of other programs: read here, taken by the editor.

use std::path::Path;

use calib_editor::images::{camera_name, is_image, mime};
use calib_editor::{Action, NewStill, recognise};
use calib_formats::{File, Format, Imported};
use calib_input::time_in_name;
use egui::Context;

use crate::choice::Chosen;
use crate::platform::{Here, Platform as _, Task};
use crate::state::{App, Comparing, Read, ReadPicture};

impl App {
    /// Begins to read a still that becomes a camera.
    pub fn add_still(&mut self, ctx: &Context, file: Chosen) {
        let task = self.read_still(ctx, file);
        self.adding.push(task);
    }

    /// Begins to compare newer stills: each with the camera that its name begins with, else with that in hand.
    pub fn add_newer(&mut self, ctx: &Context, files: Vec<Chosen>) {
        let in_hand = self.editor.session().entry().map(|entry| entry.id.clone());
        for file in files {
            let named = self.named_by(&file.name).or_else(|| in_hand.clone());
            if let Some(camera) = named {
                let opening = self.read_still(ctx, file);
                self.comparing.push_back(Comparing::new(camera, opening));
            }
        }
    }

    /// The id of the camera that the name of a still begins with.
    fn named_by(&self, name: &str) -> Option<String> {
        self.editor.site().camera_of_name(&camera_name(Path::new(name))).map(str::to_owned)
    }

    /// Whether a file is a newer still of a camera, by its name: of one that is solved, and it says a time.
    pub(crate) fn is_newer(&self, file: &Chosen) -> bool {
        let name = Path::new(&file.name);
        let taken = time_in_name(&camera_name(name)).filter(|_| is_image(name));
        let index = || self.editor.site().entry_at(&self.named_by(&file.name)?, taken.as_deref());
        let is_solved = |index: usize| self.editor.session().solved.pose(index).is_some();
        taken.is_some() && index().is_some_and(is_solved)
    }

    pub(crate) fn read_still(&mut self, ctx: &Context, file: Chosen) -> Task<Read> {
        if let Some(path) = &file.path {
            self.allow_chosen(path);
        }
        let title = camera_name(file.path.as_deref().unwrap_or(Path::new(&file.name)));
        let name = match (&file.path, file.bytes) {
            (Some(path), _) => path.to_string_lossy().into_owned(),
            (None, Some(bytes)) => self.editor.store_image(bytes.into(), mime(&file.name), Some(&file.name)),
            (None, None) => file.name.clone(),
        };
        let read = self.editor.session().images.reader(&name);
        Here::still(ctx, file.name, read, |bytes, picture, drawn| ReadPicture {
            taken: time_in_name(&title).or_else(|| calib_input::taken(bytes)),
            still: NewStill {
                image: name,
                title,
                size: picture.dimensions().into(),
                image_circle: calib_image::image_circle(picture),
            },
            drawn,
        })
    }

    pub(crate) fn poll_stills(&mut self) {
        let was_empty = self.editor.site().cameras.is_empty();
        // Threads finish in any order; cameras come in that of their files.
        while let Some(still) = self.adding.first().and_then(Task::outcome) {
            self.adding.remove(0);
            match still.map_err(|_| "An image could not be read.".to_owned()).flatten() {
                Ok(picture) => {
                    let still = self.stored(picture);
                    self.act(Action::AddCamera(still));
                }
                Err(error) => self.act(Action::Complain(error)),
            }
        }
        if was_empty && !self.editor.site().cameras.is_empty() {
            self.act(Action::Choose(0));
        }
        if let Some(task) = self.replacing.take() {
            match task.poll() {
                None => self.replacing = Some(task),
                Some(Ok(picture)) => {
                    let still = self.stored(picture);
                    self.act(Action::ReplaceStill(self.replaced.clone(), still));
                }
                Some(Err(error)) => self.act(Action::Complain(error)),
            }
        }
    }

    /// The still of a picture; one that was drawn is stored.
    pub(crate) fn stored(&mut self, picture: ReadPicture) -> NewStill {
        let ReadPicture { still, drawn, taken: _ } = picture;
        let Some(png) = drawn else { return still };
        let name = format!("{}.png", still.title);
        let image = self.editor.store_image(png.into(), "image/png", Some(&name));
        NewStill { image, ..still }
    }
}

impl App {
    /// Takes what files of another program say about cameras.
    pub(crate) fn import(&mut self, chosen: Vec<Chosen>) {
        let Some(first) = chosen.first().map(|file| file.name.clone()) else { return };
        let read = chosen.into_iter().map(|file| {
            let name = file.name.clone();
            let bytes = file.into_bytes().map_err(|error| format!("{name}: {error}"))?;
            Ok(File { name, bytes })
        });
        let taken = read.collect::<Result<Vec<File>, String>>().and_then(|files| recognise(&files));
        match taken {
            Ok((format, imported)) => self.take_imported(&first, format, imported),
            Err(error) => self.act(Action::Fail(error)),
        }
    }

    fn take_imported(&mut self, name: &str, format: &Format, Imported { site, notes }: Imported) {
        // A world file alone lays the plan that is there.
        let open = self.editor.site();
        if let (Some(plan), true, Some(_)) = (&site.plan, site.cameras.is_empty(), &open.plan) {
            self.act(Action::LayPlan(plan.clone(), name.to_owned()));
            return;
        }
        if open.cameras.is_empty() {
            let images = self.editor.session().images.clone();
            self.open_site(site, images, None);
            self.act(Action::Note(format!("Read as {}. {}", format.name, notes.join("; "))));
            return;
        }
        self.act(Action::Import(Box::new(site), notes));
    }
}
