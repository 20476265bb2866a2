//! What every target does: read bytes as the files of one format, and write the site that comes of it.

use calib_core::Site;
use calib_formats::{File, import};

/// Separates the files of one input.
const CUT: &[u8] = b"\n-- file --\n";

/// Imports `bytes` as files of these names: no panic, and what is read is a valid site.
///
/// Where the format has one file, the first byte chooses its name; else [`CUT`] separates the files.
pub fn read(format: &str, names: &[&str], several: bool, bytes: &[u8]) {
    let file = |name: &str, bytes: &[u8]| File { name: name.into(), bytes: bytes.into() };
    let files: Vec<File> = if several {
        names.iter().zip(parts(bytes)).map(|(name, bytes)| file(name, bytes)).collect()
    } else {
        let Some((&first, rest)) = bytes.split_first() else { return };
        vec![file(names[usize::from(first) % names.len()], rest)]
    };
    let format = calib_formats::format(format).expect("a format of the list");
    let Ok(imported) = import(format, &files) else { return };
    if let Err(error) = Site::from_json(&imported.site.to_json()) {
        panic!("what was imported cannot be read: {error}");
    }
}

fn parts(mut bytes: &[u8]) -> Vec<&[u8]> {
    let mut parts = Vec::new();
    while let Some(at) = bytes.windows(CUT.len()).position(|window| window == CUT) {
        parts.push(&bytes[..at]);
        bytes = &bytes[at + CUT.len()..];
    }
    parts.push(bytes);
    parts
}
