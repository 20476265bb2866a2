//! Work on the rows of a picture, on as many threads as there are, and in the browser on one.

/// A picture of `width x height` whose rows `fill` makes, each by itself: so the number of threads
/// does not show in the result.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn rows_of<T, F>(width: usize, height: usize, fill: F) -> Vec<T>
where
    T: Clone + Default + Send,
    F: Fn(usize, &mut [T]) + Sync,
{
    use std::sync::Mutex;

    let mut all = vec![T::default(); width * height];
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    // Rows differ in what they cost: a thread takes the next one when it has done its own.
    let rows = Mutex::new(all.chunks_mut(width.max(1)).enumerate());
    let next = || rows.lock().ok().and_then(|mut rows| rows.next());
    let work = || {
        while let Some((y, row)) = next() {
            fill(y, row);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    all
}

/// A picture of `width x height` whose rows `fill` makes.
#[cfg(target_arch = "wasm32")]
pub(crate) fn rows_of<T, F>(width: usize, height: usize, fill: F) -> Vec<T>
where
    T: Clone + Default + Send,
    F: Fn(usize, &mut [T]) + Sync,
{
    let mut all = vec![T::default(); width * height];
    for (y, row) in all.chunks_mut(width.max(1)).enumerate() {
        fill(y, row);
    }
    all
}
