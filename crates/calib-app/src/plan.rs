//! The floor plan of a site: its picture, and the world file that says where it lies.

use std::path::Path;

use calib_core::{Plan, PlanPixel};
use calib_formats::{FORMATS, File, Format};
use egui::Context;

use crate::app::{App, Mode};
use crate::dialog::Chosen;
use crate::files;
use crate::stills::NewStill;
use crate::task::Task;
use crate::tools::TOOLS;

/// A plan whose picture is being read.
#[derive(Debug)]
pub(crate) struct Planning {
    picture: Task<NewStill>,
    /// What its world file says.
    told: Option<Plan>,
}

/// World files, among the formats that are read.
fn format() -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.is_of_plan)
}

/// Endings of world files.
pub(crate) fn world_endings() -> &'static [&'static str] {
    format().map_or(&[], |format| format.extensions)
}

pub(crate) fn is_world_file(file: &Chosen) -> bool {
    world_endings().iter().any(|ending| files::has_ending(Path::new(&file.name), ending))
}

/// Whether a world file is that of a picture: plan.pgw and plan.png. A drawing has no pixels to be told of.
fn is_of(world: &Chosen, picture: &Chosen) -> bool {
    let stem = |file: &Chosen| Path::new(&file.name).file_stem().map(ToOwned::to_owned);
    files::is_image(Path::new(&picture.name)) && stem(world) == stem(picture)
}

/// The plan without its picture, as a world file has it.
fn told_by(file: Chosen) -> Result<Plan, String> {
    let name = file.name.clone();
    let bytes = file.into_bytes().map_err(|error| format!("{name}: {error}"))?;
    let format = format().ok_or_else(|| format!("{name}: no world files are read"))?;
    let read = calib_formats::import(format, &[File { name, bytes }]).map_err(|error| error.to_string())?;
    read.site.plan.ok_or_else(|| "A world file without a plan.".into())
}

/// The world file beside a picture on disk.
fn beside(picture: &Chosen) -> Option<Chosen> {
    let path = picture.path.as_deref().filter(|path| files::is_image(path))?;
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
            self.complain(format!("Not taken, a site has one plan: {}.", left.join(", ")));
        }
    }

    /// Begins to read the picture of a plan that lies as `world` says.
    fn read_plan(&mut self, ctx: &Context, picture: Chosen, world: Option<Chosen>) {
        let told = world.map(told_by).transpose().unwrap_or_else(|error| {
            self.complain(error);
            None
        });
        self.planning = Some(Planning { picture: self.read_still(ctx, picture), told });
    }

    pub(crate) fn poll_plan(&mut self) {
        let Some(planning) = self.planning.take() else { return };
        match planning.picture.poll() {
            None => self.planning = Some(planning),
            Some(Ok(still)) => {
                let name = self.stored(&still);
                self.set_plan(name, still.size, planning.told);
            }
            Some(Err(error)) => self.complain(error),
        }
    }

    fn set_plan(&mut self, image: String, size: [u32; 2], told: Option<Plan>) {
        let metres_per_px = self.session.site.plan.as_ref().map_or(0.02, |plan| plan.metres_per_px);
        let bare = Plan {
            image: None,
            metres_per_px,
            origin_px: PlanPixel::new(0.0, f64::from(size[1])),
            x_axis_deg: 0.0,
            georeference: None,
        };
        let is_scaled = told.is_some();
        let plan = Plan { image: Some(image), ..told.unwrap_or(bare) };
        self.session.site.plan = Some(plan);
        self.session.note = is_scaled.then(|| "The scale is that of the world file.".into());
        self.session.commit("load a plan");
        self.show(Mode::Plan);
        self.panes.views.clear();
        if !is_scaled {
            let measure = TOOLS.iter().position(|tool| tool.title == "Measure plan").unwrap_or(0);
            self.take_tool(measure);
        }
    }

    fn take_world_file(&mut self, file: Chosen) {
        let name = file.name.clone();
        match told_by(file) {
            Ok(told) => self.lay_plan(&told, &name),
            Err(error) => self.complain(error),
        }
    }

    /// Lays the plan that is there as another says, by whose name it is told.
    pub(crate) fn lay_plan(&mut self, told: &Plan, name: &str) {
        let Some(plan) = &mut self.session.site.plan else {
            self.complain(format!(
                "{name}: there is no plan whose place it could tell. Load the plan's picture together with it."
            ));
            return;
        };
        (plan.metres_per_px, plan.origin_px, plan.x_axis_deg) =
            (told.metres_per_px, told.origin_px, told.x_axis_deg);
        self.session.note = Some("The scale is that of the world file.".into());
        self.session.commit(format!("lay the plan as {name} says"));
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
