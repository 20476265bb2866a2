//! Stills that come in: read off the frame's path, then taken as cameras or in place of another.

use std::path::Path;

use calib_editor::file_name::{camera_name, mime};
use calib_editor::{Action, NewStill};
use egui::Context;

use crate::choice::Chosen;
use crate::platform::{Here, Platform as _, Task};
use crate::state::{App, Read, ReadPicture};

impl App {
    /// Begins to read a still that becomes a camera.
    pub fn add_still(&mut self, ctx: &Context, file: Chosen) {
        let task = self.read_still(ctx, file);
        self.adding.push(task);
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
        Here::size_of(ctx, file.name, read, |size, drawn| ReadPicture {
            still: NewStill { image: name, title, size },
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
        let ReadPicture { still, drawn } = picture;
        let Some(png) = drawn else { return still };
        let name = format!("{}.png", still.title);
        let image = self.editor.store_image(png.into(), "image/png", Some(&name));
        NewStill { image, ..still }
    }
}
