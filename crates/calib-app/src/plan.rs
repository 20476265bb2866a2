//! The floor plan of a site: its picture, and the world file that says where it lies.

use std::path::Path;

use calib_editor::images::{has_ending, is_image};
use calib_editor::{Action, plan_told_by, world_endings};
use calib_formats::File;
use calib_site::Plan;
use egui::Context;

use crate::choice::Chosen;
use crate::state::{App, Mode, Planning};

/// Whether a file says where the picture of a plan lies.
pub(crate) fn is_world_file(file: &Chosen) -> bool {
    world_endings().iter().any(|ending| has_ending(Path::new(&file.name), ending))
}

/// Whether a world file is that of a picture: plan.pgw and plan.png. A drawing has no pixels to be told of.
fn is_of(world: &Chosen, picture: &Chosen) -> bool {
    let stem = |file: &Chosen| Path::new(&file.name).file_stem().map(ToOwned::to_owned);
    is_image(Path::new(&picture.name)) && stem(world) == stem(picture)
}

/// The plan that a world file tells of.
fn told_by(file: Chosen) -> Result<Plan, String> {
    let name = file.name.clone();
    let bytes = file.into_bytes().map_err(|error| format!("{name}: {error}"))?;
    plan_told_by(File { name, bytes })
}

/// The world file beside a picture on disk.
fn beside(picture: &Chosen) -> Option<Chosen> {
    let path = picture.path.as_deref().filter(|path| is_image(path))?;
    let path = world_endings().iter().map(|end| path.with_extension(end)).find(|path| path.is_file())?;
    let name = path.file_name()?.to_string_lossy().into_owned();
    Some(Chosen { name, path: Some(path), bytes: None })
}

impl App {
    /// Takes what was chosen for the plan: its picture, its world file, or both. A site has one plan;
    /// whatever else was chosen is named.
    pub fn load_plan(&mut self, ctx: &Context, chosen: Vec<Chosen>) {
        let (worlds, mut pictures): (Vec<_>, Vec<_>) = chosen.into_iter().partition(is_world_file);
        let mut worlds = worlds.into_iter();
        if pictures.is_empty() {
            if let Some(world) = worlds.next() {
                self.take_world_file(world);
            }
        } else {
            let picture = pictures.remove(0);
            let (mut own, others): (Vec<_>, Vec<_>) = worlds.partition(|world| is_of(world, &picture));
            let own = if own.is_empty() { beside(&picture) } else { Some(own.remove(0)) };
            self.read_plan(ctx, picture, own);
            worlds = others.into_iter();
        }
        let left: Vec<String> = pictures.into_iter().chain(worlds).map(|file| file.name).collect();
        if !left.is_empty() {
            self.act(Action::Complain(format!("Not taken, a site has one plan: {}.", left.join(", "))));
        }
    }

    /// Begins to read the picture of a plan that lies as `world` says.
    fn read_plan(&mut self, ctx: &Context, picture: Chosen, world: Option<Chosen>) {
        let told = world.map(told_by).transpose().unwrap_or_else(|error| {
            self.act(Action::Complain(error));
            None
        });
        self.planning = Some(Planning { picture: self.read_still(ctx, picture), told });
    }

    pub(crate) fn poll_plan(&mut self) {
        let Some(planning) = self.planning.take() else { return };
        match planning.picture.poll() {
            None => self.planning = Some(planning),
            Some(Ok(still)) => {
                let still = self.stored(still);
                self.act(Action::LoadPlan(still, planning.told));
                self.show(Mode::Plan);
                self.panes.views.clear();
            }
            Some(Err(error)) => self.act(Action::Complain(error)),
        }
    }

    fn take_world_file(&mut self, file: Chosen) {
        let name = file.name.clone();
        self.act(match told_by(file) {
            Ok(told) => Action::LayPlan(told, name),
            Err(error) => Action::Complain(error),
        });
    }

    /// Takes world files, and the pictures of the same name that they make plans, out of what was dropped.
    pub(crate) fn take_plans(&mut self, ctx: &Context, dropped: &mut Vec<Chosen>) {
        if !dropped.iter().any(is_world_file) {
            return;
        }
        let (worlds, others): (Vec<_>, Vec<_>) = std::mem::take(dropped).into_iter().partition(is_world_file);
        let (pictures, others): (Vec<_>, Vec<_>) =
            others.into_iter().partition(|file| worlds.iter().any(|world| is_of(world, file)));
        *dropped = others;
        self.load_plan(ctx, pictures.into_iter().chain(worlds).collect());
    }
}
