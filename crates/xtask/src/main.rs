//! Development commands: `cargo xtask test [--install]`, `bench`, `peers`, `accuracy`, `notices`, `web`, `js`, `py`,
//! `c`, `golden`, `serve`.

// A module uses only those above it.
mod workspace;
mod serve;
mod tools;
mod check;
mod notices;
#[cfg(feature = "all")]
mod heavy;

use std::path::PathBuf;

use clap::{Parser, Subcommand};

#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run every check there is; those whose tools are missing are listed as SKIPPED
    Test {
        /// Install the missing tools first, and take a skip for a failure
        #[arg(long)]
        install: bool,
    },
    /// Write the notices of everything that is linked into the programs
    Notices,
    /// Serve a folder on this machine only, for trying
    Serve {
        /// Which
        #[arg(default_value = "target/web")]
        folder: PathBuf,
        /// On which port; 0 takes a free one
        #[arg(long, default_value_t = 8080)]
        port: u16,
    },
    #[command(flatten)]
    Heavy(Heavy),
}

/// What it takes is heavy, so it is built when it is asked for.
#[derive(Debug, Subcommand)]
enum Heavy {
    /// Measure, on one thread; prints one JSON object
    Bench {
        /// As JSON (the only form there is)
        #[arg(long)]
        json: bool,
        /// Only the keys that contain this
        #[arg(default_value = "")]
        filter: String,
    },
    /// Measure the maps and the joint fit beside those of OpenCV, SciPy and COLMAP: tables
    Peers,
    /// Build the app for the browser: static files, and one page that needs no host
    Web {
        /// Where to
        #[arg(long, default_value = "target/web")]
        out: PathBuf,
        /// The program, where it is built already
        #[arg(long)]
        built: Option<PathBuf>,
    },
    /// Build the package for JavaScript
    Js {
        /// Where to
        #[arg(long, default_value = "target/js")]
        out: PathBuf,
        /// Check its types and run its test in Node
        #[arg(long)]
        test: bool,
    },
    /// Build the wheel for Python
    Py {
        /// Where to
        #[arg(long, default_value = "target/python")]
        out: PathBuf,
        /// Build it quickly, install it into target/python-venv, and run its tests
        #[arg(long)]
        test: bool,
        /// Try the one that was built for the tests on what Ultralytics finds
        #[arg(long, conflicts_with = "test")]
        ultralytics: bool,
    },
    /// Write the header for C and C++, and build the library
    C {
        /// Where to, as a prefix: lib/, include/
        #[arg(long, default_value = "target/c")]
        out: PathBuf,
        /// Compile and run its tests in place of that
        #[arg(long)]
        test: bool,
    },
    /// Write the points that every language must map to the same bits
    Golden {
        /// Where to
        #[arg(long, default_value = "target/golden")]
        out: PathBuf,
    },
    /// Drive the app in Chromium
    Browser {
        /// Where the page is, or is built to
        #[arg(long, default_value = "target/web")]
        out: PathBuf,
        /// Which script of crates/calib-app/tests/browser
        #[arg(long, default_value = "flow.mjs")]
        script: String,
        /// With the page as it is there
        #[arg(long)]
        as_is: bool,
        /// Where pictures of the screens go
        #[arg(long)]
        pictures: Option<PathBuf>,
    },
    /// Print the table of accuracy as Markdown
    Accuracy {
        /// Scenes of each kind
        #[arg(long, default_value_t = 200)]
        scenes: usize,
        /// Draws of noise per scene
        #[arg(long, default_value_t = 60)]
        draws: usize,
        /// On real data in place of simulated: errors beside their sigmas, and the share inside intervals
        #[arg(long)]
        real: bool,
        /// Of what stills propose by themselves, in place of simulated
        #[arg(long, conflicts_with = "real")]
        proposals: bool,
        /// Of how cameras moved between two stills, in place of simulated
        #[arg(long, conflicts_with_all = ["real", "proposals"])]
        compare: bool,
        /// Of how moved cameras are found by the people that they see, in place of simulated
        #[arg(long, conflicts_with_all = ["real", "proposals", "compare"])]
        watch: bool,
    },
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().command {
        Command::Test { install } => check::run(install),
        Command::Notices => notices::run(),
        Command::Serve { folder, port } => {
            let site = serve::Site::new(&workspace::root().join(folder), port)?;
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
