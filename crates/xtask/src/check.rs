//! `cargo xtask test`: every check there is, in the order in which they fail fastest.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context as _, bail};

use crate::wasm;
use crate::workspace::root;

/// What a check needs beside Rust, and how to get it.
pub(crate) struct Tool {
    pub(crate) name: &'static str,
    pub(crate) is_there: fn() -> bool,
    pub(crate) install: &'static [&'static [&'static str]],
}

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

/// A folder of Python packages at these versions; where they are raised, it is made anew.
macro_rules! python {
    ($name:literal, $folder:literal, $pins:literal) => {
        Tool {
            name: $name,
            is_there: || is_made($folder, $pins),
            install: &[&[
                "sh",
                "-c",
                concat!(
                    "python3 -m venv --clear ",
                    $folder,
                    " || { apt-get update --quiet && apt-get install --quiet --yes python3-venv && python3 -m venv --clear ",
                    $folder,
                    "; }"
                ),
            ], &[
                "sh",
                "-c",
                concat!(
                    $folder,
                    "/bin/python -m pip install --quiet ",
                    $pins,
                    " && printf %s '",
                    $pins,
                    "' > ",
                    $folder,
                    "/ready"
                ),
            ]],
        }
    };
}

const PEERS: Tool = python!(
    "the peers' Python packages",
    "target/peers-venv",
    "numpy==2.4.6 scipy==1.17.1 opencv-python-headless==5.0.0.93 pycolmap==4.2.1 PyYAML==6.0.3"
);

/// `DuckDB` and Spark, for the tests and the benchmark of archives.
const ENGINES: Tool = python!(
    "the engines' Python packages",
    "target/engines-venv",
    "duckdb==2.0.0 pandas==3.1.1 pyarrow==26.0.1 pyspark==4.3.0"
);

/// What builds the wheel, what checks it, and the packages that its users have.
const PYTHON: Tool = python!(
    "what builds and tries the wheel",
    "target/python-venv",
    "maturin==1.16.0 numpy==2.4.6 pytest==9.2.0 mypy==2.4.1 twine==6.2.0 auditwheel==6.8.2 matplotlib==3.11.2 \
     nbclient==0.11.0 ipykernel==7.4.0 opencv-python-headless==5.0.0.93 supervision==0.31.2 norfair==2.1.1"
);

const COMPILERS: Tool = Tool {
    name: "compilers for C and C++, and GStreamer's headers",
    is_there: || is_on_path("cc") && is_on_path("c++") && finds("gstreamer-video-1.0"),
    install: &[
        &["apt-get", "update", "--quiet"],
        &[
            "apt-get",
            "install",
            "--quiet",
            "--yes",
            "--no-install-recommends",
            "g++",
            "pkg-config",
            "libgstreamer-plugins-base1.0-dev",
        ],
    ],
};

const TYPOS: Tool = python!("typos", "target/tools-venv", "typos==1.52.0");

/// For Spark.
const JAVA: Tool = Tool {
    name: "Java",
    is_there: || is_on_path("java"),
    install: &[
        &["apt-get", "update", "--quiet"],
        &["apt-get", "install", "--quiet", "--yes", "default-jre-headless"],
    ],
};

const FUZZ: Tool = Tool {
    name: "cargo-fuzz, and the C++ compiler that its engine wants",
    is_there: || says("target/tools/bin/cargo-fuzz", "cargo-fuzz 0.13.2") && is_on_path("c++"),
    install: &[
        &["sh", "-c", "command -v c++ || { apt-get update --quiet && apt-get install --quiet --yes g++; }"],
        &[
            "cargo",
            "install",
            "--quiet",
            "--locked",
            "--force",
            "--root",
            "target/tools",
            "cargo-fuzz@0.13.2",
        ],
    ],
};

/// Where all targets are built, so that what they have in common is built once.
const FUZZ_TARGET: &str = "target/fuzz";

const WEB: Tool = Tool {
    name: "a Rust that builds for wasm32 (rustup's target, or Debian's rustc-web)",
    is_there: wasm::is_there,
    install: &[&[
        "sh",
        "-c",
        "timeout 300 rustup target add wasm32-unknown-unknown || { apt-get update --quiet && \
         apt-get install --quiet --yes rustc-web cargo-web rust-web-src lld; }",
    ]],
};

/// What is wanted of npm, beside what was installed for it.
const LOCK: [&str; 2] = ["crates/calib-app/tests/browser/package-lock.json", "target/browser/ready"];

const BROWSER: Tool = Tool {
    name: "Chromium, Node 20 or newer, and what drives a browser",
    is_there: || {
        let [wanted, made] = LOCK.map(|path| std::fs::read(root().join(path)).ok());
        let mut node = Command::new("node");
        node.args(["--eval", "process.exit(parseInt(process.versions.node) < 20 ? 1 : 0)"]);
        let has_node = node.status().is_ok_and(|status| status.success());
        runs("/usr/bin/chromium", &["--version"]) && has_node && wanted.is_some() && wanted == made
    },
    install: &[
        &["apt-get", "update", "--quiet"],
        // Whoever has a newer Node from elsewhere keeps it.
        &["sh", "-c", "command -v node && command -v npm || apt-get install --quiet --yes nodejs npm"],
        &["apt-get", "install", "--quiet", "--yes", "chromium"],
        &["mkdir", "-p", "target/browser"],
        &["cp", "crates/calib-app/tests/browser/package.json", LOCK[0], "target/browser"],
        &["npm", "ci", "--prefix", "target/browser", "--no-fund", "--no-audit"],
        &["cp", LOCK[0], LOCK[1]],
    ],
};

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

/// Whether a tool is there, after installing it if that is wanted.
pub(crate) fn ready(tool: &Tool, install: bool) -> bool {
    if (tool.is_there)() {
        return true;
    }
    if install {
        println!("\n== installing {}", tool.name);
        for command in tool.install {
            let Some((program, arguments)) = command.split_first() else { continue };
            let done = Command::new(program).args(arguments).current_dir(root()).status();
            if !done.is_ok_and(|status| status.success()) {
                println!("== {} failed", command.join(" "));
                return false;
            }
        }
    }
    let is_there = (tool.is_there)();
    if install && !is_there {
        println!("== {} was installed and is still not what the checks want", tool.name);
    }
    is_there
}

/// Whether a program of the workspace's tools runs.
pub(crate) fn runs(program: &str, arguments: &[&str]) -> bool {
    let output = Command::new(root().join(program)).args(arguments).output();
    output.is_ok_and(|output| output.status.success())
}

/// Whether a program of the workspace's tools is this version.
fn says(program: &str, version: &str) -> bool {
    let output = Command::new(root().join(program)).arg("--version").output();
    output.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).trim() == version)
}

/// Whether a folder of packages was made with these.
fn is_made(folder: &str, pins: &str) -> bool {
    std::fs::read_to_string(root().join(folder).join("ready")).is_ok_and(|made| made == pins)
}

/// Whether a library's headers are there.
fn finds(library: &str) -> bool {
    Command::new("pkg-config").args(["--exists", library]).status().is_ok_and(|status| status.success())
}

/// Whether there is a program of this name, wherever it is installed.
fn is_on_path(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
}
