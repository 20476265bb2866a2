//! Example: fuses detections of several cameras into tracks on the floor.
//!
//! ```text
//! cargo run --release --example fuse_tracks -- site.json detections.csv tracks.csv
//! ```
//!
//! `detections.csv` has a row for every detected foot, in order of time: `at_s,camera,u,v` (seconds, id in
//! the site, raw pixels). For a box, use the middle of its lower edge. `tracks.csv` gets the columns
//! `at_s,track,x_m,y_m,sigma_x_m,sigma_y_m,seen_by`.
//!
//! Every detection is mapped to the floor with its covariance. It is gated and assigned to a track by its
//! Mahalanobis distance, whatever its camera. A track is a Kalman filter of position and velocity. The error
//! of a calibration is common to all detections of its camera, so averaging does not reduce it. The filter
//! therefore considers it without estimating it (Schmidt 1966).

use std::collections::BTreeMap;
use std::error::Error;

use calib_core::{Camera, Covariance, Pixel};

use calib_site::{Options, Site};
use nalgebra::{Matrix2, Matrix4, SMatrix, Vector2, Vector4};

/// Standard deviation of a detected foot, in pixels.
pub(crate) const FOOT_PX: f64 = 2.0;
/// Standard deviation of a person's speed at the first detection, in m/s.
const INITIAL_SPEED_SIGMA: f64 = 1.2;
/// Spectral density of a person's acceleration, in m^2/s^3.
const ACCELERATION_DENSITY: f64 = 0.8;
/// Largest squared Mahalanobis distance between a track and its detection: the 99.9 % quantile.
const MAX_DISTANCE_SQUARED: f64 = 13.8;
/// Time without detections after which a confirmed track ends, in seconds.
const MAX_GAP_S: f64 = 3.0;
/// Time without detections after which an unconfirmed track ends, in seconds.
const MAX_UNCONFIRMED_GAP_S: f64 = 0.5;
/// Number of detections that confirm a track: false detections are rarely repeated.
const MIN_DETECTIONS: u32 = 4;

/// Derivatives of the floor point with respect to the parameters of a camera.
type Slopes = SMatrix<f64, 2, { Covariance::SIZE }>;
/// Covariance between the state of a track and the parameters of a camera.
type Shared = SMatrix<f64, 4, { Covariance::SIZE }>;

/// Foot detected by one camera.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Detection {
    /// Time, in seconds.
    pub(crate) at_s: f64,
    /// Id of the camera.
    pub(crate) camera: String,
    /// Raw pixel.
    pub(crate) pixel: Pixel,
}

/// Detection mapped to the floor.
struct FloorDetection {
    camera: usize,
    point: Vector2<f64>,
    /// Covariance due to the noise of the detector.
    noise: Matrix2<f64>,
    slopes: Slopes,
}

/// Track of a person on the floor.
#[derive(Clone, Debug)]
pub(crate) struct Track {
    /// Track number; counts from 1 and is never reused.
    pub(crate) id: u32,
    /// Position x, y in metres and velocity in m/s.
    pub(crate) state: Vector4<f64>,
    /// Covariance of the state, including the calibration part.
    pub(crate) covariance: Matrix4<f64>,
    /// Index of the camera of the last detection.
    pub(crate) seen_by: usize,
    seen_at: f64,
    hits: u32,
    with: BTreeMap<usize, Shared>,
}

/// Kalman update of one track by one detection.
struct Innovation {
    difference: Vector2<f64>,
    inverse: Matrix2<f64>,
    gain: SMatrix<f64, 4, 2>,
    distance: f64,
    likelihood: f64,
}

