//! Long work that needs nothing but bytes: decoding, and finding edges. Natively on a thread of its own,
//! in the browser in a worker, so that frames go on.

use std::sync::Arc;

use calib_core::Pixel;
use egui::Context;
use image::RgbImage;

use crate::drawing;
use crate::edges::Edge;
use crate::files::Source;
use crate::task::Task;

/// Decodes an image; `then` makes of it what is wanted.
#[must_use]
pub fn decode<T: Send + 'static>(
    ctx: &Context,
    source: Source,
    then: impl FnOnce(RgbImage) -> T + Send + 'static,
) -> Task<Result<T, String>> {
    #[cfg(not(target_arch = "wasm32"))]
    {
        Task::spawn(ctx, move || Ok(then(crate::picture::decode(&source.read()?)?)))
    }
    #[cfg(target_arch = "wasm32")]
    Task::wait(ctx, async move { Ok(then(crate::web::worker::decode(source).await?)) })
}

/// Reads the picture of a file of this name for its size; a drawing becomes the picture that stands for it.
#[must_use]
pub(crate) fn read<T: Send + 'static>(
    ctx: &Context,
    name: String,
    source: Source,
    then: impl FnOnce([u32; 2], Option<Vec<u8>>) -> T + Send + 'static,
) -> Task<Result<T, String>> {
    #[cfg(not(target_arch = "wasm32"))]
    {
        Task::spawn(ctx, move || {
            let bytes = source.read()?;
            let picture = || {
                let drawn = if drawing::is_svg(&bytes) { Some(drawing::draw(&bytes)?) } else { None };
                let image = crate::picture::decode(drawn.as_deref().unwrap_or(&bytes))?;
                Ok(then(image.dimensions().into(), drawn))
            };
            picture().map_err(|error: String| format!("{name}: {error}"))
        })
    }
    #[cfg(target_arch = "wasm32")]
    Task::wait(ctx, async move {
        let picture = async {
            let bytes = if source.made_by_name().is_some() { None } else { Some(source.clone().read()?) };
            let drawn = match bytes.filter(|bytes| drawing::is_svg(bytes)) {
                Some(bytes) => Some(crate::web::draw(&bytes).await?),
                None => None,
            };
            let image = match &drawn {
                Some(png) => crate::web::worker::pixels(png).await?,
                None => crate::web::worker::decode(source).await?,
            };
            Ok(then(image.dimensions().into(), drawn))
        };
        picture.await.map_err(|error: String| format!("{name}: {error}"))
    })
}

/// Finds the straight edges of an image.
#[must_use]
pub fn find_edges(ctx: &Context, image: &Arc<RgbImage>) -> Task<Vec<Edge>> {
    let image = Arc::clone(image);
    #[cfg(not(target_arch = "wasm32"))]
    {
        Task::spawn(ctx, move || crate::edges::find(&image))
    }
    #[cfg(target_arch = "wasm32")]
    Task::wait(ctx, async move {
        // Without them one draws by hand.
        crate::web::worker::edges(&image).await.unwrap_or_default()
    })
}

/// Edges as numbers, four each.
#[must_use]
pub fn to_numbers(edges: &[Edge]) -> Vec<f64> {
    edges.iter().flatten().flat_map(|pixel| [pixel.u, pixel.v]).collect()
}

/// Edges of numbers.
#[must_use]
pub fn from_numbers(numbers: &[f64]) -> Vec<Edge> {
    numbers.chunks_exact(4).map(|n| [Pixel::new(n[0], n[1]), Pixel::new(n[2], n[3])]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_survive_as_numbers() {
        let edges =
            [[Pixel::new(1.0, 2.0), Pixel::new(3.0, 4.0)], [Pixel::new(5.0, 6.5), Pixel::new(7.0, 8.0)]];
        assert_eq!(from_numbers(&to_numbers(&edges)), edges);
    }
}
