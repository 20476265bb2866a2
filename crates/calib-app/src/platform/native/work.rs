//! Long work that needs nothing but bytes, on threads.

use std::sync::Arc;

use calib_editor::{Edge, Source, decode, edges, refined};
use calib_image::{Comparison, LineSegment, Proposal, Still, line_segments};
use calib_site::{Recovered, Site, SiteCamera};
use egui::Context;
use image::RgbImage;

use super::drawing::draw;
use super::{Task, files};
use crate::drawing::is_svg;
use crate::platform::{Recovery, Stills};

pub(super) fn picture<T: Send + 'static>(
    ctx: &Context,
    source: Source,
    then: impl FnOnce(RgbImage) -> T + Send + 'static,
) -> Task<Result<T, String>> {
    Task::spawn(ctx, move || Ok(then(decode(&source.read(files::read_within)?)?)))
}

pub(super) fn still<T: Send + 'static>(
    ctx: &Context,
    name: String,
    source: Source,
    then: impl FnOnce(&[u8], &RgbImage, Option<Vec<u8>>) -> T + Send + 'static,
) -> Task<Result<T, String>> {
    Task::spawn(ctx, move || {
        let bytes = source.read(files::read_within)?;
        let picture = || {
            let drawn = if is_svg(&bytes) { Some(draw(&bytes)?) } else { None };
            let image = decode(drawn.as_deref().unwrap_or(&bytes))?;
            Ok(then(&bytes, &image, drawn))
        };
        picture().map_err(|error: String| format!("{name}: {error}"))
    })
}

pub(super) fn find_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Vec<Edge>> {
    let image = Arc::clone(image);
    Task::spawn(ctx, move || edges::find(&image))
}

pub(super) fn measure_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Result<Vec<LineSegment>, String>> {
    let image = Arc::clone(image);
    Task::spawn_apart(ctx, move || Ok(line_segments(&image)))
}

pub(super) fn propose(
    ctx: &Context,
    camera: SiteCamera,
    edges: Vec<LineSegment>,
) -> Task<Result<Proposal, String>> {
    Task::spawn_apart(ctx, move || Ok(Proposal::new(&Still::of_camera(&camera, edges))))
}

pub(super) fn compare(
    ctx: &Context,
    camera: SiteCamera,
    [old, new]: Stills,
) -> Task<Result<Comparison, String>> {
    Task::spawn_apart(ctx, move || {
        Comparison::of_entry(&camera, &old, &new).map_err(|error| error.to_string())
    })
}

pub(super) fn recover(ctx: &Context, asked: Recovery, [old, new]: Stills) -> Task<Result<Recovered, String>> {
    Task::spawn_apart(ctx, move || asked.done([&old, &new]))
}

pub(super) fn refine(ctx: &Context, site: Site) -> Task<Result<Site, String>> {
    Task::spawn_apart(ctx, move || Ok(refined(site)))
}
