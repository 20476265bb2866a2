//! `cargo xtask test`: runs every check of the project, ordered so that failures show early.
//!
//! The checks run in two parallel queues. Linking, browsers and most tests use one processor each, so two
//! queues take about a quarter less time than one.

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
    BROWSER, COMPILERS, ENGINES, FUZZ, JAVA, PEERS, PYTHON, SPLIT, TYPOS, Tool, ULTRALYTICS, WEB, is_ready,
};
use crate::workspace::root;

/// Check: name, command and required tools.
struct Check {
    name: &'static str,
    command: &'static [&'static str],
    environment: &'static [(&'static str, &'static str)],
    /// Folder that is emptied before the command runs.
    emptied_folder: Option<&'static str>,
    tools: &'static [&'static Tool],
    /// Whether the check also runs when tools are missing. The check then reports the parts that it skips.
    runs_without_tools: bool,
    /// Whether the check belongs to the background queue. The output of such a check is printed when it ends.
    is_background: bool,
    /// Name of a check in the other queue that must finish first.
    after: Option<&'static str>,
}

/// Name of the environment variable that is set for checks once the whole workspace is built.
///
/// A check then uses the built programs. A build by the check itself would select other features and compile
/// half of the dependencies again.
pub(crate) const WORKSPACE_IS_BUILT: &str = "CALIB_IS_BUILT";

/// Cargo target folder of all fuzz targets. It is shared so that common dependencies are built once.
const FUZZ_TARGET: &str = "target/fuzz";

/// Flag of cargo-fuzz that turns off memory sanitizers.
///
/// The compiler already guarantees that our code is memory safe, and libraries are tested by their authors.
/// Without sanitizers twice as many inputs run in half the time. The fuzz targets limit allocations
/// themselves.
const FUZZ_SANITIZER: &str = "--sanitizer=none";

/// Defaults of a check in the foreground queue.
const PLAIN: Check = Check {
    name: "",
    command: &[],
    environment: &[],
    emptied_folder: None,
    tools: &[],
    runs_without_tools: false,
    is_background: false,
    after: None,
};

/// Defaults of a check in the background queue.
const BACKGROUND: Check = Check { is_background: true, ..PLAIN };

/// Defaults of a check in the background queue that uses the built workspace.
const BACKGROUND_AFTER_BUILD: Check = Check { after: Some(BUILD), ..BACKGROUND };

/// Name of the check that builds the workspace.
const BUILD: &str = "build";

/// All checks, in the order in which they start. Add new checks here.
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
        name: "command line without archive support (used by `cargo demo`)",
        command: &["cargo", "check", "--package", "calib-cli", "--no-default-features"],
        ..PLAIN
    },
    Check {
        name: "packages for crates.io",
        // Without `--no-verify`, every package would be built alone.
        command: &["cargo", "publish", "--workspace", "--dry-run", "--no-verify", "--allow-dirty", "--quiet"],
        ..PLAIN
    },
    // Builds with the features of all packages together; later checks use the result.
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
        name: "fuzzing of the site parser",
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
            // The fixed seed makes failures depend on the code and not on chance. Start longer runs
            // manually.
            "-seed=1",
            "-runs=15000",
            "-max_len=16384",
            "-dict=crates/calib-site/fuzz/site.dict",
        ],
        // The fuzzer needs unstable instrumentation; this variable enables it in a stable compiler.
        environment: &[("RUSTC_BOOTSTRAP", "1")],
        emptied_folder: Some("target/fuzz-corpus/site"),
        tools: &[&FUZZ],
        ..BACKGROUND
    },
    Check {
        name: "fuzzing of the DXF reader",
        command: &[
            "cargo",
            "fuzz",
            "run",
            "dxf",
            "--fuzz-dir",
            "crates/calib-plan/fuzz",
            "--target-dir",
            FUZZ_TARGET,
            FUZZ_SANITIZER,
            "target/fuzz-corpus/dxf",
            "crates/calib-plan/fuzz/seeds",
            "--",
            "-seed=1",
            "-runs=30000",
            "-max_len=4096",
            "-timeout=20",
        ],
        environment: &[("RUSTC_BOOTSTRAP", "1")],
        emptied_folder: Some("target/fuzz-corpus/dxf"),
        tools: &[&FUZZ],
        ..BACKGROUND
    },
    Check { name: "fuzzing of the importers", command: &["fuzz-formats"], tools: &[&FUZZ], ..BACKGROUND },
    Check { name: "web app", command: &["xtask", "web"], tools: &[&WEB, &SPLIT], ..BACKGROUND },
    Check {
        name: "JavaScript package",
        command: &["xtask", "js", "--test"],
        tools: &[&WEB, &BROWSER],
        ..BACKGROUND_AFTER_BUILD
    },
    Check {
        name: "Python wheel",
        command: &["xtask", "py", "--test"],
        tools: &[&PYTHON, &JAVA],
        ..BACKGROUND_AFTER_BUILD
    },
    Check {
        name: "Python wheel with Ultralytics",
        command: &["xtask", "py", "--ultralytics"],
        tools: &[&PYTHON, &ULTRALYTICS],
        ..BACKGROUND_AFTER_BUILD
    },
    Check {
        name: "C and C++ library",
        command: &["xtask", "c", "--test"],
        tools: &[&COMPILERS],
        ..BACKGROUND_AFTER_BUILD
    },
    Check {
        name: "web app in Chromium",
        command: &["xtask", "browser", "--as-is"],
        tools: &[&WEB, &SPLIT, &BROWSER],
        ..BACKGROUND_AFTER_BUILD
    },
    Check {
        name: "tests",
        command: &["cargo", "test", "--workspace", "--all-features", "--no-fail-fast"],
        // The variable fixes the seed of the property tests. A plain `cargo test` uses new cases in every
        // run.
        environment: &[("PROPTEST_RNG_SEED", "1")],
        tools: &[&PEERS, &ENGINES],
        runs_without_tools: true,
        ..PLAIN
    },
];

