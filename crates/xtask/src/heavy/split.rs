//! The program of the page in two parts: what the first picture, drawing and solving need, and the rest, which comes while they
//! are looked at. Nothing is in both: the rest puts its functions into the table of the first part (`web/rest.js`).

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, ensure};
use wasmparser::{KnownCustom, Name, Naming, Parser, Payload, TypeRef};

/// What the rest is made of: what is of these crates or modules, and what is made for them.
const REST: [&str; 47] = [
    // Files of others, and what they and the operator's own are written in.
    "calib_formats",
    "saphyr",
    "saphyr_parser",
    "toml",
    "toml_parser",
    "toml_datetime",
    "serde_path_to_error",
    "serde_json::ser::PrettyFormatter",
    "calib_report::page",
    "calib_report::plan_view",
    "roxmltree",
    "kurbo::stroke",
    "jiff",
    "jiff_core",
    // Stills: their files, and what is looked for in them.
    "calib_input",
    "calib_image::compare",
    "calib_image::proposal",
    "calib_health",
    "calib_site::recovered",
    "image",
    "zune_jpeg",
    "zune_core",
    "png",
    "fdeflate",
    "miniz_oxide",
    "flate2",
    "exif",
    "lsdetect",
    "rayon",
    "rayon_core",
    // Kinds of fonts and of scripts that the page has none of.
    "read_fonts::ps",
    "read_fonts::tables::aat",
    "read_fonts::tables::variations",
    "skrifa::outline::autohint",
    "skrifa::outline::cff",
    "skrifa::outline::varc",
    "harfrust::hb::aat",
    "harfrust::hb::ot_shaper_arabic",
    "harfrust::hb::ot_shaper_hangul",
    "harfrust::hb::ot_shaper_indic",
    "harfrust::hb::ot_shaper_khmer",
    "harfrust::hb::ot_shaper_myanmar",
    "harfrust::hb::ot_shaper_use",
    "harfrust::hb::ot_shaper_vowel_constraints",
    "harfrust::hb::tag_table",
    // What workers do, and where a fault was, in words.
    "calib_app::browser::worker",
    "rustc_demangle",
];

/// Reading of types, and types of ours: what has both in its name reads a site.
const READS: [&str; 2] = ["serde_core::de", "calib_site"];

/// What is shorter stays, in bytes: what a call to the other part needs is as long.
const SHORT: usize = 150;

/// What is the same code for many types stays: the compiler makes one of it, with the name of any.
const SHARED: [&str; 4] = ["alloc", "core::option", "core::ptr", "hashbrown"];

/// What both parts may have of WebAssembly beyond its first version.
const FEATURES: [&str; 6] = [
    "--enable-bulk-memory",
    "--enable-multivalue",
    "--enable-mutable-globals",
    "--enable-nontrapping-float-to-int",
    "--enable-sign-ext",
    "--enable-simd",
];

/// A program in two parts.
pub(crate) struct Split {
    pub(crate) first: Vec<u8>,
    pub(crate) rest: Vec<u8>,
}

impl Split {
    /// Splits a program that has the names of its functions, as compilers write them; `folder` holds what is between.
    pub(crate) fn of(program: &[u8], folder: &Path) -> anyhow::Result<Self> {
        let [named, list, first, rest] =
            ["named.wasm", "rest.txt", "first.wasm", "rest.wasm"].map(|name| folder.join(name));
        fs::write(&named, program)?;
        let functions = functions(program)?;
        let is_of_rest = |function: &&Function| function.length >= SHORT && is_of_rest(function.name);
        let of_rest: Vec<&str> = functions.iter().filter(is_of_rest).map(|function| function.name).collect();
        ensure!(!of_rest.is_empty(), "the program has no names, so that it cannot be split");
        fs::write(&list, of_rest.join("\n"))?;
        let mut split = Command::new("wasm-split");
        split.arg(&named).args(FEATURES).arg(format!("--split-funcs=@{}", list.display()));
        split.arg("-o1").arg(&first).arg("-o2").arg(&rest);
        // Which part imports from which: of these names `rest.js` and the glue know.
        split.args(["--import-namespace=first", "--placeholder-namespace=rest"]);
        let output =
            split.output().context("wasm-split does not run: on Debian `apt-get install binaryen`")?;
        ensure!(output.status.success(), "wasm-split: {}", String::from_utf8_lossy(&output.stderr));
        Ok(Self { first: fs::read(&first)?, rest: fs::read(&rest)? })
    }
}

