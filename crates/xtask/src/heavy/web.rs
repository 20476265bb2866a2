//! `cargo xtask web`: the app for the browser, as files for any web host and as one page that needs no host.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use base64::Engine as _;
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest as _, Sha256};
use wasm_bindgen_cli_support::Bindgen;

use crate::heavy::demo_images::{DemoImage, demo_images};
use crate::heavy::split::{Split, without_section};
use crate::heavy::wasm_build;
use crate::workspace::root;

/// Maximum gzipped size of the first part of the program, in bytes. The browser fetches it before the page is
/// usable.
const MAX_FIRST_BYTES: usize = 2_300_000;
/// Maximum gzipped size of the second part, in bytes. The browser fetches it later.
const MAX_REST_BYTES: usize = 1_080_000;

/// Placeholders in `index.html`.
const HEAD_PLACEHOLDER: &str = "<!-- head -->";
const SCRIPTS_PLACEHOLDER: &str = "<!-- scripts -->";

/// Builds the page into `out`; builds the program too if `built` is `None`.
pub(crate) fn run(out: &Path, built: Option<&Path>) -> anyhow::Result<()> {
    let built = match built {
        Some(built) => built.to_path_buf(),
        None => program()?,
    };
    let glue = out.join("glue");
    // Files of an earlier build would be served together with the new ones.
    if out.exists() {
        fs::remove_dir_all(out).with_context(|| out.display().to_string())?;
    }
    bind(&built, &glue)?;
    let parts = Parts::read(&glue)?;
    fs::remove_dir_all(&glue)?;
    for (name, part, most) in [
        ("first part", &parts.split.first, MAX_FIRST_BYTES),
        ("second part", &parts.split.rest, MAX_REST_BYTES),
    ] {
        let zipped = gzip(part)?.len();
        println!(
            "{name}: {:.2} MB of WebAssembly, {:.2} MB gzipped",
            part.len() as f64 / 1e6,
            zipped as f64 / 1e6
        );
        // The limit does not apply to a precompiled standard library, whose size we do not control.
        let is_light = zipped <= most || !wasm_build::builds_library();
        ensure!(is_light, "{name} has {zipped} bytes gzipped; the limit is {most}");
    }
    let bytes: usize = parts.pictures.iter().map(|picture| picture.jpeg.len()).sum();
    println!("{:.2} MB of images for the demonstration", bytes as f64 / 1e6);
    folder(&parts, out)?;
    let single = single(&parts)?;
    fs::write(out.join("calib.html"), &single)?;
    println!("{} and {}", out.join("index.html").display(), out.join("calib.html").display());
    Ok(())
}

/// Returns the gzipped sizes of the first and the second part of the program, in bytes, without the scripts.
pub(crate) fn gzipped_sizes() -> anyhow::Result<[usize; 2]> {
    let glue = root().join("target/web-glue");
    bind(&program()?, &glue)?;
    let Split { first, rest } = Split::new(&fs::read(glue.join("app_bg.wasm"))?, &glue)?;
    fs::remove_dir_all(&glue)?;
    Ok([gzip(&first)?.len(), gzip(&rest)?.len()])
}

/// Writes the program for the browser, with its function names, and the JavaScript glue.
fn bind(built: &Path, glue: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(glue)?;
    // The section `target_features` also lists features of the standard library, which may have been compiled with
    // reference types.
    let program = without_section(&fs::read(built)?, "target_features")?;
    Bindgen::new()
        .input_bytes("app", program)
        .out_name("app")
        .no_modules(true)?
        .typescript(false)
        .demangle(false)
        .remove_producers_section(true)
        .generate(glue)
}

/// Builds the program and returns its path.
fn program() -> anyhow::Result<PathBuf> {
    let folder = wasm_build::build(&["--package", "calib-app", "--bin", "calib-app", "--profile", "web"])?;
    Ok(folder.join("web/calib-app.wasm"))
}

