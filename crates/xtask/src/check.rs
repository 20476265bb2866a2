//! `cargo xtask test`: every check there is, in the order in which they fail fastest, and in two rows: linking, browsers
//! and most tests keep one processor busy, so that two rows are through a quarter sooner.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{File, read_to_string};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::process::Command;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use anyhow::{Context as _, bail};

use crate::tools::{
    BROWSER, COMPILERS, ENGINES, FUZZ, JAVA, PEERS, PYTHON, SPLIT, TYPOS, Tool, ULTRALYTICS, WEB, ready,
};
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
    /// It is in the second row: what it prints is shown when it is done.
    is_beside: bool,
    /// The check of the other row that makes what it takes.
    after: Option<&'static str>,
}

/// Tells a check that the whole workspace is built: what it needs is there, and what it would build for itself has
/// other features, so that half of the dependencies would be built again.
pub(crate) const IS_BUILT: &str = "CALIB_IS_BUILT";

/// Where all targets are built, so that what they have in common is built once.
const FUZZ_TARGET: &str = "target/fuzz";

/// Without instrumentation of memory: that our code is safe the compiler checks, that libraries are is left to them, and
/// twice as much is tried in half the time. What is asked for of memory the targets limit.
const FUZZ_SANITIZER: &str = "--sanitizer=none";

const PLAIN: Check = Check {
    name: "",
    command: &[],
    environment: &[],
    empty: None,
    tools: &[],
    runs_without: false,
    is_beside: false,
    after: None,
};

/// In the second row.
const BESIDE: Check = Check { is_beside: true, ..PLAIN };

/// In the second row, and takes what is built.
const OF_BUILT: Check = Check { after: Some(BUILD), ..BESIDE };

/// The check that builds the workspace.
const BUILD: &str = "build";

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
        name: "core without optional features",
        command: &["cargo", "check", "--package", "calib-core", "--no-default-features"],
        ..PLAIN
    },
    Check {
        name: "command line without archives, as `cargo demo` has it",
        command: &["cargo", "check", "--package", "calib-cli", "--no-default-features"],
        ..PLAIN
    },
    // With the features of all packages together; what follows uses what lies there.
    Check {
        name: BUILD,
        command: &[
            "cargo",
            "build",
            "--workspace",
            "--all-features",
            "--lib",
            "--bins",
            "--tests",
            "--examples",
        ],
        ..PLAIN
    },
    Check {
        name: "site parser under fuzzing",
        command: &[
            "cargo",
            "fuzz",
            "run",
            "site",
            "--fuzz-dir",
            "crates/calib-site/fuzz",
            "--target-dir",
            FUZZ_TARGET,
            FUZZ_SANITIZER,
            "target/fuzz-corpus/site",
            "crates/calib-site/fuzz/seeds",
            "--",
            // From one seed, so that a check fails for what was changed and not by chance; longer by hand.
            "-seed=1",
            "-runs=40000",
            "-max_len=16384",
            "-dict=crates/calib-site/fuzz/site.dict",
        ],
        // The fuzzer's instrumentation is unstable; a stable compiler has it, too.
        environment: &[("RUSTC_BOOTSTRAP", "1")],
        empty: Some("target/fuzz-corpus/site"),
        tools: &[&FUZZ],
        ..BESIDE
    },
    Check { name: "importers under fuzzing", command: &["fuzz-formats"], tools: &[&FUZZ], ..BESIDE },
    Check { name: "page for the browser", command: &["xtask", "web"], tools: &[&WEB, &SPLIT], ..BESIDE },
    Check {
        name: "the package for JavaScript",
        command: &["xtask", "js", "--test"],
        tools: &[&WEB, &BROWSER],
        ..OF_BUILT
    },
    Check {
        name: "the wheel for Python",
        command: &["xtask", "py", "--test"],
        tools: &[&PYTHON, &JAVA],
        ..OF_BUILT
    },
    Check {
        name: "the wheel beside Ultralytics",
        command: &["xtask", "py", "--ultralytics"],
        tools: &[&PYTHON, &ULTRALYTICS],
        ..OF_BUILT
    },
    Check {
        name: "the library for C and C++",
        command: &["xtask", "c", "--test"],
        tools: &[&COMPILERS],
        ..OF_BUILT
    },
    Check {
        name: "the app in Chromium",
        command: &["xtask", "browser", "--as-is"],
        tools: &[&WEB, &SPLIT, &BROWSER],
        ..OF_BUILT
    },
    Check {
        name: "tests",
        command: &["cargo", "test", "--workspace", "--all-features", "--no-fail-fast"],
        // The cases of properties, too, from one seed; `cargo test` alone draws others every time.
        environment: &[("PROPTEST_RNG_SEED", "1")],
        tools: &[&PEERS, &ENGINES],
        runs_without: true,
        ..PLAIN
    },
];

