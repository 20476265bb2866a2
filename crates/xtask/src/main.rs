//! Development commands: `cargo xtask test [--install]`, `bench`, `peers`, `accuracy`, `notices`, `web`, `js`, `py`,
//! `c`, `golden`, `serve`.

// A module uses only those above it.
mod workspace;
mod wasm;
mod tools;
mod check;
mod coverage;
mod notices;
mod accuracy;
mod archives;
mod golden;
mod py;
mod c;
mod bench;
mod peers;
mod serve;
#[cfg(feature = "web")]
mod pictures;
#[cfg(feature = "web")]
mod web;
#[cfg(feature = "web")]
mod browser;
#[cfg(feature = "web")]
mod js;

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
    /// Measure, on one thread; prints one JSON object
    Bench {
        /// As JSON (the only form there is)
        #[arg(long)]
        json: bool,
        /// Only the keys that contain this
        #[arg(default_value = "")]
        filter: String,
    },
    /// Measure the maps beside `OpenCV`'s, with AVX2 and with all there is: a table
    Peers,
    /// Write the notices of everything that is linked into the programs
    Notices,
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
    /// Serve a folder on this machine only, for trying
    Serve {
        /// Which
        #[arg(default_value = "target/web")]
        folder: PathBuf,
        /// On which port; 0 takes a free one
        #[arg(long, default_value_t = 8080)]
        port: u16,
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
    },
}

/// Where the tests of other languages find the golden points.
fn golden() -> PathBuf {
    workspace::root().join("target/golden")
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().command {
        Command::Test { install } => check::run(install),
        Command::Bench { json: _, filter } => {
            // An unoptimised number is worse than none.
            if cfg!(debug_assertions) {
                return workspace::rerun(&["--release"], &["bench".into(), filter]);
            }
            bench::run(&filter)
        }
        Command::Peers => peers::run(),
        Command::Notices => notices::run(),
        #[cfg(feature = "web")]
        Command::Web { out, built } => web::run(&workspace::root().join(out), built.as_deref()),
        #[cfg(feature = "web")]
        Command::Browser { out, script, pictures, as_is } => browser::run(
            &workspace::root().join(out),
            &script,
            pictures.map(|p| workspace::root().join(p)).as_deref(),
            as_is,
        ),
        #[cfg(feature = "web")]
        Command::Js { out, test } => {
            let out = workspace::root().join(out);
            js::run(&out)?;
            if test { js::test(&out) } else { Ok(()) }
        }
        Command::Py { out, test } => {
            let wheel = py::run(&workspace::root().join(out), if test { "dev" } else { "release" })?;
            if test { py::test(&wheel, &golden()) } else { Ok(()) }
        }
        Command::C { test: true, .. } => c::test(&golden()),
        Command::C { out, test: false } => c::run(&workspace::root().join(out)),
        Command::Golden { out } => golden::run(&workspace::root().join(out)),
        // What it takes is heavy, so it is built when it is asked for.
        #[cfg(not(feature = "web"))]
        Command::Web { .. } | Command::Js { .. } | Command::Browser { .. } => {
            let arguments: Vec<String> = std::env::args().skip(1).collect();
            workspace::rerun(&["--features", "web"], &arguments)
        }
        Command::Serve { folder, port } => {
            let site = serve::Site::new(&workspace::root().join(folder), port)?;
            println!("http://{}/", site.address()?);
            site.serve();
            Ok(())
        }
        Command::Accuracy { real: true, .. } => coverage::run(),
        Command::Accuracy { proposals: true, .. } => accuracy::proposals(),
        Command::Accuracy { compare: true, .. } => accuracy::compare(),
        Command::Accuracy { scenes, draws, .. } => {
            accuracy::run(&accuracy::Extent { scenes, draws });
            Ok(())
        }
    }
}
