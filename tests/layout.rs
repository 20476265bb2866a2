//! The structure of the source: order of modules, sizes of files and functions, and forbidden dependencies.

use std::path::{Path, PathBuf};

use calib_tests::root;

/// Returns the modules declared in a `lib.rs` or `mod.rs`, in order.
fn modules(table: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(table).unwrap();
    let name = |line: &str| {
        line.trim_start_matches("pub(crate) ")
            .trim_start_matches("pub ")
            .strip_prefix("mod ")?
            .strip_suffix(';')
            .map(str::to_owned)
    };
    text.lines().filter_map(name).collect()
}

/// Returns the code of a file without comments and tests.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let code = code.split("#[cfg(test)]\npub(crate) mod tests").next().unwrap_or_default();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// Whether `code` names a module of `parent`, as in `crate::camera::Lens`, `crate::camera;` or, in a list,
/// `crate::{camera::Lens, floor}`.
fn names(code: &str, parent: &str, module: &str) -> bool {
    let is_named = |path: &str| {
        let rest = path.trim_start().strip_prefix(module);
        rest.is_some_and(|rest| !rest.starts_with(|next: char| next.is_alphanumeric() || next == '_'))
    };
    code.split(&format!("{parent}::")).skip(1).any(|path| match path.strip_prefix('{') {
        Some(list) => items(list).into_iter().any(is_named),
        None => is_named(path),
    })
}

/// Splits a list after its opening brace into items. Inner braces stay part of their item.
fn items(list: &str) -> Vec<&str> {
    let (mut items, mut depth, mut start) = (Vec::new(), 0, 0);
    for (at, next) in list.char_indices() {
        match next {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' if depth > 0 => {}
            ',' | '}' => {
                items.push(&list[start..at]);
                start = at + 1;
            }
            _ => {}
        }
        if next == '}' && depth == 0 && start == at + 1 {
            break;
        }
    }
    items
}

/// Returns the names of all crates with sources.
fn packages() -> Vec<String> {
    let entries = std::fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap());
    let crates = entries.filter(|entry| entry.path().join("src").is_dir());
    crates.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
}

#[test]
fn modules_of_every_crate_use_only_modules_above_them() {
    let packages = packages();
    assert!(packages.len() > 15, "{packages:?}");
    packages.iter().for_each(|package| assert_module_order(package));
}

/// Returns the file that declares the modules of a crate.
fn crate_root(source: &Path) -> PathBuf {
    ["lib.rs", "main.rs"].map(|name| source.join(name)).into_iter().find(|path| path.exists()).unwrap()
}