/// Runs every check. If `install` is set, missing tools are installed first and a skipped check counts as a
/// failure.
pub(crate) fn run(install: bool) -> anyhow::Result<()> {
    // The path is read now, because the build replaces this executable.
    let runner = Runner {
        own: std::env::current_exe()?,
        skips: root().join("target/skipped-tests.txt"),
        install,
        progress: Mutex::default(),
        check_finished: Condvar::new(),
        installer: Mutex::default(),
    };
    make_empty("target/checks")?;
    std::fs::write(&runner.skips, "")?;
    let queue = |is_background: bool| {
        runner.run_queue(CHECKS.iter().filter(|check| check.is_background == is_background));
    };
    std::thread::scope(|scope| {
        scope.spawn(|| queue(true));
        queue(false);
    });
    let Progress { mut failed, skipped, seconds, .. } =
        runner.progress.into_inner().unwrap_or_else(PoisonError::into_inner);
    let listed = read_to_string(&runner.skips)?;
    println!("\nTime of each check, both queues:");
    for (check, seconds) in seconds {
        println!("{seconds:6.0} s  {check}");
    }
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
        for check in CHECKS.iter().filter(|check| failed.iter().any(|failure| failure == check.name)) {
            print_last_lines(check);
        }
        bail!("failed: {}", failed.join("; "));
    }
    println!("{} passed, 0 failed, {count} skipped", CHECKS.len() - skipped.len());
    Ok(())
}