impl Track {
    fn new(
        id: u32,
        at_s: f64,
        seen: &FloorDetection,
        calibration: &SMatrix<f64, { Covariance::SIZE }, { Covariance::SIZE }>,
    ) -> Self {
        let mut covariance = Matrix4::from_diagonal_element(INITIAL_SPEED_SIGMA * INITIAL_SPEED_SIGMA);
        let own = seen.noise + seen.slopes * calibration * seen.slopes.transpose();
        covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&own);
        for k in 0..2 {
            covariance[(k, 2 + k)] = 0.0;
            covariance[(2 + k, k)] = 0.0;
        }
        let mut shared = Shared::zeros();
        shared.fixed_view_mut::<2, { Covariance::SIZE }>(0, 0).copy_from(&(seen.slopes * calibration));
        let state = Vector4::new(seen.point.x, seen.point.y, 0.0, 0.0);
        let with = BTreeMap::from([(seen.camera, shared)]);
        Self { id, state, covariance, seen_by: seen.camera, seen_at: at_s, hits: 1, with }
    }

    /// Whether the track has enough detections to exclude a false detection.
    #[must_use]
    pub(crate) const fn is_confirmed(&self) -> bool {
        self.hits >= MIN_DETECTIONS
    }

    /// Predicts the state after some seconds at constant velocity.
    fn predict(&mut self, seconds: f64) {
        let mut motion = Matrix4::identity();
        let mut wander = Matrix4::zeros();
        for k in 0..2 {
            motion[(k, 2 + k)] = seconds;
            wander[(k, k)] = ACCELERATION_DENSITY * seconds.powi(3) / 3.0;
            wander[(k, 2 + k)] = ACCELERATION_DENSITY * seconds.powi(2) / 2.0;
            wander[(2 + k, k)] = wander[(k, 2 + k)];
            wander[(2 + k, 2 + k)] = ACCELERATION_DENSITY * seconds;
        }
        self.state = motion * self.state;
        self.covariance = motion * self.covariance * motion.transpose() + wander;
        self.with.values_mut().for_each(|shared| *shared = motion * *shared);
    }

    /// Computes the update by a detection; `None` if the covariance is singular.
    fn innovation(
        &self,
        seen: &FloorDetection,
        calibration: &SMatrix<f64, { Covariance::SIZE }, { Covariance::SIZE }>,
    ) -> Option<Innovation> {
        let shared = self.with.get(&seen.camera).copied().unwrap_or_else(Shared::zeros);
        // Covariance of the state with the difference: the error of the point is correlated with that of the
        // calibration.
        let with_point = self.covariance.fixed_columns::<2>(0) - shared * seen.slopes.transpose();
        let cross = shared.fixed_rows::<2>(0) * seen.slopes.transpose();
        let own = seen.noise + seen.slopes * calibration * seen.slopes.transpose();
        let spread = self.covariance.fixed_view::<2, 2>(0, 0).into_owned() + own - cross - cross.transpose();
        let inverse = spread.try_inverse()?;
        let difference = seen.point - self.state.fixed_rows::<2>(0);
        let distance = (difference.transpose() * inverse * difference).x;
        let likelihood = -0.5 * (distance + spread.determinant().ln());
        Some(Innovation { difference, inverse, gain: with_point * inverse, distance, likelihood })
    }

    fn update(
        &mut self,
        at_s: f64,
        seen: &FloorDetection,
        by: &Innovation,
        calibration: &SMatrix<f64, { Covariance::SIZE }, { Covariance::SIZE }>,
    ) {
        self.state += by.gain * by.difference;
        let spread = by.inverse.try_inverse().unwrap_or_else(Matrix2::zeros);
        self.covariance -= by.gain * spread * by.gain.transpose();
        self.covariance = 0.5 * (self.covariance + self.covariance.transpose());
        self.with.entry(seen.camera).or_insert_with(Shared::zeros);
        for (camera, shared) in &mut self.with {
            let mut difference: Slopes = -shared.fixed_rows::<2>(0).into_owned();
            if *camera == seen.camera {
                difference += seen.slopes * calibration;
            }
            *shared += by.gain * difference;
        }
        (self.seen_by, self.seen_at, self.hits) = (seen.camera, at_s, self.hits + 1);
    }
}

/// Tracker over calibrated cameras with a common floor.
#[derive(Debug)]
pub(crate) struct Tracker {
    cameras: Vec<(String, Camera)>,
    tracks: Vec<Track>,
    given: u32,
    now: f64,
}

impl Tracker {
    /// Creates a tracker over calibrated cameras.
    #[must_use]
    pub(crate) const fn new(cameras: Vec<(String, Camera)>) -> Self {
        Self { cameras, tracks: Vec::new(), given: 0, now: f64::NEG_INFINITY }
    }

    /// Returns the confirmed tracks.
    pub(crate) fn tracks(&self) -> impl Iterator<Item = &Track> {
        self.tracks.iter().filter(|track| track.is_confirmed())
    }

    /// Processes the detections of all cameras at one time.
    ///
    /// # Errors
    /// If a camera is unknown or the time decreases.
    pub(crate) fn step(&mut self, at_s: f64, detections: &[Detection]) -> Result<(), String> {
        if at_s.is_nan() || at_s < self.now {
            return Err(format!("detections must be in order of time: {at_s} s comes after {} s", self.now));
        }
        let elapsed = if self.tracks.is_empty() { 0.0 } else { at_s - self.now };
        self.now = at_s;
        self.tracks.iter_mut().for_each(|track| track.predict(elapsed));
        for index in 0..self.cameras.len() {
            let (id, camera) = &self.cameras[index];
            let seen = detections.iter().filter(|detection| detection.camera == *id);
            let seen: Vec<FloorDetection> =
                seen.filter_map(|d| floor_detection(index, camera, d.pixel)).collect();
            self.assign(at_s, &seen);
        }
        let unknown = detections.iter().find(|d| self.cameras.iter().all(|(id, _)| *id != d.camera));
        self.tracks.retain(|track| {
            at_s - track.seen_at < if track.is_confirmed() { MAX_GAP_S } else { MAX_UNCONFIRMED_GAP_S }
        });
        unknown.map_or(Ok(()), |d| Err(format!("no calibrated camera \"{}\" in the site", d.camera)))
    }

