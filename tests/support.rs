//! Helpers of the whole-program tests: the built program, scratch folders, distances between lenses, and reported
//! skips.

/// The README, whose example is compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
#[derive(Debug)]
pub struct Readme;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use calib_core::{BrownConrady, Camera, Covariance, Distortion, Lens, Pixel, UndistortedPixel, WorldPoint};

use calib_site::{Method, SiteCamera, Solution, Stage};
use serde_json::Value;
use tempfile::TempDir;

/// Result of a run of the program.
#[derive(Debug)]
pub struct ProgramOutput {
    /// Exit code.
    pub code: i32,
    /// Standard output: the data.
    pub stdout: String,
    /// Standard error: the messages.
    pub stderr: String,
}

impl ProgramOutput {
    /// Parses stdout as JSON.
    ///
    /// # Panics
    /// If stdout is not valid JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error} in {}", self.stdout))
    }

    /// Returns the result after checking the exit code.
    ///
    /// # Panics
    /// If the exit code differs.
    pub fn expect_code(self, code: i32) -> Self {
        assert_eq!(self.code, code, "stdout: {}\nstderr: {}", self.stdout, self.stderr);
        self
    }
}

/// Temporary folder of one test, in which it runs the program.
#[derive(Debug)]
pub struct Scratch(TempDir);

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl Scratch {
    /// Creates an empty folder.
    ///
    /// # Panics
    /// If the folder cannot be created.
    #[must_use]
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap_or_else(|error| panic!("{error}")))
    }

    /// Returns a path in the folder.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file.
    ///
    /// # Panics
    /// If the file cannot be written.
    pub fn write(&self, name: &str, contents: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), contents).unwrap_or_else(|error| panic!("{name}: {error}"));
    }

    /// Reads a JSON file.
    ///
    /// # Panics
    /// If the file is missing or not valid JSON.
    #[must_use]
    pub fn read_json(&self, name: &str) -> Value {
        let text = std::fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Runs `calib` in the folder.
    #[must_use]
    pub fn calib(&self, args: &[&str]) -> ProgramOutput {
        self.calib_with(args, "")
    }

    /// Runs `calib` in the folder with text on stdin.
    ///
    /// # Panics
    /// If the program cannot be started.
    #[must_use]
    pub fn calib_with(&self, args: &[&str], stdin: &str) -> ProgramOutput {
        let mut child = Command::new(program())
            .args(args)
            .current_dir(self.0.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("calib: {error}"));
        let mut input = child.stdin.take();
        let text = stdin.to_owned();
        let feeder = std::thread::spawn(move || {
            // A program that does not read its input closes the pipe. That is not a failure.
            let _ = input.as_mut().map(|input| input.write_all(text.as_bytes()));
        });
        let output = child.wait_with_output().unwrap_or_else(|error| panic!("calib: {error}"));
        let _ = feeder.join();
        ProgramOutput {
            code: output.status.code().unwrap_or(-1),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// Returns the path of the program, which is built once in the profile of the tests.
///
/// # Panics
/// If the build fails.
#[must_use]
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        if std::env::var_os("CALIB_IS_BUILT").is_none() {
            build();
        }
        // The test is target/<profile>/deps/<test>, the program target/<profile>/calib.
        let mut path = std::env::current_exe().unwrap_or_else(|error| panic!("{error}"));
        path.pop();
        if path.ends_with("deps") {
            path.pop();
        }
        path.join("calib").with_extension(std::env::consts::EXE_EXTENSION)
    })
}

fn build() {
    let mut command = Command::new(env!("CARGO"));
    command.args(["build", "--quiet", "--package", "calib-cli", "--bin", "calib"]);
    if !cfg!(debug_assertions) {
        command.arg("--release");
    }
    let built = command.current_dir(root()).status();
    assert!(built.is_ok_and(|status| status.success()), "calib does not build");
}

/// Returns the folder of the workspace.
///
/// # Panics
/// Never: this crate is a folder of the workspace.
#[must_use]
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or_else(|| panic!("no workspace"))
}

/// Width and height of the images of [`camera`], in pixels.
pub const SIZE: [u32; 2] = [1920, 1080];

/// Returns a camera 5 m high that looks down on the floor, with the given distortion.
#[must_use]
pub const fn camera(distortion: Distortion) -> Camera {
    Camera {
        position: WorldPoint::new(3.0, -4.0, 5.0),
        yaw: 0.3,
        pitch: 0.5,
        roll: 0.05,
        focal: 1250.0,
        lens: Lens {
            principal_point: Pixel::new(957.0, 548.0),
            focal: 1250.0,
            distortion,
            image_circle: None,
            pixel_aspect: 1.0,
        },
        covariance: Covariance::EXACT,
    }
}