/// Names of the checks that have ended so far (all, failed and skipped), and their times.
#[derive(Default)]
struct Progress {
    done: BTreeSet<&'static str>,
    failed: Vec<String>,
    skipped: Vec<String>,
    /// Names and times of the finished checks, in seconds.
    seconds: Vec<(&'static str, f64)>,
}

/// State shared by the commands of all checks.
struct Runner {
    /// Path of the executable of this program.
    own: PathBuf,
    /// File to which tests append the names of skipped tests.
    skips: PathBuf,
    install: bool,
    progress: Mutex<Progress>,
    check_finished: Condvar,
    /// Lock for installations: package managers run one at a time.
    installer: Mutex<()>,
}

impl Runner {
    /// Runs the checks of one queue in order.
    fn run_queue(&self, checks: impl Iterator<Item = &'static Check>) {
        for check in checks {
            let waits =
                |progress: &mut Progress| check.after.is_some_and(|other| !progress.done.contains(other));
            drop(self.check_finished.wait_while(self.progress(), waits));
            // Catches panics, because the other queue may wait for this check.
            let start = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| self.run_check(check)));
            let mut progress = self.progress();
            progress.seconds.push((check.name, start.elapsed().as_secs_f64()));
            match result {
                Ok(Ok(CheckResult::Passed)) => {}
                Ok(Ok(CheckResult::Failed)) => progress.failed.push(check.name.into()),
                Ok(Ok(CheckResult::Skipped(missing))) => {
                    progress.skipped.push(format!("{}: {missing} is missing", check.name));
                }
                Ok(Err(error)) => progress.failed.push(format!("{}: {error:#}", check.name)),
                Err(_) => progress.failed.push(format!("{}: the check panicked", check.name)),
            }
            progress.done.insert(check.name);
            drop(progress);
            self.check_finished.notify_all();
        }
    }

    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run_check(&self, check: &Check) -> anyhow::Result<CheckResult> {
        let missing: Vec<&str> = {
            let _one_at_a_time = self.installer.lock();
            check.tools.iter().filter(|tool| !is_ready(tool, self.install)).map(|tool| tool.name).collect()
        };
        if !missing.is_empty() && !check.runs_without_tools {
            return Ok(CheckResult::Skipped(missing.join(", ")));
        }
        let start = Instant::now();
        if !check.is_background {
            println!("\n== {}", check.name);
        }
        let passed = match check.command {
            ["fuzz-formats"] => self.fuzz_formats(check)?,
            _ => self.run(check)?,
        };
        let background_output = match check.is_background {
            true => format!("\n== {} (in background)\n{}", check.name, read_to_string(output_file(check))?),
            false => String::new(),
        };
        println!(
            "{background_output}== {}: {} in {:.0} s",
            check.name,
            if passed { "passed" } else { "FAILED" },
            start.elapsed().as_secs_f64()
        );
        Ok(if passed { CheckResult::Passed } else { CheckResult::Failed })
    }

    fn run(&self, check: &Check) -> anyhow::Result<bool> {
        let (program, arguments) = check.command.split_first().context("the check has no command")?;
        if let Some(folder) = check.emptied_folder {
            make_empty(folder)?;
        }
        let mut command = self.command(program, check)?;
        command.args(arguments).envs(check.environment.iter().copied());
        Ok(command.status().with_context(|| check.name)?.success())
    }

    /// Fuzzes every importer. The subfolders of the seeds folder are the list of importers.
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
            // The fixed seed makes failures depend on the code and not on chance. Start longer runs
            // manually.
            let options = ["--", "-seed=1", "-runs=10000", "-max_len=8192", "-rss_limit_mb=1024"];
            let mut cargo = self.command("cargo", check)?;
            cargo.args(command).args(options).env("RUSTC_BOOTSTRAP", "1").env("CALIB_FORMAT", format);
            if !cargo.status()?.success() {
                println!("== failed importer: {format}");
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Creates a command whose search path includes the tools installed for the checks.
    fn command(&self, program: &str, check: &Check) -> anyhow::Result<Command> {
        let program = if program == "xtask" { self.own.as_os_str() } else { OsStr::new(program) };
        let mut command = Command::new(program);
        command.current_dir(root()).env("CALIB_SKIPPED_LIST", &self.skips).env(WORKSPACE_IS_BUILT, "1");
        if self.install {
            // Incremental builds only help repeated builds, and double the size of `target`.
            command.env("CARGO_INCREMENTAL", "0");
        }
        if check.is_background {
            let printed = File::options().append(true).create(true).open(output_file(check))?;
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

/// Result of one check.
enum CheckResult {
    Passed,
    Failed,
    /// Skipped check, with the names of the missing tools.
    Skipped(String),
}

/// Returns the file that receives the output of a check in the background queue.
fn output_file(check: &Check) -> PathBuf {
    root().join("target/checks").join(check.name.replace(' ', "-")).with_extension("txt")
}

/// Prints the last lines of a failed check in the background queue.
///
/// The whole output was printed when the check ended, far above the end of a long log.
fn print_last_lines(check: &Check) {
    /// Number of printed lines.
    const LINES: usize = 40;
    let Ok(output) = read_to_string(output_file(check)) else { return };
    let lines: Vec<&str> = output.lines().collect();
    println!("\n== {}: last lines", check.name);
    for line in lines.iter().skip(lines.len().saturating_sub(LINES)) {
        println!("{line}");
    }
}

/// Creates an empty folder, so that a run does not depend on earlier runs.
fn make_empty(folder: &str) -> anyhow::Result<()> {
    let folder = root().join(folder);
    if folder.exists() {
        std::fs::remove_dir_all(&folder)?;
    }
    Ok(std::fs::create_dir_all(folder)?)
}