/// A program without the custom section of a name: its other sections as they are.
pub(crate) fn without(program: &[u8], name: &str) -> anyhow::Result<Vec<u8>> {
    // A section begins, with its kind and its length, where the one before ends; the first does behind the header.
    const HEADER: usize = 8;
    let mut others = program[..HEADER.min(program.len())].to_vec();
    let mut start = HEADER;
    for payload in Parser::new(0).parse_all(program) {
        let payload = payload?;
        let Some((_, range)) = payload.as_section() else { continue };
        if !matches!(&payload, Payload::CustomSection(section) if section.name() == name) {
            others.extend(&program[start..range.end]);
        }
        start = range.end;
    }
    Ok(others)
}

/// A function of a program.
struct Function<'a> {
    name: &'a str,
    /// Of its code, in bytes.
    length: usize,
}

/// The functions with a name; of a program with one table, because older versions of what splits it take all for the first.
fn functions(program: &[u8]) -> anyhow::Result<Vec<Function<'_>>> {
    let (mut imported, mut lengths, mut functions) = (0, Vec::new(), Vec::new());
    for payload in Parser::new(0).parse_all(program) {
        match payload? {
            Payload::ImportSection(imports) => {
                for import in imports.into_imports() {
                    imported += usize::from(matches!(import?.ty, TypeRef::Func(_)));
                }
            }
            Payload::TableSection(tables) => ensure!(
                tables.count() == 1,
                "the program has {} tables: build it with -Ctarget-feature=-reference-types",
                tables.count()
            ),
            Payload::CodeSectionEntry(body) => lengths.push(body.range().len()),
            Payload::CustomSection(section) => {
                let KnownCustom::Name(sections) = section.as_known() else { continue };
                for section in sections {
                    let Name::Function(names) = section? else { continue };
                    for named in names {
                        let Naming { index, name } = named?;
                        let own = (index as usize).checked_sub(imported);
                        let length = own.and_then(|own| lengths.get(own).copied());
                        functions.extend(length.map(|length| Function { name, length }));
                    }
                }
            }
            _ => {}
        }
    }
    Ok(functions)
}

/// Whether a function, by the name that a compiler wrote, is of the rest.
fn is_of_rest(name: &str) -> bool {
    let path = format!("{:#}", rustc_demangle::demangle(name));
    let own = path.trim_start_matches(['<', '&', '[', '(']).trim_start_matches("mut ");
    let is_in = |part: &&str| own.strip_prefix(*part).is_some_and(|inner| inner.starts_with("::"));
    let is_shared = SHARED.iter().any(is_in);
    let reads = READS.iter().all(|part| path.contains(part));
    reads || !is_shared && REST.iter().any(|part| mentions(&path, part))
}

/// Whether a path or an argument in it begins with these modules.
fn mentions(path: &str, modules: &str) -> bool {
    path.match_indices(modules).any(|(at, _)| {
        let is_inner =
            path[..at].ends_with(|before: char| before == ':' || before == '_' || before.is_alphanumeric());
        !is_inner && path[at + modules.len()..].starts_with("::")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_reads_files_is_of_the_rest_and_what_is_made_for_many_types_is_not() {
        for (name, is_there) in [
            ("calib_formats::opencv::read", true),
            ("<&mut png::decoder::Reader<R> as std::io::Read>::read", true),
            ("core::iter::adapters::map::Map::<toml::Value>::next", true),
            ("<calib_site::Site as serde_core::de::Deserialize>::deserialize", true),
            ("<serde_json::Value as serde_core::de::Deserialize>::deserialize", false),
            ("<alloc::raw_vec::RawVec<calib_formats::file::File>>::grow_one", false),
            ("core::ptr::drop_in_place::<image::dynamic::DynamicImage>", false),
            ("calib_core::camera::projection::project", false),
        ] {
            assert_eq!(is_of_rest(name), is_there, "{name}");
        }
    }

    #[test]
    fn crates_and_modules_are_found_where_paths_begin() {
        assert!(mentions("<&mut png::decoder::Reader<R>>::read", "png"));
        assert!(mentions("core::ptr::drop_in_place::<image::dynamic::DynamicImage>", "image"));
        assert!(!mentions("calib_draw::image::on_image", "image"));
        assert!(!mentions("xpng::decoder", "png"));
        assert!(!mentions("calib_report::pages", "calib_report::page"));
    }
}
