//! Splits the WebAssembly program of the page into two parts.
//!
//! The first part contains the functions for the first frame, for drawing and for solving. The second part is
//! loaded while the user looks at the page. No function is in both: the second part adds its functions to the
//! table of the first (`web/rest.js`).

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, ensure};
use wasmparser::{KnownCustom, Name, Naming, Parser, Payload, TypeRef};

/// Crates and modules whose functions, including instances of generic functions, are in the part of the
/// program that is loaded later.
const REST: [&str; 146] = [
    // Import, export and reports, and their file formats.
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
    "calib_report::coverage_layer",
    "calib_report::coverage_page",
    "calib_report::measurement_section",
    "calib_report::summary",
    "calib_site::coverage",
    "calib_site::coordinate_system",
    "calib_site::georeference_step",
    "calib_site::map_plan",
    "calib_core::floor::georeference",
    "proj4rs",
    "proj4rs_geodesic",
    "calib_site::measurement",
    "calib_core::floor::coverage",
    "calib_core::floor::density_border",
    "calib_core::floor::hand_over",
    "calib_core::single::abramov",
    "calib_site::geographic::typed_degrees",
    "calib_site::geographic::angle",
    "calib_core::floor::pixel_density",
    "roxmltree",
    "kurbo::arc",
    "kurbo::cubicbez",
    "kurbo::offset",
    "kurbo::stroke",
    "calib_app::compare::panel::glance",
    "calib_app::compare::panel::judgement",
    "calib_app::compare::panel::numbers",
    "calib_app::compare::panel::since",
    "calib_app::export",
    "calib_app::detail",
    "calib_app::files::address",
    "calib_app::state::address",
    "calib_app::files::answers",
    "calib_app::files::open",
    "calib_app::files::outside::asked_ui",
    "calib_app::files::video",
    "calib_app::annotate::annotations::usual_size_menu",
    "calib_app::annotate::known_values::choose",
    "calib_app::annotate::known_values::contents",
    "calib_app::annotate::known_values::data_sheet",
    "calib_app::annotate::known_values::pixel_aspect",
    "calib_app::annotate::known_values::principal_point",
    "calib_app::annotate::links",
    "calib_app::annotate::measurements",
    "calib_app::annotate::result::scale_menu",
    "calib_app::plan::coverage",
    "calib_app::plan::survey",
    "calib_app::plan::north",
    "calib_app::plan::drawing_fields",
    "calib_app::plan::agreement",
    "calib_app::plan::distances::controls",
    "calib_app::plan::distances::distances_ui",
    "calib_app::plan::ground_points",
    "calib_app::plan::placement",
    "calib_app::plan::planes::known_number",
    "calib_app::plan::planes::name_field",
    "calib_app::plan::planes::region_buttons",
    "calib_app::plan::planes::row",
    "calib_app::scene3d",
    "calib_app::state::coverage",
    "calib_app::state::measurements",
    "calib_app::propose",
    "calib_app::state::automatic",
    "calib_app::state::video",
    "calib_app::shell::palette",
    "calib_app::shell::tour",
    "calib_editor::apply::places",
    "calib_editor::apply::proposing",
    "calib_editor::proposed",
    "calib_editor::tools::control",
    "calib_editor::tools::corners",
    "calib_editor::tools::link",
    "calib_editor::tools::mark",
    "calib_editor::tools::measure",
    "calib_editor::tools::survey",
    "calib_plan::dxf",
    "calib_plan::map_position",
    "calib_plan::read",
    "jiff",
    "jiff_core",
    // Image files and image analysis.
    "calib_input",
    "calib_image::compare",
    "calib_image::proposal",
    "calib_image::bars",
    "calib_image::registration",
    "calib_image::pull",
    "calib_health",
    "calib_site::recovered",
    "calib_site::document::Site>::coverage",
    "calib_site::document::Site>::lens_of_window",
    "calib_site::document::Site>::measure",
    "calib_site::document::Site>::recovered",
    "calib_site::document::Site>::windowed",
    "calib_site::document::Site>::with_start_aspect",
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
    // Font formats and writing systems that the page does not use.
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
    // Methods that open and import files.
    "calib_app::state::app::App>::import",
    "calib_app::state::app::App>::open_files",
    "calib_app::state::app::App>::open_with_images",
    "calib_app::state::app::App>::refuse_import",
    "calib_app::state::app::App>::save_report",
    "calib_app::state::app::App>::show_plan",
    "calib_app::state::app::App>::take_imported",
    "calib_app::state::app::App>::without_folders",
    "calib_editor::editor::Editor>::apply_automatic",
    "calib_editor::editor::Editor>::decide_calibration",
    "calib_editor::editor::Editor>::on_newer",
    "calib_editor::editor::Editor>::rescale_to_image",
    "calib_editor::editor::Editor>::import",
    "calib_editor::editor::Editor>::import_camera",
    // Web workers, and symbol names in crash reports.
    "calib_app::browser::worker",
    "rustc_demangle",
];

/// Path in the names of functions that deserialise. If a name also contains one of the crates of [`DOCUMENT`], the
/// function reads a site, and belongs to the second part.
const DESERIALISATION: &str = "serde_core::de";

/// Crates whose types are in site files and in answers of workers.
const DOCUMENT: [&str; 3] = ["calib_site", "calib_core", "calib_plan"];

/// Length below which a function stays in the first part, in bytes. A shorter function would not reduce the first
/// part, because a call into the second part takes as many bytes.
const MIN_LENGTH_BYTES: usize = 150;