/// Distortions of the test cameras: five Brown-Conrady coefficients, none, and the division model.
pub const LENSES: [Distortion; 3] = [
    Distortion::BrownConrady(BrownConrady { k1: -0.25, k2: 0.06, k3: -0.004, p1: 0.001, p2: -0.0007 }),
    Distortion::None,
    Distortion::Division { lambda: -0.12 },
];

/// Returns a camera 4 m above (x, 0) that looks along +y.
#[must_use]
pub fn above(x: f64) -> Camera {
    Camera {
        position: WorldPoint::new(x, 0.0, 4.0),
        yaw: 0.0,
        pitch: 0.5,
        roll: 0.0,
        focal: 1200.0,
        lens: Lens::pinhole([960.0, 540.0].into()),
        covariance: Covariance::EXACT,
    }
}

/// Returns a placed camera of a site with a given solution.
#[must_use]
pub fn entry(id: &str, camera: &Camera) -> SiteCamera {
    let solution = Solution::from_camera(camera, Method::Given, Stage::Placed);
    SiteCamera { solution: Some(solution), ..SiteCamera::new(id, SIZE) }
}

/// Returns the path of a file of real data outside the project, or `None` after reporting a skip if it is
/// missing. The folder is `CALIB_SHARED`, by default `shared` next to the workspace.
#[must_use]
pub fn shared(path: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("CALIB_SHARED").map_or_else(|| root().join("../shared"), PathBuf::from);
    let found = folder.join(path);
    if found.exists() {
        return Some(found);
    }
    skip(&format!("{path} is absent: CALIB_SHARED names the folder of real data"), true);
    None
}

/// Returns the Python with the peers' packages, or `None` after reporting that it is missing.
#[must_use]
pub fn peers_python() -> Option<PathBuf> {
    let python = root().join("target/peers-venv/bin/python");
    if python.exists() {
        return Some(python);
    }
    skip("target/peers-venv is absent; `cargo xtask test --install` makes it", false);
    None
}

/// Returns the Python with the engines (`DuckDB`), or `None` after reporting that it is missing.
#[must_use]
pub fn engines_python() -> Option<PathBuf> {
    let python = root().join("target/engines-venv/bin/python");
    if python.exists() {
        return Some(python);
    }
    skip("target/engines-venv is absent; `cargo xtask test --install` makes it", false);
    None
}

/// Returns the root mean square distance over the image between two maps, after the best similarity between
/// them. A scale and a rotation of the undistorted plane are not distortion.
///
/// # Panics
/// If more than a sixth of the image is outside one of the lenses.
#[must_use]
pub fn map_distance(a: &Lens, b: &Lens, [w, h]: [f64; 2]) -> f64 {
    let grid = (0..20 * 12)
        .map(|k| Pixel::new(w * (f64::from(k % 20) + 0.5) / 20.0, h * (f64::from(k / 20) + 0.5) / 12.0));
    let pairs: Vec<_> = grid.filter_map(|p| Some((a.undistort(p)?, b.undistort(p)?))).collect();
    assert!(pairs.len() > 200, "{} of 240 points are inside both lenses", pairs.len());
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&(UndistortedPixel, UndistortedPixel)) -> f64| {
        pairs.iter().map(value).sum::<f64>() / count
    };
    let (au, av, bu, bv) = (mean(&|p| p.0.u), mean(&|p| p.0.v), mean(&|p| p.1.u), mean(&|p| p.1.v));
    let (mut dot, mut cross, mut square) = (0.0, 0.0, 0.0);
    for (p, q) in &pairs {
        let (x, y, s, t) = (p.u - au, p.v - av, q.u - bu, q.v - bv);
        dot += x * s + y * t;
        cross += x * t - y * s;
        square += x * x + y * y;
    }
    let (c, s) = (dot / square, cross / square);
    let off = pairs.iter().map(|(p, q)| {
        let (x, y) = (p.u - au, p.v - av);
        (c * x - s * y - (q.u - bu)).powi(2) + (s * x + c * y - (q.v - bv)).powi(2)
    });
    (off.sum::<f64>() / count).sqrt()
}

/// Reports a skipped test on stderr and in the list that `cargo xtask test` prints.
fn skip(why: &str, allowed: bool) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let line = format!("{} {test}: {why}\n", if allowed { "SKIPPED" } else { "MISSING" });
    let _ = std::io::stderr().write_all(line.as_bytes());
    if let Some(list) = std::env::var_os("CALIB_SKIPPED_LIST") {
        let file = std::fs::OpenOptions::new().create(true).append(true).open(list);
        let _ = file.map(|mut file| file.write_all(line.as_bytes()));
    }
}