/// Runs every check; with `install`, what is missing is installed first, and a skip is a failure.
pub(crate) fn run(install: bool) -> anyhow::Result<()> {
    // By its name at the start: the build puts another in its place.
    let runner = Runner {
        own: std::env::current_exe()?,
        skips: root().join("target/skipped-tests.txt"),
        install,
        outcome: Mutex::default(),
        is_one_done: Condvar::new(),
        installer: Mutex::default(),
    };
    make_empty("target/checks")?;
    std::fs::write(&runner.skips, "")?;
    let row = |is_beside: bool| runner.row(CHECKS.iter().filter(|check| check.is_beside == is_beside));
    std::thread::scope(|scope| {
        scope.spawn(|| row(true));
        row(false);
    });
    let Outcome { mut failed, skipped, .. } =
        runner.outcome.into_inner().unwrap_or_else(PoisonError::into_inner);
    let listed = read_to_string(&runner.skips)?;
    println!();
    let count = skipped.len() + listed.lines().count();
    for line in listed.lines().chain(skipped.iter().map(String::as_str)) {
        println!("SKIPPED {}", line.trim_start_matches("SKIPPED ").trim_start_matches("MISSING "));
    }
    if install {
        failed.extend(skipped.iter().cloned());
        failed.extend(listed.lines().filter(|line| line.starts_with("MISSING")).map(Into::into));
    }
    if !failed.is_empty() {
        bail!("failed: {}", failed.join("; "));
    }
    println!("{} passed, 0 failed, {count} skipped", CHECKS.len() - skipped.len());
    Ok(())
}

/// How the checks went so far.
#[derive(Default)]
struct Outcome {
    done: BTreeSet<&'static str>,
    failed: Vec<String>,
    skipped: Vec<String>,
}

/// What the commands of checks share.
struct Runner {
    /// This program.
    own: PathBuf,
    /// Where tests write what they skipped.
    skips: PathBuf,
    install: bool,
    outcome: Mutex<Outcome>,
    is_one_done: Condvar,
    /// Held by the row that installs: the managers of packages work one at a time.
    installer: Mutex<()>,
}

impl Runner {
    /// Runs the checks of a row.
    fn row(&self, checks: impl Iterator<Item = &'static Check>) {
        for check in checks {
            let waits =
                |outcome: &mut Outcome| check.after.is_some_and(|other| !outcome.done.contains(other));
            drop(self.is_one_done.wait_while(self.outcome(), waits));
            // The other row may wait for this one.
            let found = catch_unwind(AssertUnwindSafe(|| self.one(check)));
            let mut outcome = self.outcome();
            match found {
                Ok(Ok(Found::Passed)) => {}
                Ok(Ok(Found::Failed)) => outcome.failed.push(check.name.into()),
                Ok(Ok(Found::Skipped(missing))) => {
                    outcome.skipped.push(format!("{}: {missing} is missing", check.name));
                }
                Ok(Err(error)) => outcome.failed.push(format!("{}: {error:#}", check.name)),
                Err(_) => outcome.failed.push(format!("{}: it panicked", check.name)),
            }
            outcome.done.insert(check.name);
            drop(outcome);
            self.is_one_done.notify_all();
        }
    }

