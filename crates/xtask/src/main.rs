//! Development commands: `cargo xtask test [--install]`, `bench`, `accuracy`, `notices`.

mod accuracy;
mod archives;
mod bench;
mod check;
mod notices;

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
    /// Write the notices of everything that is linked into the programs
    Notices,
    /// Print the table of accuracy as Markdown
    Accuracy {
        /// Scenes of each kind
        #[arg(long, default_value_t = 200)]
        scenes: usize,
        /// Draws of noise per scene
        #[arg(long, default_value_t = 60)]
        draws: usize,
    },
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().command {
        Command::Test { install } => check::run(install),
        Command::Bench { json: _, filter } => {
            // An unoptimised number is worse than none.
            if cfg!(debug_assertions) {
                return check::rerun_optimised(&["bench", &filter]);
            }
            bench::run(&filter)
        }
        Command::Notices => notices::run(),
        Command::Accuracy { scenes, draws } => {
            accuracy::run(&accuracy::Extent { scenes, draws });
            Ok(())
        }
    }
}
