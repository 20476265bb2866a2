//! `cargo xtask c`: the library for C and C++ with its header, and its tests under the sanitizers.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, ensure};

use crate::golden;
use crate::product::{build, profile};
use crate::workspace::{done, root};

const CRATE: &str = "crates/calib-c";
const HEADER: &str = "crates/calib-c/include/calib.h";
/// What the static library wants of the system.
const SYSTEM: [&str; 3] = ["-lpthread", "-ldl", "-lm"];
const STRICT: [&str; 6] = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror"];

/// The header, as the sources say it.
fn header() -> anyhow::Result<String> {
    let folder = root().join(CRATE);
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).map_err(anyhow::Error::msg)?;
    let mut builder = cbindgen::Builder::new().with_config(config);
    for file in ["raw", "words", "site", "camera", "mapping"] {
        builder = builder.with_src(folder.join("src").join(file).with_extension("rs"));
    }
    let mut text = Vec::new();
    builder.generate()?.write(&mut text);
    Ok(String::from_utf8(text)?)
}

/// Writes libraries, header and pkg-config file into `out`, as under a prefix.
pub(crate) fn run(out: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(root().join(CRATE).join("include"))?;
    fs::write(root().join(HEADER), header()?)?;
    let [lib, include] = ["lib", "include"].map(|folder| out.join(folder));
    fs::create_dir_all(lib.join("pkgconfig"))?;
    fs::create_dir_all(&include)?;
    let mut cargo = Command::new("cargo");
    done(cargo.args(["build", "--quiet", "--release", "--package", "calib-c"]).current_dir(root()))?;
    let built = profile()?.with_file_name("release");
    for name in ["libcalib.a", "libcalib.so", "libcalib.dylib", "calib.dll", "calib.lib"] {
        if built.join(name).exists() {
            fs::copy(built.join(name), lib.join(name))?;
        }
    }
    fs::copy(root().join(HEADER), include.join("calib.h"))?;
    let template = fs::read_to_string(root().join(CRATE).join("calib.pc.in"))?;
    let words = [
        ("@prefix@", out.display().to_string()),
        ("@version@", env!("CARGO_PKG_VERSION").to_owned()),
        ("@private@", SYSTEM.join(" ")),
    ];
    let about = words.iter().fold(template, |text, (word, value)| text.replace(word, value));
    fs::write(lib.join("pkgconfig/calib.pc"), about)?;
    println!("{}", out.display());
    Ok(())
}

/// Compiles tests and examples with warnings as errors, and runs them under the sanitizers.
pub(crate) fn test(golden: &Path) -> anyhow::Result<()> {
    let checked_in = fs::read_to_string(root().join(HEADER)).unwrap_or_default();
    ensure!(checked_in == header()?, "{HEADER} is not that of the sources: `cargo xtask c` writes it");
    golden::run(golden)?;
    let (built, out) = (build(&["--package", "calib-c"])?, root().join("target/c-test"));
    fs::create_dir_all(&out)?;
    let program = |name: &str, source: &str| -> anyhow::Result<Command> {
        compile(&built, source, &out.join(name))?;
        let mut command = Command::new(out.join(name));
        command.env("LD_LIBRARY_PATH", &built).env("UBSAN_OPTIONS", "halt_on_error=1");
        Ok(command)
    };
    let site = || anyhow::Ok(Stdio::from(fs::File::open(golden.join("site.json"))?));
    done(program("golden", "tests/golden.cpp")?.arg(golden))?;
    done(program("misuse", "tests/misuse.c")?.stdin(site()?))?;
    done(
        program("boxes_to_floor", "examples/boxes_to_floor.c")?.arg(golden.join("site.json")).arg("camera-0"),
    )?;
    gstreamer(&out)
}

/// With the shared library, so that what it wants of the system is its own.
fn compile(built: &Path, source: &str, to: &Path) -> anyhow::Result<()> {
    let (compiler, standard) =
        if source.ends_with(".c") { ("cc", "-std=c11") } else { ("c++", "-std=c++17") };
    let mut command = Command::new(compiler);
    command.args([standard, "-g", "-O1", "-fsanitize=address,undefined"]).args(STRICT);
    command.arg("-I").arg(root().join(CRATE).join("include"));
    command.arg(root().join(CRATE).join(source)).arg("-o").arg(to);
    command.arg("-L").arg(built).args(["-lcalib", "-lpthread", "-lm"]);
    done(&mut command)
}

/// The probe compiles where the headers of `GStreamer` are.
fn gstreamer(out: &Path) -> anyhow::Result<()> {
    let mut packages = Command::new("pkg-config");
    packages.args(["--cflags", "gstreamer-1.0", "gstreamer-video-1.0"]).stderr(Stdio::null());
    let found = packages.output().ok().filter(|output| output.status.success());
    let found = found.context("GStreamer's headers: libgstreamer-plugins-base1.0-dev")?;
    let flags = String::from_utf8(found.stdout)?;
    // Its headers are not ours to warn of.
    let flags = flags.split_whitespace().map(|flag| flag.replacen("-I", "-isystem", 1));
    let mut command = Command::new("cc");
    command.args(["-std=c11", "-c"]).args(STRICT).args(flags);
    command.arg("-I").arg(root().join(CRATE).join("include"));
    command.arg(root().join(CRATE).join("examples/gstreamer_probe.c")).arg("-o").arg(out.join("probe.o"));
    done(&mut command)
}
