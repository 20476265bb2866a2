//! Platform of the desktop: files, threads, and the file dialogs of the system.

mod files;
mod task;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use calib_editor::{AllowedFiles, Edge, FileResult, Source};
use calib_image::{AutomaticCalibration, Comparison, ImageEdges, SitePlacement};
use calib_plan::{Part, View};
use calib_site::{Recovered, Site, SiteCamera};
use egui::Context;
use image::RgbImage;

use crate::choice::{Chosen, Purpose};
use crate::drawing::DecodedImage;
use crate::platform::{
    Answer, FrameRequest, PlacementRequest, Platform, Progress, Recovery, SnapshotFile, SnapshotRequest,
    Stills, VideoFrames,
};

/// Desktop platform.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Native;

impl Platform for Native {
    const KEEPS_CTRL_N: bool = false;
    const HAS_FOLDERS: bool = true;
    const HAS_ADDRESSES: bool = true;
    const HAS_OTHER_DECODERS: bool = false;
    const MEDIUM_FONT: &'static [u8] = include_bytes!("../../../assets/IBMPlexSans-Medium.ttf");
    const NOTICES: &'static str = include_str!("../../../assets/THIRD-PARTY.txt");
    type Claim = files::Claim;

    fn wants_stillness() -> bool {
        false
    }

    fn read(path: &Path) -> FileResult<Vec<u8>> {
        files::read(path)
    }

    fn read_within(path: &Path, reach: &AllowedFiles) -> FileResult<Vec<u8>> {
        files::read_within(path, reach)
    }

    fn real(path: &Path) -> Option<PathBuf> {
        path.canonicalize().ok()
    }

    fn write(path: &Path, bytes: &[u8]) -> FileResult<()> {
        files::write(path, bytes)
    }

    fn write_quickly(path: &Path, bytes: &[u8]) -> FileResult<()> {
        files::write_quickly(path, bytes)
    }

    fn now() -> Option<u64> {
        std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).ok().map(|since| since.as_secs())
    }

    fn is_read_only(path: &Path) -> bool {
        std::fs::metadata(path).is_ok_and(|file| file.permissions().readonly())
    }

    fn data_dir() -> Option<PathBuf> {
        files::data_dir()
    }

    fn files_in(folder: &Path) -> Option<Vec<PathBuf>> {
        files::files_in(folder)
    }

    fn head(path: &Path, bytes: usize) -> Vec<u8> {
        files::head(path, bytes)
    }

    fn claim(folder: &Path) -> Option<Self::Claim> {
        files::Claim::of(folder)
    }

    fn forget(folder: &Path, file: &Path) {
        files::forget(folder, file);
    }

    fn ask(purpose: Purpose) -> Answer {
        files::ask(purpose)
    }

    fn dropped(_: &Context, files: Vec<egui::DroppedFileHandle>) -> Task<Vec<Chosen>> {
        Task::done(files.into_iter().map(|file| Chosen::of_path(file.path().to_path_buf())).collect())
    }

    fn picture<T: Send + 'static>(
        ctx: &Context,
        source: Source,
        view: View,
        then: impl FnOnce(DecodedImage) -> T + Send + 'static,
    ) -> Task<Result<T, String>> {
        task::picture(ctx, source, view, then)
    }

    fn draw_part(ctx: &Context, svg: Arc<[u8]>, part: Part) -> Task<Result<RgbImage, String>> {
        task::draw_part(ctx, svg, part)
    }

    fn still<T: Send + 'static>(
        ctx: &Context,
        name: String,
        source: Source,
        then: impl FnOnce(&[u8], DecodedImage, Option<Vec<u8>>) -> T + Send + 'static,
    ) -> Task<Result<T, String>> {
        task::still(ctx, name, source, then)
    }

    fn frames(
        ctx: &Context,
        file: &Chosen,
        request: FrameRequest,
        progress: &Arc<Progress>,
    ) -> Task<Result<VideoFrames, String>> {
        task::frames(ctx, file, request, progress)
    }

    fn snapshot(ctx: &Context, request: SnapshotRequest) -> Task<Result<SnapshotFile, String>> {
        task::snapshot(ctx, request)
    }

    // Every request opens the file itself, so no video stays open.
    fn close_video() {}

    fn find_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Vec<Edge>> {
        task::find_edges(ctx, image)
    }

    fn measure_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Result<ImageEdges, String>> {
        task::measure_edges(ctx, image)
    }

    fn propose(
        ctx: &Context,
        camera: SiteCamera,
        edges: ImageEdges,
    ) -> Task<Result<AutomaticCalibration, String>> {
        task::propose(ctx, camera, edges)
    }

    // The thread runs to its end; its result is dropped.
    fn stop_proposing() {}

    fn place(
        ctx: &Context,
        asked: PlacementRequest,
        progress: &Arc<Progress>,
    ) -> Task<Result<SitePlacement, String>> {
        task::place(ctx, asked, progress)
    }

    // The threads end with the next progress report.
    fn stop_placing() {}

    fn compare(ctx: &Context, camera: SiteCamera, stills: Stills) -> Task<Result<Comparison, String>> {
        task::compare(ctx, camera, stills)
    }

    fn recover(ctx: &Context, asked: Recovery, stills: Stills) -> Task<Result<Recovered, String>> {
        task::recover(ctx, asked, stills)
    }

    // The thread runs to its end; its result is dropped.
    fn stop_comparing() {}

    fn refine(ctx: &Context, site: Site) -> Task<Result<Site, String>> {
        task::refine(ctx, site)
    }

    // The thread runs to its end; its result is dropped.
    fn stop_refining() {}
}

pub use task::Task;
