//! `cargo xtask c`: the C and C++ library with its header, and its tests under the sanitizers.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, ensure};

use crate::heavy::golden;
use crate::heavy::product::{build, profile_folder, run_command};
use crate::workspace::root;

const CRATE: &str = "crates/calib-c";
const HEADER: &str = "crates/calib-c/include/calib.h";
/// System libraries that the static library needs.
const SYSTEM_LIBRARIES: &str = if cfg!(windows) {
    "-lkernel32 -lntdll -luserenv -lws2_32"
} else if cfg!(target_os = "macos") {
    "-lSystem -lc -lm"
} else {
    "-lgcc_s -lutil -lrt -lpthread -lm -ldl -lc"
};
/// File names of the built libraries on all systems.
const LIBRARIES: [&str; 6] =
    ["libcalib.a", "libcalib.so", "libcalib.dylib", "calib.dll", "calib.dll.lib", "calib.lib"];
/// Compiler flags that turn on warnings and make them errors.
const WARNING_FLAGS: [&str; 6] = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror"];

/// Generates the C header from the Rust sources.
fn header() -> anyhow::Result<String> {
    let folder = root().join(CRATE);
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).map_err(anyhow::Error::msg)?;
    let mut builder = cbindgen::Builder::new().with_config(config);
    for file in ["raw", "site", "camera", "about", "mapping"] {
        builder = builder.with_src(folder.join("src").join(file).with_extension("rs"));
    }
    let mut text = Vec::new();
    builder.generate()?.write(&mut text);
    Ok(String::from_utf8(text)?)
}

/// Writes libraries, header and pkg-config file into `out`, with the layout of an installation prefix.
pub(crate) fn run(out: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(root().join(CRATE).join("include"))?;
    fs::write(root().join(HEADER), header()?)?;
    let mut cargo = Command::new("cargo");
    run_command(cargo.args(["build", "--quiet", "--release", "--package", "calib-c"]).current_dir(root()))?;
    copy_to_prefix(&profile_folder()?.with_file_name("release"), out)?;
    println!("{}", out.display());
    Ok(())
}

/// Copies the built files into `out`, with the layout of an installation prefix that can be moved.
fn copy_to_prefix(built: &Path, out: &Path) -> anyhow::Result<()> {
    let [lib, include] = ["lib", "include"].map(|folder| out.join(folder));
    fs::create_dir_all(lib.join("pkgconfig"))?;
    fs::create_dir_all(&include)?;
    for name in LIBRARIES {
        if built.join(name).exists() {
            fs::copy(built.join(name), lib.join(name))?;
        }
    }
    fs::copy(root().join(HEADER), include.join("calib.h"))?;
    let template = fs::read_to_string(root().join(CRATE).join("calib.pc.in"))?;
    let words = [("@version@", env!("CARGO_PKG_VERSION")), ("@private@", SYSTEM_LIBRARIES)];
    let about = words.iter().fold(template, |text, (word, value)| text.replace(word, value));
    Ok(fs::write(lib.join("pkgconfig/calib.pc"), about)?)
}

/// Compiles tests and examples with warnings as errors, and runs them under the sanitizers.
pub(crate) fn test(golden: &Path) -> anyhow::Result<()> {
    let checked_in = fs::read_to_string(root().join(HEADER)).unwrap_or_default();
    ensure!(checked_in == header()?, "{HEADER} does not match the sources; update it with `cargo xtask c`");
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
    run_command(program("golden", "tests/golden.cpp")?.arg(golden))?;
    run_command(program("misuse", "tests/misuse.c")?.stdin(site()?))?;
    run_command(
        program("boxes_to_floor", "examples/boxes_to_floor.c")?.arg(golden.join("site.json")).arg("camera-0"),
    )?;
    test_installed(&built, &out, &golden.join("site.json"))?;
    gstreamer(&out)
}

/// Builds the C++ example against an installed prefix that was moved, with the shared and with the static
/// library.
fn test_installed(built: &Path, out: &Path, site: &Path) -> anyhow::Result<()> {
    let [first, prefix] = ["prefix", "moved"].map(|name| out.join(name));
    for folder in [&first, &prefix] {
        if folder.exists() {
            fs::remove_dir_all(folder)?;
        }
    }
    copy_to_prefix(built, &first)?;
    fs::rename(&first, &prefix)?;
    for linking in [None, Some("--static")] {
        let flags = flags(
            Command::new("pkg-config")
                .args(linking)
                .args(["--cflags", "--libs", "calib"])
                .env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig")),
        )?;
        let program = out.join("installed");
        let mut command = Command::new("c++");
        command
            .args(["-std=c++17"])
            .args(WARNING_FLAGS)
            .arg(root().join(CRATE).join("examples/boxes_to_floor.cpp"));
        // Names the static library explicitly, because the linker prefers the shared one.
        let flags = flags.split_whitespace().map(|flag| match (linking, flag) {
            (Some(_), "-lcalib") => "-l:libcalib.a",
            _ => flag,
        });
        run_command(command.args(flags).arg("-o").arg(&program))?;
        let mut run = Command::new(&program);
        run_command(run.arg(site).arg("camera-0").env("LD_LIBRARY_PATH", prefix.join("lib")))?;
    }
    Ok(())
}

/// Returns the compiler flags that pkg-config prints.
fn flags(packages: &mut Command) -> anyhow::Result<String> {
    let found = packages.stderr(Stdio::null()).output()?;
    ensure!(found.status.success(), "{packages:?} failed");
    Ok(String::from_utf8(found.stdout)?)
}

/// Compiles a test with the shared library, which is already linked to its system libraries.
fn compile(built: &Path, source: &str, to: &Path) -> anyhow::Result<()> {
    let (compiler, standard) =
        if source.ends_with(".c") { ("cc", "-std=c11") } else { ("c++", "-std=c++17") };
    let mut command = Command::new(compiler);
    command.args([standard, "-g", "-O1", "-fsanitize=address,undefined"]).args(WARNING_FLAGS);
    command.arg("-I").arg(root().join(CRATE).join("include"));
    command.arg(root().join(CRATE).join(source)).arg("-o").arg(to);
    command.arg("-L").arg(built).args(["-lcalib", "-lpthread", "-lm"]);
    run_command(&mut command)
}

/// Compiles the `GStreamer` example.
fn gstreamer(out: &Path) -> anyhow::Result<()> {
    let packages = ["--cflags", "gstreamer-1.0", "gstreamer-video-1.0"];
    let flags = flags(Command::new("pkg-config").args(packages))
        .context("no GStreamer headers: install libgstreamer-plugins-base1.0-dev")?;
    // The headers of GStreamer are included as system headers, so that they give no warnings.
    let flags = flags.split_whitespace().map(|flag| flag.replacen("-I", "-isystem", 1));
    let mut command = Command::new("cc");
    command.args(["-std=c11", "-c"]).args(WARNING_FLAGS).args(flags);
    command.arg("-I").arg(root().join(CRATE).join("include"));
    command.arg(root().join(CRATE).join("examples/gstreamer_probe.c")).arg("-o").arg(out.join("probe.o"));
    run_command(&mut command)
}
