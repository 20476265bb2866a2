//! `cargo xtask test`: every check there is, in the order in which they fail fastest.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context as _, bail};

use crate::tools::{BROWSER, COMPILERS, ENGINES, FUZZ, JAVA, PEERS, PYTHON, TYPOS, Tool, WEB, ready};
use crate::wasm;
use crate::workspace::root;

/// A check: its name, its command, and its tools.
struct Check {
    name: &'static str,
    command: &'static [&'static str],
    environment: &'static [(&'static str, &'static str)],
    /// A folder that the command wants to be there, and empty.
    empty: Option<&'static str>,
    tools: &'static [&'static Tool],
    /// It runs without its tools, too, and says by itself what it leaves out.
    runs_without: bool,
}

/// Where all targets are built, so that what they have in common is built once.
const FUZZ_TARGET: &str = "target/fuzz";

const PLAIN: Check =
    Check { name: "", command: &[], environment: &[], empty: None, tools: &[], runs_without: false };

/// The list is the registry.
const CHECKS: &[Check] = &[
    Check { name: "format", command: &["cargo", "fmt", "--all", "--check"], ..PLAIN },
    Check { name: "spelling", command: &["target/tools-venv/bin/typos"], tools: &[&TYPOS], ..PLAIN },
    Check {
        name: "lints",
        command: &[
            "cargo",
            "clippy",
            "--workspace",
            "--all-targets",
            "--all-features",
            "--",
            "--deny",
            "warnings",
        ],
        ..PLAIN
    },
    Check {
        name: "documentation",
        command: &["cargo", "doc", "--workspace", "--all-features", "--no-deps", "--document-private-items"],
        environment: &[("RUSTDOCFLAGS", "--deny warnings")],
        ..PLAIN
    },
    Check {
        name: "core without serde",
        command: &["cargo", "check", "--package", "calib-core", "--no-default-features"],
        ..PLAIN
    },
    Check { name: "core and formats for wasm32", command: &["wasm32"], tools: &[&WEB], ..PLAIN },
    Check {
        name: "site parser under fuzzing",
        command: &[
            "cargo",
            "fuzz",
            "run",
            "site",
            "--fuzz-dir",
            "crates/calib-core/fuzz",
            "--target-dir",
            FUZZ_TARGET,
            "target/fuzz-corpus/site",
            "crates/calib-core/fuzz/seeds",
            "--",
            // From one seed, so that a check fails for what was changed and not by chance; longer by hand.
            "-seed=1",
            "-runs=40000",
            "-max_len=16384",
            "-dict=crates/calib-core/fuzz/site.dict",
        ],
        // The fuzzer's instrumentation is unstable; a stable compiler has it, too.
        environment: &[("RUSTC_BOOTSTRAP", "1")],
        empty: Some("target/fuzz-corpus/site"),
        tools: &[&FUZZ],
        ..PLAIN
    },
    Check { name: "importers under fuzzing", command: &["fuzz-formats"], tools: &[&FUZZ], ..PLAIN },
    Check { name: "page for the browser", command: &["cargo", "xtask", "web"], tools: &[&WEB], ..PLAIN },
    Check {
        name: "the package for JavaScript",
        command: &["cargo", "xtask", "js", "--test"],
        tools: &[&WEB, &BROWSER],
        ..PLAIN
    },
    Check {
        name: "the wheel for Python",
        command: &["cargo", "xtask", "py", "--test"],
        tools: &[&PYTHON],
        ..PLAIN
    },
    Check {
        name: "the library for C and C++",
        command: &["cargo", "xtask", "c", "--test"],
        tools: &[&COMPILERS],
        ..PLAIN
    },
    Check {
        name: "the app in Chromium",
        command: &["cargo", "xtask", "browser"],
        tools: &[&WEB, &BROWSER],
        ..PLAIN
    },
    Check {
        name: "tests",
        command: &["cargo", "test", "--workspace", "--all-features"],
        tools: &[&PEERS, &ENGINES, &JAVA],
        runs_without: true,
        ..PLAIN
    },
];

