//! Unique ids for cameras whose files have the same name, from the folders of the files.

use std::collections::{HashMap, HashSet};

/// Camera whose id may be shared with other cameras.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Named<'a> {
    pub(crate) id: &'a str,
    /// Path of the camera's file or image. Empty if unknown.
    pub(crate) path: &'a str,
}

/// Returns unique ids. The parts in which the paths of two cameras with the same id differ replace this id, or precede
/// it. `None` if the ids are unique already, or if the paths do not distinguish the cameras.
pub(crate) fn distinct(cameras: &[Named]) -> Option<Vec<String>> {
    let mut groups: HashMap<&str, Vec<usize>> = HashMap::new();
    for (index, camera) in cameras.iter().enumerate() {
        groups.entry(camera.id).or_default().push(index);
    }
    groups.retain(|_, group| group.len() > 1);
    if groups.is_empty() {
        return None;
    }
    let mut differences: HashMap<usize, String> = HashMap::new();
    for group in groups.values() {
        let paths: Vec<Vec<&str>> = group.iter().map(|&index| parts(cameras[index].path)).collect();
        differences.extend(group.iter().copied().zip(distinct_parts(&paths)));
    }
    differences.retain(|_, difference| !difference.is_empty());
    let ids = |make: &dyn Fn(&str, &str) -> String| -> Vec<String> {
        let id = |(index, camera): (usize, &Named)| match differences.get(&index) {
            Some(difference) => make(difference, camera.id),
            None => camera.id.to_owned(),
        };
        cameras.iter().enumerate().map(id).collect()
    };
    let candidates = [ids(&|difference, _| difference.to_owned()), ids(&|part, id| format!("{part}-{id}"))];
    candidates.into_iter().find(|ids| ids.iter().collect::<HashSet<_>>().len() == ids.len())
}

/// Returns the folders of a path and its file name without the extension.
fn parts(path: &str) -> Vec<&str> {
    let (folders, base) = path.rsplit_once('/').unwrap_or(("", path));
    let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
    folders.split('/').chain([stem]).filter(|part| !matches!(*part, "" | "." | "..")).collect()
}

/// Returns the parts of each path without the parts that all paths share at the beginning and at the end.
fn distinct_parts(paths: &[Vec<&str>]) -> Vec<String> {
    let Some(first) = paths.first() else { return Vec::new() };
    let least = paths.iter().map(Vec::len).min().unwrap_or(0);
    let is_shared =
        |at: &dyn Fn(&Vec<&str>) -> Option<String>| paths.iter().all(|path| at(path) == at(first));
    let start = (0..least).take_while(|&i| is_shared(&|path| path.get(i).map(ToString::to_string))).count();
    let from_end = |path: &Vec<&str>, i: usize| path.iter().rev().nth(i).map(ToString::to_string);
    let end = (0..least - start).take_while(|&i| is_shared(&|path| from_end(path, i))).count();
    paths.iter().map(|path| path[start..path.len() - end].join("-")).collect()
}
