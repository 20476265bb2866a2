//! Whole-program tests: the command line, real data, other programs, and the layout of the sources.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod archives;
mod cli;
mod compare;
mod coverage;
mod demonstration;
mod detections;
mod engines;
mod estimators;
mod evidence;
mod files;
mod fisheye;
mod formats;
mod gate;
mod geographic;
mod joint;
mod layout;
mod lens_files;
mod lenses;
mod measure;
mod notices;
mod peers;
mod pixels;
mod plan_places;
mod planes;
mod plans;
mod point_table;
mod points;
mod principal_point;
mod proposals;
mod prose;
mod real;
mod registration;
mod reliability;
mod rolls;
mod scenes;
mod schema;
mod still;
mod tracker;
mod walk;
mod watch;
mod window;
mod windows;
mod wrong;
