//! Work on many files at once, by as many threads as are asked for.

use std::num::NonZeroUsize;
use std::sync::{Mutex, mpsc};

/// How many files are worked on at once.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct ThreadsArgs {
    /// Work on so many stills at once; each takes the memory of its image
    #[arg(long, value_name = "N", default_value = "1")]
    threads: NonZeroUsize,
}

impl ThreadsArgs {
    /// The results of all items, in their order; `done` is told of each as it ends. The first failure that is met ends
    /// the work: what was begun is finished, nothing more is.
    pub(crate) fn run<T: Send, R: Send, E: Send>(
        self,
        items: Vec<T>,
        work: impl Fn(T) -> Result<R, E> + Sync,
        mut done: impl FnMut(&R),
    ) -> Result<Vec<R>, E> {
        let mut results: Vec<Option<R>> = items.iter().map(|_| None).collect();
        let threads = self.threads.get().min(items.len());
        let items = Mutex::new(items.into_iter().enumerate());
        let next = || items.lock().map_or(None, |mut items| items.next());
        let (send, receive) = mpsc::channel();
        std::thread::scope(|scope| {
            for _ in 0..threads {
                let (send, next, work) = (send.clone(), &next, &work);
                scope.spawn(move || {
                    while let Some((index, item)) = next() {
                        if send.send((index, work(item))).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(send);
            // Whoever still works sends in vain once this loop is left.
            for (index, result) in receive {
                let result = result?;
                done(&result);
                results[index] = Some(result);
            }
            Ok(())
        })?;
        Ok(results.into_iter().flatten().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_what_they_are_of() {
        for threads in [1, 3, 40] {
            let threads = ThreadsArgs { threads: NonZeroUsize::new(threads).unwrap() };
            let mut told = 0;
            let twice = threads.run((0..20).collect(), |item| Ok::<_, ()>(2 * item), |_| told += 1);
            assert_eq!((twice.unwrap(), told), ((0..20).map(|item| 2 * item).collect::<Vec<_>>(), 20));
            let fails = |item| if item == 7 { Err(item) } else { Ok(item) };
            assert_eq!(threads.run((0..20).collect(), fails, |_| ()), Err(7));
            assert_eq!(threads.run(Vec::new(), fails, |_| ()), Ok(Vec::new()));
        }
    }
}
