//! Development commands of this workspace, run as `cargo xtask COMMAND`.
//!
//! `test`, `notices`, `docs` and `serve` are small and start at once. The other commands are in `heavy` and are
//! compiled on first use.
//!
//! - `workspace`: folder of the workspace, and the restart with all features
//! - `server`: local web server, and detection of the wasm32 compiler
//! - `tools`: external tools of the checks and their installation
//! - `check`: list of all checks, and its runner
//! - `notices`: licence notices of the linked crates
//! - `docs`: guide, API documentation, schema and page in one folder
//! - `heavy`: builds, benchmarks and accuracy tables

// In dependency order: a module uses only modules listed above it.
mod workspace;
mod server;
mod tools;
mod check;
mod notices;
mod docs;
#[cfg(feature = "all")]
mod heavy;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run every check; checks with missing tools are listed as SKIPPED
    Test {
        /// Install missing tools first, and treat skipped checks as failures
        #[arg(long)]
        install: bool,
    },
    /// Write the licence notices of all crates linked into the programs
    Notices,
    /// Write the guide with the API documentation, the schema and the built page into one folder
    Docs {
        /// Output folder
        #[arg(long, default_value = "target/docs")]
        out: PathBuf,
    },
    /// Serve a folder over HTTP on this machine only
    Serve {
        /// Folder to serve
        #[arg(default_value = "target/web")]
        folder: PathBuf,
        /// Port to listen on; 0 selects a free port
        #[arg(long, default_value_t = 8080)]
        port: u16,
    },
    #[command(flatten)]
    Heavy(Heavy),
}

/// Commands with large dependencies, which are compiled on first use.
#[derive(Debug, Subcommand)]
enum Heavy {
    /// Run the single-threaded benchmarks and print one JSON object
    Bench {
        /// Print JSON (the only output format)
        #[arg(long)]
        json: bool,
        /// Run only benchmarks whose key contains this text
        #[arg(default_value = "")]
        filter: String,
    },
    /// Compare the speed of mapping and joint refinement with OpenCV, SciPy and COLMAP
    Peers,
    /// Build the web app: static files, and one self-contained page
    Web {
        /// Output folder
        #[arg(long, default_value = "target/web")]
        out: PathBuf,
        /// Use this compiled WebAssembly program instead of building it
        #[arg(long)]
        built: Option<PathBuf>,
    },
    /// Build the JavaScript package
    Js {
        /// Output folder
        #[arg(long, default_value = "target/js")]
        out: PathBuf,
        /// Check its types and run its tests in Node and Chromium
        #[arg(long)]
        test: bool,
    },
    /// Build the Python wheel
    Py {
        /// Output folder
        #[arg(long, default_value = "target/python")]
        out: PathBuf,
        /// Build quickly, install into target/python-venv, and run the tests
        #[arg(long)]
        test: bool,
        /// Test the wheel built by --test with the Ultralytics package
        #[arg(long, conflicts_with = "test")]
        ultralytics: bool,
    },
    /// Write the C header and build the C library
    C {
        /// Output folder; receives lib/ and include/
        #[arg(long, default_value = "target/c")]
        out: PathBuf,
        /// Compile and run the tests instead
        #[arg(long)]
        test: bool,
    },
    /// Write the golden points that all language bindings must reproduce bit for bit
    Golden {
        /// Output folder
        #[arg(long, default_value = "target/golden")]
        out: PathBuf,
    },
    /// Run a test script against the app in Chromium
    Browser {
        /// Folder of the built page
        #[arg(long, default_value = "target/web")]
        out: PathBuf,
        /// Script in crates/calib-app/tests/browser
        #[arg(long, default_value = "flow.mjs")]
        script: String,
        /// Use the existing page without building it
        #[arg(long)]
        as_is: bool,
        /// Save screenshots to this folder
        #[arg(long)]
        pictures: Option<PathBuf>,
    },
    /// Take the pictures of the README and of the guide from the app in Chromium
    Pictures {
        /// Folder of the built page
        #[arg(long, default_value = "target/web")]
        out: PathBuf,
        /// Use the existing page without building it
        #[arg(long)]
        as_is: bool,
    },
    /// Print an accuracy table as Markdown
    Accuracy {
        /// Number of scenes of each kind
        #[arg(long, default_value_t = 200)]
        scenes: usize,
        /// Number of noise draws per scene
        #[arg(long, default_value_t = 60)]
        draws: usize,
        /// Use real data: errors, standard deviations and interval coverage
        #[arg(long)]
        real: bool,
        /// Evaluate automatic calibration from single images
        #[arg(long, conflicts_with = "real")]
        proposals: bool,
        /// Evaluate camera rotation and zoom measured between two images
        #[arg(long, conflicts_with_all = ["real", "proposals"])]
        compare: bool,
        /// Evaluate drift detection from observed people
        #[arg(long, conflicts_with_all = ["real", "proposals", "compare"])]
        watch: bool,
    },
}

fn main() -> ExitCode {
    match run(Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        // The `Debug` form of the error would also print a backtrace of this program.
        Err(error) => {
            eprintln!("Error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Test { install } => check::run(install),
        Command::Notices => notices::run(),
        Command::Docs { out } => docs::run(&workspace::root().join(out)),
        Command::Serve { folder, port } => {
            let site = server::FolderServer::new(&workspace::root().join(folder), port)?;
            println!("http://{}/", site.address()?);
            site.serve();
            Ok(())
        }
        #[cfg(feature = "all")]
        Command::Heavy(command) => heavy::run(command),
        #[cfg(not(feature = "all"))]
        Command::Heavy(_) => workspace::rerun(&[]),
    }
}
