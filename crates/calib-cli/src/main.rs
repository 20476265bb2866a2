//! `calib`: calibrate the cameras of a site from one still image each.
//!
//! stdout is data, stderr is messages. Exit codes: 0 ok; 1 failed; 2 usage; 3 the input is invalid;
//! 4 a camera could not be solved or a quality gate failed; 5 a lossy export was refused.

#![cfg_attr(not(feature = "archives"), allow(dead_code, reason = "what reads archives uses it"))]

mod stop;
mod files;
#[cfg(feature = "archives")]
mod archive;
mod picture;
#[cfg(feature = "archives")]
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
#[cfg(feature = "archives")]
mod detections;
#[cfg(feature = "archives")]
mod project;
#[cfg(feature = "archives")]
mod export;
mod import;
mod propose;
#[cfg(feature = "archives")]
mod walk;
mod report;
mod windows;
mod undistort;
#[cfg(feature = "archives")]
mod watch;

use std::io::Write as _;
use std::process::ExitCode;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::stop::Stop;

/// Calibrate the cameras of a site from one still image each: no patterns, no video, no server.
#[derive(Debug, Parser)]
#[command(name = "calib", version, propagate_version = true, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// One subcommand a file; the list is the registry.
#[derive(Debug, Subcommand)]
enum Command {
    /// Write the demonstration site, solve it, render it, and print the errors against the truth
    Demo(demo::Args),
    /// Calibrate a site: text report, or the solutions as JSON
    Solve(solve::Args),
    /// Propose the calibration of stills from the edges in them; exit 4 where one has none that is accepted
    Propose(propose::Args),
    /// Map tables of detections to the floor, or of points of space to pixels: CSV, NDJSON, Arrow, Parquet
    #[cfg(feature = "archives")]
    Project(project::Args),
    /// Write a camera's image without lens distortion, or windows that look anywhere in it (PNG, or JPEG for .jpg)
    Undistort(undistort::Args),
    /// Draw annotations, horizon, metre grid, EFOV and marks on an image, or all cameras on the plan (PNG, or JPEG for .jpg)
    Render(render::Args),
    /// Quality gate: exit 4 when a camera is unsolved, or camera or site are worse than asked
    Check(check::Args),
    /// Find cameras that moved by the people that they see: since when, by how much; exit 4 when one did
    #[cfg(feature = "archives")]
    Watch(watch::Args),
    /// Find cameras that turned, zoomed or were replaced, by a newer still of each; exit 4 when one did
    Compare(compare::Args),
    /// Acceptance by a walker whom several cameras see: floor error by zone, cameras that disagree; exit 4 when it fails
    #[cfg(feature = "archives")]
    Walk(walk::Args),
    /// Write one self-contained HTML page to hand over: every overlay, number and warning
    Report(report::Args),
    /// Write the calibration as other programs have it; exit 5 when the format cannot hold it
    Export(export::Args),
    /// Read cameras of another program into a site
    Import(import::Args),
    /// Print the JSON Schema of the site file
    Schema,
    /// Print the licence of this program and the notices of everything that is part of it
    Licenses,
    /// Print completions for a shell
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
}

/// What the command line asks for; ends where that is nothing, or not understood.
fn parsed() -> Cli {
    let command = Cli::command();
    #[cfg(feature = "archives")]
    let command = command.mut_subcommand("report", |report| report.mut_args(walk::goes_with_a_walk));
    Cli::from_arg_matches_mut(&mut command.get_matches()).unwrap_or_else(|error| error.exit())
}

fn main() -> ExitCode {
    let result = match parsed().command {
        Command::Demo(args) => demo::run(&args),
        Command::Solve(args) => solve::run(&args),
        Command::Propose(args) => propose::run(&args),
        #[cfg(feature = "archives")]
        Command::Project(args) => project::run(&args),
        Command::Undistort(args) => undistort::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Check(args) => check::run(&args),
        #[cfg(feature = "archives")]
        Command::Watch(args) => watch::run(&args),
        Command::Compare(args) => compare::run(&args),
        #[cfg(feature = "archives")]
        Command::Walk(args) => walk::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Schema => schema(),
        Command::Licenses => licenses(),
        Command::Completions { shell } => completions(shell),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(stop) => {
            if let Some(message) = stop.message() {
                // A closed stderr leaves nobody to tell.
                let _ = writeln!(std::io::stderr(), "calib: {}", stop::visible(&message));
            }
            ExitCode::from(stop.code())
        }
    }
}

fn schema() -> Result<(), Stop> {
    let mut text = serde_json::to_string_pretty(&calib_site::Site::json_schema())?;
    text.push('\n');
    files::print(&text)
}

fn licenses() -> Result<(), Stop> {
    let own = "calib is licensed under MIT or Apache-2.0, at your option.\n\n";
    files::print(&format!("{own}{}", include_str!("../THIRD-PARTY.txt")))
}

fn completions(shell: clap_complete::Shell) -> Result<(), Stop> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "calib", &mut script);
    files::print(&String::from_utf8_lossy(&script))
}