/// Runs every check; with `install`, what is missing is installed first, and a skip is a failure.
pub(crate) fn run(install: bool) -> anyhow::Result<()> {
    let skips = root().join("target/skipped-tests.txt");
    std::fs::create_dir_all(root().join("target"))?;
    std::fs::write(&skips, "")?;
    let (mut failed, mut skipped) = (Vec::new(), Vec::new());
    for check in CHECKS {
        let missing: Vec<&str> =
            check.tools.iter().filter(|tool| !ready(tool, install)).map(|tool| tool.name).collect();
        if !missing.is_empty() && !check.runs_without {
            skipped.push(format!("{}: {} is missing", check.name, missing.join(", ")));
            continue;
        }
        let start = Instant::now();
        println!("\n== {}", check.name);
        let passed = match check.command {
            // In the page's profile, so that the page need not build them again.
            ["wasm32"] => {
                let packages = ["--package", "calib-core", "--package", "calib-formats", "--profile", "web"];
                wasm::build(&packages).is_ok()
            }
            ["fuzz-formats"] => fuzz_formats(&skips)?,
            _ => run_check(check, &skips)?,
        };
        println!(
            "== {}: {} in {:.0} s",
            check.name,
            if passed { "passed" } else { "FAILED" },
            start.elapsed().as_secs_f64()
        );
        if !passed {
            failed.push(check.name);
        }
    }
    let listed = std::fs::read_to_string(&skips)?;
    println!();
    let count = skipped.len() + listed.lines().count();
    for line in listed.lines().chain(skipped.iter().map(String::as_str)) {
        println!("SKIPPED {}", line.trim_start_matches("SKIPPED ").trim_start_matches("MISSING "));
    }
    if install {
        failed.extend(skipped.iter().map(String::as_str));
        failed.extend(listed.lines().filter(|line| line.starts_with("MISSING")));
    }
    if !failed.is_empty() {
        bail!("failed: {}", failed.join("; "));
    }
    println!("{} passed, 0 failed, {count} skipped", CHECKS.len() - skipped.len());
    Ok(())
}

fn run_check(check: &Check, skips: &Path) -> anyhow::Result<bool> {
    let (program, arguments) = check.command.split_first().context("a check without a command")?;
    if let Some(folder) = check.empty {
        make_empty(folder)?;
    }
    let mut command = tool_command(program, skips)?;
    command.args(arguments).envs(check.environment.iter().copied());
    Ok(command.status().with_context(|| check.name)?.success())
}

/// Every importer has a target of its name; the folder is the list.
fn fuzz_formats(skips: &Path) -> anyhow::Result<bool> {
    const FUZZ_DIR: &str = "crates/calib-formats/fuzz";
    let mut targets = Vec::new();
    for entry in std::fs::read_dir(root().join(FUZZ_DIR).join("fuzz_targets"))? {
        targets.push(entry?.path().file_stem().unwrap_or_default().to_string_lossy().into_owned());
    }
    targets.sort();
    for target in &targets {
        let corpus = format!("target/fuzz-corpus/{target}");
        let seeds = format!("{FUZZ_DIR}/seeds/{target}");
        make_empty(&corpus)?;
        std::fs::create_dir_all(root().join(&seeds))?;
        let command =
            ["fuzz", "run", target, "--fuzz-dir", FUZZ_DIR, "--target-dir", FUZZ_TARGET, &corpus, &seeds];
        // From one seed, so that a check fails for what was changed and not by chance; longer by hand.
        let options = ["--", "-seed=1", "-runs=20000", "-max_len=8192", "-rss_limit_mb=1024"];
        let mut cargo = tool_command("cargo", skips)?;
        cargo.args(command).args(options).env("RUSTC_BOOTSTRAP", "1");
        if !cargo.status()?.success() {
            println!("== the importer of {target}");
            return Ok(false);
        }
    }
    Ok(true)
}

/// Makes a folder anew: what is tried does not depend on what was tried before.
fn make_empty(folder: &str) -> anyhow::Result<()> {
    let folder = root().join(folder);
    if folder.exists() {
        std::fs::remove_dir_all(&folder)?;
    }
    Ok(std::fs::create_dir_all(folder)?)
}

/// A command that finds the tools that were installed for the checks.
fn tool_command(program: &str, skips: &Path) -> anyhow::Result<Command> {
    let mut command = Command::new(program);
    command.current_dir(root()).env("CALIB_SKIPPED_LIST", skips);
    let tools = root().join("target/tools/bin");
    if let Some(path) = std::env::var_os("PATH") {
        let paths = std::iter::once(tools).chain(std::env::split_paths(&path));
        command.env("PATH", std::env::join_paths(paths)?);
    }
    Ok(command)
}