/// Modules whose functions always stay in the first part. The compiler merges identical instances for many
/// types, under the name of any of them.
const MERGED_MODULES: [&str; 4] = ["alloc", "core::option", "core::ptr", "hashbrown"];

/// WebAssembly features beyond its first version that both parts may use.
const WASM_FEATURES: [&str; 6] = [
    "--enable-bulk-memory",
    "--enable-multivalue",
    "--enable-mutable-globals",
    "--enable-nontrapping-float-to-int",
    "--enable-sign-ext",
    "--enable-simd",
];

/// Program in two parts.
pub(crate) struct Split {
    pub(crate) first: Vec<u8>,
    pub(crate) rest: Vec<u8>,
}

impl Split {
    /// Splits a program that contains its function names, as compilers write them. Intermediate files are
    /// written to `folder`.
    pub(crate) fn new(program: &[u8], folder: &Path) -> anyhow::Result<Self> {
        let [named, list, first, rest] =
            ["named.wasm", "rest.txt", "first.wasm", "rest.wasm"].map(|name| folder.join(name));
        fs::write(&named, program)?;
        let functions = functions(program)?;
        let is_in_second =
            |function: &&Function| function.length >= MIN_LENGTH_BYTES && is_in_rest(function.name);
        let in_second: Vec<&str> =
            functions.iter().filter(is_in_second).map(|function| function.name).collect();
        ensure!(!in_second.is_empty(), "the program cannot be split: it contains no function names");
        fs::write(&list, in_second.join("\n"))?;
        let mut split = Command::new("wasm-split");
        split.arg(&named).args(WASM_FEATURES).arg(format!("--split-funcs=@{}", list.display()));
        split.arg("-o1").arg(&first).arg("-o2").arg(&rest);
        // Import namespaces of the parts, which `rest.js` and the JavaScript glue use.
        split.args(["--import-namespace=first", "--placeholder-namespace=rest"]);
        let output = split
            .output()
            .context("cannot run wasm-split; on Debian, install it with `apt-get install binaryen`")?;
        ensure!(output.status.success(), "wasm-split: {}", String::from_utf8_lossy(&output.stderr));
        Ok(Self { first: fs::read(&first)?, rest: fs::read(&rest)? })
    }
}

/// Returns the program without the custom section of this name; all other sections are unchanged.
pub(crate) fn without_section(program: &[u8], name: &str) -> anyhow::Result<Vec<u8>> {
    // A section, with its kind and length, begins at the end of the previous one. The first section begins
    // after the header.
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

/// Function of a program.
struct Function<'a> {
    name: &'a str,
    /// Length of the function's code, in bytes.
    length: usize,
}

/// Returns the functions that have a name.
///
/// Fails if the program has several tables, because older versions of wasm-split place all functions in the first
/// table.
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

/// Whether the function with this mangled name belongs to the second part of the program.
fn is_in_rest(name: &str) -> bool {
    let path = format!("{:#}", rustc_demangle::demangle(name));
    let own = path.trim_start_matches(['<', '&', '[', '(']).trim_start_matches("mut ");
    let is_in = |part: &&str| own.strip_prefix(*part).is_some_and(|inner| inner.starts_with("::"));
    let is_shared = MERGED_MODULES.iter().any(is_in);
    let reads = path.contains(DESERIALISATION) && DOCUMENT.iter().any(|part| path.contains(part));
    reads || !is_shared && REST.iter().any(|part| mentions(&path, part))
}

/// Whether the path of a function, or the path of one of its generic arguments, begins with these modules. The last part
/// can also be a method: `module::Type>::method`.
fn mentions(path: &str, modules: &str) -> bool {
    path.match_indices(modules).any(|(at, _)| {
        let is_inner =
            path[..at].ends_with(|before: char| before == ':' || before == '_' || before.is_alphanumeric());
        let after = &path[at + modules.len()..];
        !is_inner && (after.is_empty() || after.starts_with("::"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_readers_are_in_the_second_part_and_shared_generic_code_is_not() {
        for (name, expected) in [
            ("calib_formats::opencv::read", true),
            ("<&mut png::decoder::Reader<R> as std::io::Read>::read", true),
            ("core::iter::adapters::map::Map::<toml::Value>::next", true),
            ("<calib_site::Site as serde_core::de::Deserialize>::deserialize", true),
            ("<serde_json::Value as serde_core::de::Deserialize>::deserialize", false),
            ("<alloc::raw_vec::RawVec<calib_formats::file::File>>::grow_one", false),
            ("core::ptr::drop_in_place::<image::dynamic::DynamicImage>", false),
            ("calib_core::camera::projection::project", false),
        ] {
            assert_eq!(is_in_rest(name), expected, "{name}");
        }
    }

    #[test]
    fn crates_and_modules_match_only_at_the_start_of_a_path() {
        assert!(mentions("<&mut png::decoder::Reader<R>>::read", "png"));
        assert!(mentions("core::ptr::drop_in_place::<image::dynamic::DynamicImage>", "image"));
        assert!(!mentions("calib_draw::image::on_image", "image"));
        assert!(!mentions("xpng::decoder", "png"));
        assert!(!mentions("calib_report::pages", "calib_report::page"));
        assert!(mentions("<calib_app::App>::import", "calib_app::App>::import"));
        assert!(!mentions("<calib_app::App>::important", "calib_app::App>::import"));
    }
}