fn assert_module_order(package: &str) {
    let source = root().join("crates").join(package).join("src");
    let order = modules(&crate_root(&source));
    assert!(!order.is_empty(), "the list is read");
    let mut wrong = Vec::new();
    for (index, folder) in order.iter().enumerate() {
        let mut found = Vec::new();
        let path = source.join(folder);
        if path.is_dir() {
            files(&path, &mut found);
        } else {
            found.push(path.with_extension("rs"));
        }
        let is_tests = |path: &Path| path.file_name().is_some_and(|name| name == "tests.rs");
        for path in found.iter().filter(|path| path.extension().is_some_and(|e| e == "rs") && !is_tests(path))
        {
            let code = code(path);
            for below in order[index + 1..].iter().filter(|below| names(&code, "crate", below)) {
                wrong.push(format!("{} uses {below}", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn files_of_every_folder_use_only_files_above_them() {
    packages().iter().for_each(|package| assert_file_order(package));
}

fn assert_file_order(package: &str) {
    let source = root().join("crates").join(package).join("src");
    let mut wrong = Vec::new();
    for folder in modules(&crate_root(&source)).iter().filter(|name| source.join(name).is_dir()) {
        let order = modules(&source.join(folder).join("mod.rs"));
        assert!(!order.is_empty(), "{folder} has a table of contents");
        for (index, file) in order.iter().enumerate() {
            let path = source.join(folder).join(file);
            let path = if path.is_dir() { path.join("mod.rs") } else { path.with_extension("rs") };
            let code = code(&path);
            for below in &order[index + 1..] {
                if names(&code, &format!("crate::{folder}"), below) || names(&code, "super", below) {
                    wrong.push(format!("{folder}/{file} uses {below}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            if !matches!(name.as_str(), "target" | ".git" | "corpus" | "artifacts") {
                files(&path, found);
            }
        } else if matches!(path.extension().and_then(|e| e.to_str()), Some("rs" | "md" | "toml" | "css")) {
            found.push(path);
        }
    }
}

/// Returns the string literals in a line of code.
fn literals(line: &str) -> impl Iterator<Item = &str> {
    line.split('"').skip(1).step_by(2)
}

#[test]
fn sentences_of_the_core_are_in_one_folder() {
    let source = root().join("crates/calib-site/src");
    let mut found = Vec::new();
    files(&root().join("crates/calib-core/src"), &mut found);
    files(&root().join("crates/calib-health/src"), &mut found);
    files(&source, &mut found);
    let is_sentence = |text: &&str| text.ends_with('.') && text.matches(' ').count() > 2;
    let mut wrong = Vec::new();
    for path in found.iter().filter(|path| !path.starts_with(source.join("english"))) {
        let code = code(path);
        let sentences = code.lines().flat_map(literals).filter(is_sentence);
        wrong.extend(sentences.map(|text| format!("{}: {text}", path.display())));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn editor_uses_no_screen_files_or_threads() {
    let manifest = std::fs::read_to_string(root().join("crates/calib-editor/Cargo.toml")).unwrap();
    let mut found = Vec::new();
    files(&root().join("crates/calib-editor/src"), &mut found);
    for word in ["egui", "eframe", "epaint"] {
        assert!(!manifest.contains(word), "the editor depends on {word}");
    }
    for path in found {
        for word in ["egui", "std::fs", "std::thread", "std::env", "target_arch"] {
            assert!(!code(&path).contains(word), "{} has {word}", path.display());
        }
    }
}

#[test]
fn image_crate_uses_no_files_clocks_or_threads() {
    let mut found = Vec::new();
    files(&root().join("crates/calib-image/src"), &mut found);
    for path in found {
        for word in ["std::fs", "std::thread", "std::time", "std::env", "target_arch"] {
            assert!(!code(&path).contains(word), "{} has {word}", path.display());
        }
    }
}

/// Modules of the app that show panels. They send actions, which are applied at the end of the frame.
const PANELS: [&str; 6] = ["annotate", "plan", "compare", "shell", "propose.rs", "export.rs"];

#[test]
fn panels_send_actions_and_only_the_platform_depends_on_the_target() {
    let source = root().join("crates/calib-app/src");
    let mut found = Vec::new();
    files(&source, &mut found);
    for panels in PANELS {
        assert!(source.join(panels).exists(), "{panels}");
    }
    for path in found {
        let (code, name) = (code(&path), path.strip_prefix(&source).unwrap());
        let is_panel = PANELS.iter().any(|panels| name.starts_with(panels));
        let changes = code.contains(".act(") || code.contains(".apply(");
        assert!(!is_panel || !changes, "{} changes the document in the middle of a frame", name.display());
        // Only `main.rs`, the platform modules and one line of `lib.rs` may depend on the target.
        let lists = name == Path::new("lib.rs") && code.matches("target_arch").count() == 1;
        let may = name.starts_with("platform") || name == Path::new("main.rs") || lists;
        assert!(may || !code.contains("target_arch"), "{} asks where it runs", name.display());
    }
}

#[test]
fn top_level_contains_only_the_listed_entries() {
    let allowed = [
        "crates",
        "docs",
        "tests",
        "Cargo.toml",
        "Cargo.lock",
        "README.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "deny.toml",
        "LICENSE-MIT",
        "LICENSE-APACHE",
        "target",
    ];
    for entry in std::fs::read_dir(root()).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        let ours = name.starts_with('.') || allowed.contains(&name.as_str()) || name == "calib-demo";
        assert!(ours, "{name} does not belong at the top level");
    }
}

#[test]
fn core_uses_no_files_clocks_threads_or_output() {
    let banned = ["std::fs", "std::thread", "std::time", "println!", "eprintln!", "std::io", "std::env"];
    let mut found = Vec::new();
    for package in ["calib-core", "calib-site", "calib-health"] {
        files(&root().join("crates").join(package).join("src"), &mut found);
    }
    for path in found {
        let text = std::fs::read_to_string(&path).unwrap();
        for word in banned {
            assert!(!text.contains(word), "{} has {word}", path.display());
        }
    }
}

/// Line counts of all functions of a file, without its tests.
struct Lengths {
    path: String,
    found: Vec<(usize, String)>,
}

impl Lengths {
    fn add(&mut self, name: &syn::Ident, block: &syn::Block) {
        let braces = block.brace_token.span;
        let lines = braces.close().start().line.saturating_sub(braces.open().start().line + 1).max(1);
        self.found.push((lines, format!("{}: {name}", self.path)));
    }
}

fn is_of_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute.meta.require_list().is_ok_and(|list| list.tokens.to_string() == "test")
    })
}

impl<'ast> syn::visit::Visit<'ast> for Lengths {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_of_tests(&module.attrs) {
            syn::visit::visit_item_mod(self, module);
        }
    }

    fn visit_item_fn(&mut self, function: &'ast syn::ItemFn) {
        self.add(&function.sig.ident, &function.block);
        syn::visit::visit_item_fn(self, function);
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        self.add(&function.sig.ident, &function.block);
        syn::visit::visit_impl_item_fn(self, function);
    }
}

/// Returns the source files of all crates, without integration tests, benchmarks and examples.
fn sources() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root().join("crates")).unwrap() {
        let source = entry.unwrap().path().join("src");
        if source.is_dir() {
            files(&source, &mut found);
        }
    }
    found.retain(|path| path.extension().is_some_and(|extension| extension == "rs"));
    found
}

#[test]
fn functions_are_short() {
    let mut lengths = Vec::new();
    for path in sources() {
        let text = std::fs::read_to_string(&path).unwrap();
        let mut here = Lengths { path: path.display().to_string(), found: Vec::new() };
        syn::visit::Visit::visit_file(&mut here, &syn::parse_file(&text).unwrap());
        lengths.extend(here.found);
    }
    lengths.sort();
    let at = |share: f64| &lengths[(share * (lengths.len() - 1) as f64) as usize];
    println!("{} functions: median {:?}, 90th percentile {:?}", lengths.len(), at(0.5).0, at(0.9).0);
    assert!(at(0.5).0 <= 8 && at(0.9).0 <= 25 && at(1.0).0 <= 60, "{:?}", &lengths[lengths.len() - 10..]);
}

#[test]
fn source_files_are_short() {
    let long: Vec<String> = sources()
        .iter()
        .filter_map(|path| {
            let text = std::fs::read_to_string(path).unwrap();
            // Unit tests are at the end of a file and do not count.
            let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default().lines().count();
            (code > 800).then(|| format!("{}: {code} lines", path.display()))
        })
        .collect();
    assert!(long.is_empty(), "{}", long.join("\n"));
}

#[test]
fn every_importer_is_fuzzed_from_seeds() {
    let folder = root().join("crates/calib-formats/fuzz");
    let target = std::fs::read_to_string(folder.join("fuzz_targets/import.rs")).unwrap();
    for format in calib_formats::FORMATS.iter().filter(|format| format.can_import()) {
        assert!(target.contains(&format!("(\"{}\", Names::", format.name)), "{}", format.name);
        assert!(std::fs::read_dir(folder.join("seeds").join(format.name)).unwrap().count() > 0);
    }
}