/// Contents of the page.
struct Parts {
    /// Program in one part, for the self-contained page.
    whole: Vec<u8>,
    /// The same program in two parts, for a web host.
    split: Split,
    html: String,
    style: String,
    icon: String,
    worker: String,
    manifest: String,
    /// Images of the demonstration.
    pictures: Vec<DemoImage>,
    /// Names and texts of the scripts, in execution order.
    scripts: [(&'static str, String); 3],
    /// Script that joins the two parts of the program.
    rest: (&'static str, String),
}

impl Parts {
    fn read(glue: &Path) -> anyhow::Result<Self> {
        let text = |path: PathBuf| fs::read_to_string(&path).with_context(|| path.display().to_string());
        let page = |name: &str| text(root().join("crates/calib-app/web").join(name));
        let named = fs::read(glue.join("app_bg.wasm"))?;
        Ok(Self {
            split: Split::new(&named, glue)?,
            whole: without_section(&named, "name")?,
            html: page("index.html")?,
            style: page("page.css")?,
            icon: page("icon.svg")?,
            worker: page("sw.js")?,
            manifest: page("manifest.webmanifest")?,
            pictures: demo_images()?,
            scripts: [
                ("store", page("store.js")?),
                ("app", text(glue.join("app.js"))?),
                ("page", page("page.js")?),
            ],
            rest: ("rest", page("rest.js")?),
        })
    }
}

/// Writes the page as static files. File names contain a hash of the contents, so that caches never mix
/// versions.
fn folder(parts: &Parts, out: &Path) -> anyhow::Result<()> {
    let Split { first, rest } = &parts.split;
    let mut files: Vec<(String, &[u8])> =
        vec![(hashed_name("calib", "wasm", first), first), (hashed_name("rest", "wasm", rest), rest)];
    let mut tags = String::new();
    let [store, (app, glue), page_script] = &parts.scripts;
    let glue = (*app, glue_for_split(glue)?);
    for (name, script) in [store, &parts.rest, &glue, page_script] {
        let file = hashed_name(name, "js", script.as_bytes());
        tags += &format!("<script src=\"{file}\"{} defer></script>\n", id_attribute(name));
        files.push((file, script.as_bytes()));
    }
    let style = hashed_name("page", "css", parts.style.as_bytes());
    let policy = policy("'self'", "'self'", "'self'");
    let head = format!(
        "{policy}\n<link rel=\"manifest\" href=\"manifest.webmanifest\">\n<link rel=\"icon\" href=\"icon.svg\">\n\
         <link rel=\"preload\" href=\"{}\" as=\"fetch\" type=\"application/wasm\" crossorigin>\n\
         <link rel=\"stylesheet\" href=\"{style}\">",
        files[0].0
    );
    let mut shown = serde_json::Map::new();
    for DemoImage { name, jpeg } in &parts.pictures {
        // Fetched only when the demonstration is opened, and not cached by the service worker.
        let file = hashed_name("demonstration", "jpg", jpeg);
        fs::write(out.join(&file), jpeg)?;
        shown.insert(name.clone(), file.into());
    }
    let shown = serde_json::Value::Object(shown).to_string().replace('"', "&quot;");
    let data =
        format!(" data-wasm=\"{}\" data-rest=\"{}\" data-pictures=\"{shown}\"", files[0].0, files[1].0);
    let html = page(&parts.html, &head, &tags, &data, first.len());
    files.push((style, parts.style.as_bytes()));
    files.push(("icon.svg".into(), parts.icon.as_bytes()));
    files.push(("manifest.webmanifest".into(), parts.manifest.as_bytes()));
    for (name, bytes) in &files {
        fs::write(out.join(name), bytes)?;
    }
    fs::write(out.join("index.html"), &html)?;
    let names: Vec<String> = files.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    let version = digest(&[html.as_bytes(), parts.manifest.as_bytes(), parts.icon.as_bytes()].concat());
    let worker = parts.worker.replace("VERSION", &version);
    fs::write(out.join("sw.js"), worker.replace("/* FILES */", &format!("\"./\", {}", names.join(", "))))?;
    Ok(())
}

/// Adapts the JavaScript glue to a program whose second part is loaded later.
fn glue_for_split(glue: &str) -> anyhow::Result<String> {
    let mut joined = glue.to_string();
    for (there, instead) in [
        ("\"./app_bg.js\": import0,", "\"./app_bg.js\": import0, \"rest\": calibRest.placeholders,"),
        ("wasm = instance.exports;", "wasm = calibRest.first = instance.exports;"),
    ] {
        ensure!(
            glue.matches(there).count() == 1,
            "expected exactly one {there} in the output of wasm-bindgen"
        );
        joined = joined.replace(there, instead);
    }
    Ok(joined)
}

/// Builds one page that contains everything and also works from a local folder.
fn single(parts: &Parts) -> anyhow::Result<String> {
    // HTML ends a script at `</script`, even within a string.
    let inline = |text: &str| text.replace("</script", "<\\/script").replace("<!--", "<\\!--");
    let scripts: Vec<String> =
        parts.scripts.iter().map(|(_, script)| format!("\n{}", inline(script))).collect();
    let allowed: Vec<String> = scripts.iter().map(|script| hash_source(script)).collect();
    let policy = policy(&allowed.join(" "), &hash_source(&parts.style), "'none'");
    let icon = base64(parts.icon.as_bytes());
    let head = format!(
        "{policy}\n<link rel=\"icon\" href=\"data:image/svg+xml;base64,{icon}\">\n<style>{}</style>",
        parts.style
    );
    let program = format!(
        "<script type=\"application/octet-stream\" id=\"wasm\">{}</script>\n",
        base64(&gzip(&parts.whole)?)
    );
    let named = parts.scripts.iter().zip(&scripts);
    let tags: String = named
        .map(|((name, _), script)| format!("<script{}>{script}</script>\n", id_attribute(name)))
        .collect();
    let pictures = parts.pictures.iter().map(|DemoImage { name, jpeg }| {
        format!(
            "<script type=\"application/octet-stream\" data-picture=\"{name}\">{}</script>\n",
            base64(jpeg)
        )
    });
    let scripts = program + &pictures.collect::<String>() + &tags;
    Ok(page(&parts.html, &head, &scripts, "", parts.whole.len()))
}

fn page(html: &str, head: &str, scripts: &str, data: &str, size: usize) -> String {
    let root = format!("<html lang=\"en\"{data} data-size=\"{size}\">");
    html.replace("<html lang=\"en\">", &root)
        .replace(HEAD_PLACEHOLDER, head)
        .replace(SCRIPTS_PLACEHOLDER, scripts)
}

/// Returns the HTML attribute by which the web worker finds the scripts that it also runs.
fn id_attribute(script: &str) -> &'static str {
    match script {
        "app" => " id=\"glue\"",
        "rest" => " id=\"rest\"",
        _ => "",
    }
}

/// Builds the content security policy: resources from other origins and connections to them are blocked.
fn policy(scripts: &str, styles: &str, connections: &str) -> String {
    format!(
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src {scripts} \
         'wasm-unsafe-eval'; style-src {styles}; img-src 'self' data: blob:; media-src blob:; connect-src {connections}; \
         manifest-src 'self'; worker-src 'self' blob:; base-uri 'none'; form-action 'none'\">"
    )
}

/// Returns the policy source that allows this inline text.
fn hash_source(text: &str) -> String {
    format!("'sha256-{}'", base64(&Sha256::digest(text.as_bytes())))
}

fn base64(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// Returns a short hash of the contents of a file.
fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().take(6).map(|byte| format!("{byte:02x}")).collect()
}

fn hashed_name(name: &str, end: &str, bytes: &[u8]) -> String {
    format!("{name}-{}.{end}", digest(bytes))
}

fn gzip(bytes: &[u8]) -> anyhow::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}