    fn outcome(&self) -> MutexGuard<'_, Outcome> {
        self.outcome.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn one(&self, check: &Check) -> anyhow::Result<Found> {
        let missing: Vec<&str> = {
            let _one_at_a_time = self.installer.lock();
            check.tools.iter().filter(|tool| !ready(tool, self.install)).map(|tool| tool.name).collect()
        };
        if !missing.is_empty() && !check.runs_without {
            return Ok(Found::Skipped(missing.join(", ")));
        }
        let start = Instant::now();
        if !check.is_beside {
            println!("\n== {}", check.name);
        }
        let passed = match check.command {
            ["fuzz-formats"] => self.fuzz_formats(check)?,
            _ => self.run(check)?,
        };
        let beside = match check.is_beside {
            true => format!("\n== {}, beside\n{}", check.name, read_to_string(printed_by(check))?),
            false => String::new(),
        };
        println!(
            "{beside}== {}: {} in {:.0} s",
            check.name,
            if passed { "passed" } else { "FAILED" },
            start.elapsed().as_secs_f64()
        );
        Ok(if passed { Found::Passed } else { Found::Failed })
    }

    fn run(&self, check: &Check) -> anyhow::Result<bool> {
        let (program, arguments) = check.command.split_first().context("a check without a command")?;
        if let Some(folder) = check.empty {
            make_empty(folder)?;
        }
        let mut command = self.command(program, check)?;
        command.args(arguments).envs(check.environment.iter().copied());
        Ok(command.status().with_context(|| check.name)?.success())
    }

    /// Every importer has seeds; their folder is the list.
    fn fuzz_formats(&self, check: &Check) -> anyhow::Result<bool> {
        const FUZZ_DIR: &str = "crates/calib-formats/fuzz";
        let mut formats = Vec::new();
        for entry in std::fs::read_dir(root().join(FUZZ_DIR).join("seeds"))? {
            formats.push(entry?.file_name().to_string_lossy().into_owned());
        }
        formats.sort();
        for format in &formats {
            let corpus = format!("target/fuzz-corpus/{format}");
            let seeds = format!("{FUZZ_DIR}/seeds/{format}");
            make_empty(&corpus)?;
            let command = [
                "fuzz",
                "run",
                "import",
                "--fuzz-dir",
                FUZZ_DIR,
                "--target-dir",
                FUZZ_TARGET,
                FUZZ_SANITIZER,
                &corpus,
                &seeds,
            ];
            // From one seed, so that a check fails for what was changed and not by chance; longer by hand.
            let options = ["--", "-seed=1", "-runs=20000", "-max_len=8192", "-rss_limit_mb=1024"];
            let mut cargo = self.command("cargo", check)?;
            cargo.args(command).args(options).env("RUSTC_BOOTSTRAP", "1").env("CALIB_FORMAT", format);
            if !cargo.status()?.success() {
                println!("== the importer of {format}");
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// A command that finds the tools that were installed for the checks.
    fn command(&self, program: &str, check: &Check) -> anyhow::Result<Command> {
        let program = if program == "xtask" { self.own.as_os_str() } else { OsStr::new(program) };
        let mut command = Command::new(program);
        command.current_dir(root()).env("CALIB_SKIPPED_LIST", &self.skips).env(IS_BUILT, "1");
        if self.install {
            // It is for whoever changes a line and builds again, and doubles what lies in `target`.
            command.env("CARGO_INCREMENTAL", "0");
        }
        if check.is_beside {
            let printed = File::options().append(true).create(true).open(printed_by(check))?;
            command.stdout(printed.try_clone()?).stderr(printed);
        }
        let tools = root().join("target/tools/bin");
        if let Some(path) = std::env::var_os("PATH") {
            let paths = std::iter::once(tools).chain(std::env::split_paths(&path));
            command.env("PATH", std::env::join_paths(paths)?);
        }
        Ok(command)
    }
}

/// How a check went.
enum Found {
    Passed,
    Failed,
    /// For want of these tools.
    Skipped(String),
}

/// Where a check of the second row prints.
fn printed_by(check: &Check) -> PathBuf {
    root().join("target/checks").join(check.name.replace(' ', "-")).with_extension("txt")
}

/// Makes a folder anew: what is tried does not depend on what was tried before.
fn make_empty(folder: &str) -> anyhow::Result<()> {
    let folder = root().join(folder);
    if folder.exists() {
        std::fs::remove_dir_all(&folder)?;
    }
    Ok(std::fs::create_dir_all(folder)?)
}
