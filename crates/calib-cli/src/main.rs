//! The `calib` command line: calibrates the cameras of a site from one image each.
//!
//! Results go to stdout, messages to stderr. Exit codes: 0 success; 1 failure; 2 usage error; 3 invalid
//! input; 4 a camera could not be solved or a quality gate failed; 5 a lossy export was refused.
//!
//! Most subcommands have a file with their name. Shared files:
//! - `args`: arguments of several subcommands
//! - `site_file`: the site file and the images of its cameras
//! - `files`, `picture`, `archive`: safe output files, encoded images, and tables in CSV, NDJSON, Arrow and
//!   Parquet
//! - `painting`, `plan_ground`, `sigma_map`: overlays, plan backgrounds and error maps
//! - `progress`: progress bars
//! - `stop`: errors with their exit codes
//!
//! Parts of single subcommands: `detections` (`watch`, `walk`), `map_position` (`plan`), `placing` (`propose`),
//! `windows` (`undistort`), `snapshot` and `snapshot_list` (`still`).

#![cfg_attr(not(feature = "archives"), allow(dead_code, reason = "used by the archive readers"))]

mod stop;
mod files;
#[cfg(feature = "archives")]
mod archive;
mod picture;
mod progress;
mod site_file;
mod args;
mod solve;
mod check;
mod compare;
mod painting;
mod plan_ground;
mod sigma_map;
mod render;
mod demo;
#[cfg(feature = "archives")]
mod detections;
#[cfg(feature = "archives")]
mod project;
mod export;
mod import;
mod map_position;
mod plan;
mod placing;
mod propose;
#[cfg(feature = "archives")]
mod walk;
mod report;
mod coverage;
mod measure;
mod windows;
mod undistort;
#[cfg(feature = "stills")]
mod snapshot;
#[cfg(feature = "stills")]
mod snapshot_list;
#[cfg(feature = "stills")]
mod still;
#[cfg(feature = "archives")]
mod watch;

use std::io::Write as _;
use std::process::ExitCode;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::stop::CommandError;

/// Calibrate the cameras of a site from one image each: no patterns, no video, no server.
#[derive(Debug, Parser)]
#[command(name = "calib", version, propagate_version = true, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// Subcommands; most have a file with their name.
#[derive(Debug, Subcommand)]
enum Command {
    /// Write a demonstration site, calibrate it, render it, and print the errors against ground truth
    Demo(demo::Args),
    /// Calibrate a site; print a text report, or the solutions as JSON
    Solve(solve::Args),
    /// Calibrate images automatically from their edges; exit 4 if a result is not accepted
    Propose(propose::Args),
    /// Write a still image from a video, or a snapshot from the address of a camera (PNG, or JPEG for .jpg)
    #[cfg(feature = "stills")]
    Still(still::Args),
    /// Map tables of detections to the floor, or 3D points to pixels (CSV, NDJSON, Arrow, Parquet)
    #[cfg(feature = "archives")]
    Project(Box<project::Args>),
    /// Print size, scale, pages and layers of a floor plan (PDF, DXF, SVG, image), or write the plan as an
    /// image or into a site
    Plan(plan::Args),
    /// Write an image without lens distortion, or virtual views in any direction (PNG, or JPEG for .jpg)
    Undistort(undistort::Args),
    /// Draw annotations, horizon, floor grid, EFOV and marks on an image, or all cameras on the plan (PNG, or
    /// JPEG for .jpg)
    Render(render::Args),
    /// Quality gate: exit 4 if a camera is unsolved, or a camera or the site exceeds a limit
    Check(check::Args),
    /// Find which cameras were moved, when, and by how much, from detections of people; exit 4 if any were
    /// moved
    #[cfg(feature = "archives")]
    Watch(watch::Args),
    /// Find cameras that were rotated, zoomed or replaced, from newer images; exit 4 if any changed
    Compare(compare::Args),
    /// Run an acceptance test with a walk through the site: floor error by zone and cameras that disagree;
    /// exit 4 if the test fails
    #[cfg(feature = "archives")]
    Walk(walk::Args),
    /// Compute the visible floor, pixel densities and blind spots; exit 4 if an area misses its level (CSV,
    /// GeoJSON, PNG, HTML)
    Coverage(coverage::Args),
    /// Measure lengths, heights, areas and speeds in the images, with standard deviations
    Measure(measure::Args),
    /// Write a self-contained HTML report with every overlay, number and warning
    Report(report::Args),
    /// Export the calibration for another program; exit 5 if the format would lose data
    Export(export::Args),
    /// Import the cameras of another program into a site
    Import(import::Args),
    /// Print the JSON Schema of the site file
    Schema,
    /// Print the licence of this program and the notices of its components
    Licenses,
    /// Print shell completions
    Completions {
        /// Shell to print completions for
        shell: clap_complete::Shell,
    },
}

/// Parses the command line; exits with usage help if it is empty or invalid.
fn parse_args() -> Cli {
    let command = Cli::command();
    #[cfg(feature = "archives")]
    let command = command.mut_subcommand("report", |report| report.mut_args(walk::require_walk));
    Cli::from_arg_matches_mut(&mut command.get_matches()).unwrap_or_else(|error| error.exit())
}

fn main() -> ExitCode {
    let result = match parse_args().command {
        Command::Demo(args) => demo::run(&args),
        Command::Solve(args) => solve::run(&args),
        Command::Propose(args) => propose::run(&args),
        #[cfg(feature = "archives")]
        Command::Project(args) => project::run(&args),
        #[cfg(feature = "stills")]
        Command::Still(args) => still::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Undistort(args) => undistort::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Check(args) => check::run(&args),
        #[cfg(feature = "archives")]
        Command::Watch(args) => watch::run(&args),
        Command::Compare(args) => compare::run(&args),
        #[cfg(feature = "archives")]
        Command::Walk(args) => walk::run(&args),
        Command::Coverage(args) => coverage::run(&args),
        Command::Measure(args) => measure::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Schema => schema(),
        Command::Licenses => licenses(),
        Command::Completions { shell } => completions(shell),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if let Some(message) = error.message() {
                // stderr may be closed; the message is lost then.
                let _ = writeln!(std::io::stderr(), "calib: {}", stop::escape_control_characters(&message));
            }
            ExitCode::from(error.code())
        }
    }
}

fn schema() -> Result<(), CommandError> {
    let mut text = serde_json::to_string_pretty(&calib_site::Site::json_schema())?;
    text.push('\n');
    files::print(&text)
}

fn licenses() -> Result<(), CommandError> {
    let own = "calib is licensed under MIT or Apache-2.0, at your option.\n\n";
    files::print(&format!("{own}{}", include_str!("../THIRD-PARTY.txt")))
}

fn completions(shell: clap_complete::Shell) -> Result<(), CommandError> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "calib", &mut script);
    files::print(&String::from_utf8_lossy(&script))
}
