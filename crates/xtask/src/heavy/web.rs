//! `cargo xtask web`: the app for the browser, as files for any web host and as one page that needs none.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use base64::Engine as _;
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest as _, Sha256};
use wasm_bindgen_cli_support::Bindgen;

use crate::heavy::pictures::{Picture, pictures};
use crate::heavy::split::{Split, without};
use crate::heavy::wasm_build;
use crate::workspace::root;

/// The most that a browser has to fetch before the page can be worked with, gzipped, in bytes.
const MOST: usize = 2_200_000;
/// The most that it fetches then.
const MOST_OF_REST: usize = 700_000;

/// What `index.html` asks for in these places.
const HEAD: &str = "<!-- head -->";
const SCRIPTS: &str = "<!-- scripts -->";

/// Builds everything into `out`; the program too, if it is not `built`.
pub(crate) fn run(out: &Path, built: Option<&Path>) -> anyhow::Result<()> {
    let built = match built {
        Some(built) => built.to_path_buf(),
        None => program()?,
    };
    let glue = out.join("glue");
    // What an earlier version left would be served beside this one.
    if out.exists() {
        fs::remove_dir_all(out).with_context(|| out.display().to_string())?;
    }
    bind(&built, &glue)?;
    let parts = Parts::read(&glue)?;
    fs::remove_dir_all(&glue)?;
    for (name, part, most) in
        [("first", &parts.split.first, MOST), ("the rest", &parts.split.rest, MOST_OF_REST)]
    {
        let zipped = gzip(part)?.len();
        println!(
            "{name}: {:.2} MB of WebAssembly, {:.2} MB gzipped",
            part.len() as f64 / 1e6,
            zipped as f64 / 1e6
        );
        // With a standard library that others have built it is what it is.
        let is_light = zipped <= most || !wasm_build::builds_library();
        ensure!(is_light, "{name} is {zipped} bytes gzipped, at most {most} are allowed");
    }
    let bytes: usize = parts.pictures.iter().map(|picture| picture.jpeg.len()).sum();
    println!("{:.2} MB of pictures, fetched for the demonstration", bytes as f64 / 1e6);
    folder(&parts, out)?;
    let single = single(&parts)?;
    fs::write(out.join("calib.html"), &single)?;
    println!("{} and {}", out.join("index.html").display(), out.join("calib.html").display());
    Ok(())
}

/// How many bytes of the program a browser has to fetch before the page can be worked with, and then; without its few scripts.
pub(crate) fn weights() -> anyhow::Result<[usize; 2]> {
    let glue = root().join("target/web-glue");
    bind(&program()?, &glue)?;
    let Split { first, rest } = Split::of(&fs::read(glue.join("app_bg.wasm"))?, &glue)?;
    fs::remove_dir_all(&glue)?;
    Ok([gzip(&first)?.len(), gzip(&rest)?.len()])
}

/// Writes the program as a browser takes it, with the names of its functions, and the script that it speaks to the browser by.
fn bind(built: &Path, glue: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(glue)?;
    // What it says of features is of the standard library as well, which may have been built with types of references.
    let program = without(&fs::read(built)?, "target_features")?;
    Bindgen::new()
        .input_bytes("app", program)
        .out_name("app")
        .no_modules(true)?
        .typescript(false)
        .demangle(false)
        .remove_producers_section(true)
        .generate(glue)
}

/// Builds the program.
fn program() -> anyhow::Result<PathBuf> {
    let folder = wasm_build::build(&["--package", "calib-app", "--bin", "calib-app", "--profile", "web"])?;
    Ok(folder.join("web/calib-app.wasm"))
}