    /// Assigns the detections of one camera to tracks, most likely pair first. Other detections start new
    /// tracks.
    fn assign(&mut self, at_s: f64, seen: &[FloorDetection]) {
        let Some(camera) = seen.first().map(|seen| seen.camera) else { return };
        // The position variance of a camera placed by hand is unknown; it is set to zero, so tracks are
        // relative to its placement.
        let known = |value: f64| if value.is_finite() { value } else { 0.0 };
        let covariance = self.cameras[camera].1.covariance.0.map(|row| row.map(known));
        let calibration = SMatrix::from(covariance);
        let mut pairs: Vec<(usize, usize, Innovation)> = Vec::new();
        for (t, track) in self.tracks.iter().enumerate() {
            for (d, seen) in seen.iter().enumerate() {
                let innovation = track.innovation(seen, &calibration);
                pairs.extend(innovation.filter(|i| i.distance < MAX_DISTANCE_SQUARED).map(|i| (t, d, i)));
            }
        }
        // Confirmed tracks have priority over unconfirmed ones.
        let rank = |(t, _, by): &(usize, usize, Innovation)| (self.tracks[*t].is_confirmed(), by.likelihood);
        pairs.sort_by(|a, b| rank(b).0.cmp(&rank(a).0).then(rank(b).1.total_cmp(&rank(a).1)));
        let (mut taken, mut given) = (vec![false; seen.len()], vec![false; self.tracks.len()]);
        for (t, d, by) in pairs {
            if !taken[d] && !given[t] {
                (taken[d], given[t]) = (true, true);
                self.tracks[t].update(at_s, &seen[d], &by, &calibration);
            }
        }
        for (seen, _) in seen.iter().zip(taken).filter(|(_, taken)| !taken) {
            self.given += 1;
            self.tracks.push(Track::new(self.given, at_s, seen, &calibration));
        }
    }
}

/// Maps a detection to the floor; `None` above the horizon or outside the lens.
fn floor_detection(index: usize, camera: &Camera, pixel: Pixel) -> Option<FloorDetection> {
    let floor = camera.pixel_to_floor(pixel, 0.0)?;
    let covariance = camera.floor_covariance(pixel, FOOT_PX)?;
    Some(FloorDetection {
        camera: index,
        point: Vector2::new(floor.x, floor.y),
        noise: Matrix2::from(covariance.pixel),
        slopes: Slopes::from(camera.floor_jacobian(pixel)?),
    })
}

/// Returns the placed cameras of a site file. An unsolved site is solved first.
///
/// # Errors
/// If the file is invalid, or a camera has several periods.
pub(crate) fn cameras(json: &str) -> Result<Vec<(String, Camera)>, Box<dyn Error>> {
    let mut site = Site::from_json(json)?;
    if site.cameras.iter().all(|entry| entry.solution.is_none()) {
        site = site.calibrate(&Options::default()).write_into(&site);
    }
    let mut placed: Vec<(String, Camera)> = Vec::new();
    for entry in &site.cameras {
        if placed.iter().any(|(id, _)| *id == entry.id) {
            return Err(
                format!("camera {:?} has several periods: keep the one of the detections", entry.id).into()
            );
        }
        placed.extend(entry.camera().filter(|_| entry.is_placed()).map(|camera| (entry.id.clone(), camera)));
    }
    Ok(placed)
}

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [site, detections, tracks] = args.as_slice() else {
        return Err("usage: fuse_tracks SITE.json DETECTIONS.csv TRACKS.csv".into());
    };
    let json = std::fs::read_to_string(site).map_err(|error| format!("{site}: {error}"))?;
    let cameras = cameras(&json).map_err(|error| format!("{site}: {error}"))?;
    let mut reader = csv::Reader::from_path(detections).map_err(|error| format!("{detections}: {error}"))?;
    let mut writer = csv::Writer::from_path(tracks).map_err(|error| format!("{tracks}: {error}"))?;
    writer.write_record(["at_s", "track", "x_m", "y_m", "sigma_x_m", "sigma_y_m", "seen_by"])?;
    let names: Vec<String> = cameras.iter().map(|(id, _)| id.clone()).collect();
    let mut tracker = Tracker::new(cameras);
    let mut moment: Vec<Detection> = Vec::new();
    let mut rows = reader.deserialize::<(f64, String, f64, f64)>();
    loop {
        let row = rows.next().transpose().map_err(|error| format!("{detections}: {error}"))?;
        let next = row.map(|(at_s, camera, u, v)| Detection { at_s, camera, pixel: Pixel { u, v } });
        let ends = next.as_ref().map(|d| d.at_s) != moment.first().map(|d| d.at_s);
        if let Some(at_s) = moment.first().map(|d| d.at_s).filter(|_| ends) {
            tracker.step(at_s, &moment)?;
            moment.clear();
            for track in tracker.tracks() {
                let sigma = |k: usize| track.covariance[(k, k)].sqrt();
                let numbers = [track.state.x, track.state.y, sigma(0), sigma(1)].map(|x| format!("{x:.4}"));
                let [x, y, sigma_x, sigma_y] = numbers;
                let (at_s, id) = (at_s.to_string(), track.id.to_string());
                writer.write_record([&at_s, &id, &x, &y, &sigma_x, &sigma_y, &names[track.seen_by]])?;
            }
        }
        let Some(next) = next else { break };
        moment.push(next);
    }
    writer.flush()?;
    Ok(())
}