/// What the page is made of.
struct Parts {
    /// The program in one part.
    whole: Vec<u8>,
    /// The same in two.
    split: Split,
    html: String,
    style: String,
    icon: String,
    worker: String,
    manifest: String,
    /// Of the demonstration.
    pictures: Vec<Picture>,
    /// In the order in which they run.
    scripts: [(&'static str, String); 3],
    /// How a program in two parts is one.
    rest: (&'static str, String),
}

impl Parts {
    fn read(glue: &Path) -> anyhow::Result<Self> {
        let text = |path: PathBuf| fs::read_to_string(&path).with_context(|| path.display().to_string());
        let page = |name: &str| text(root().join("crates/calib-app/web").join(name));
        let named = fs::read(glue.join("app_bg.wasm"))?;
        Ok(Self {
            split: Split::of(&named, glue)?,
            whole: without(&named, "name")?,
            html: page("index.html")?,
            style: page("page.css")?,
            icon: page("icon.svg")?,
            worker: page("sw.js")?,
            manifest: page("manifest.webmanifest")?,
            pictures: pictures()?,
            scripts: [
                ("store", page("store.js")?),
                ("app", text(glue.join("app.js"))?),
                ("page", page("page.js")?),
            ],
            rest: ("rest", page("rest.js")?),
        })
    }
}

/// Static files. Names carry what is in them, so that no cache mixes versions.
fn folder(parts: &Parts, out: &Path) -> anyhow::Result<()> {
    let Split { first, rest } = &parts.split;
    let mut files: Vec<(String, &[u8])> =
        vec![(named("calib", "wasm", first), first), (named("rest", "wasm", rest), rest)];
    let mut tags = String::new();
    let [store, (app, glue), page_script] = &parts.scripts;
    let glue = (*app, joined(glue)?);
    for (name, script) in [store, &parts.rest, &glue, page_script] {
        let file = named(name, "js", script.as_bytes());
        tags += &format!("<script src=\"{file}\"{} defer></script>\n", id(name));
        files.push((file, script.as_bytes()));
    }
    let style = named("page", "css", parts.style.as_bytes());
    let policy = policy("'self'", "'self'", "'self'");
    let head = format!(
        "{policy}\n<link rel=\"manifest\" href=\"manifest.webmanifest\">\n<link rel=\"icon\" href=\"icon.svg\">\n\
         <link rel=\"preload\" href=\"{}\" as=\"fetch\" type=\"application/wasm\" crossorigin>\n\
         <link rel=\"stylesheet\" href=\"{style}\">",
        files[0].0
    );
    let mut shown = serde_json::Map::new();
    for Picture { name, jpeg } in &parts.pictures {
        // Fetched by those who open the demonstration, and not kept for others.
        let file = named("demonstration", "jpg", jpeg);
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

/// The script that a program speaks to the browser by, for one whose rest comes later.
fn joined(glue: &str) -> anyhow::Result<String> {
    let mut joined = glue.to_string();
    for (there, instead) in [
        ("\"./app_bg.js\": import0,", "\"./app_bg.js\": import0, \"rest\": calibRest.placeholders,"),
        ("wasm = instance.exports;", "wasm = calibRest.first = instance.exports;"),
    ] {
        ensure!(glue.matches(there).count() == 1, "wasm-bindgen writes {there} no longer once");
        joined = joined.replace(there, instead);
    }
    Ok(joined)
}

/// One page with everything in it; a folder on a stick is host enough.
fn single(parts: &Parts) -> anyhow::Result<String> {
    // A script ends where its text says so, even within a string.
    let inline = |text: &str| text.replace("</script", "<\\/script").replace("<!--", "<\\!--");
    let scripts: Vec<String> =
        parts.scripts.iter().map(|(_, script)| format!("\n{}", inline(script))).collect();
    let allowed: Vec<String> = scripts.iter().map(|script| allow(script)).collect();
    let policy = policy(&allowed.join(" "), &allow(&parts.style), "'none'");
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
    let tags: String =
        named.map(|((name, _), script)| format!("<script{}>{script}</script>\n", id(name))).collect();
    let pictures = parts.pictures.iter().map(|Picture { name, jpeg }| {
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
    html.replace("<html lang=\"en\">", &root).replace(HEAD, head).replace(SCRIPTS, scripts)
}

/// The worker finds by it what the page runs, too.
fn id(script: &str) -> &'static str {
    match script {
        "app" => " id=\"glue\"",
        "rest" => " id=\"rest\"",
        _ => "",
    }
}

/// Nothing from elsewhere, and nothing to elsewhere.
fn policy(scripts: &str, styles: &str, connections: &str) -> String {
    format!(
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src {scripts} \
         'wasm-unsafe-eval'; style-src {styles}; img-src 'self' data: blob:; connect-src {connections}; \
         manifest-src 'self'; worker-src 'self' blob:; base-uri 'none'; form-action 'none'\">"
    )
}

/// How a policy names a text that stands in the page.
fn allow(text: &str) -> String {
    format!("'sha256-{}'", base64(&Sha256::digest(text.as_bytes())))
}

fn base64(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// A short name for what is in a file.
fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().take(6).map(|byte| format!("{byte:02x}")).collect()
}

fn named(name: &str, end: &str, bytes: &[u8]) -> String {
    format!("{name}-{}.{end}", digest(bytes))
}

fn gzip(bytes: &[u8]) -> anyhow::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}
