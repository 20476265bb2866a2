//! The tracker of the examples, tested with people walking through the demonstration site.

#[expect(dead_code, reason = "the example's own main and reading of files run as a program below")]
#[path = "../crates/calib-site/examples/fuse_tracks.rs"]
mod fuse_tracks;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::process::Command;

use calib_core::{Camera, Covariance, Distortion};

use calib_demo::random::normal;
use calib_demo::{DemoSite, FootDetection, Walk, demo_site, walk};
use calib_site::Options;
use calib_tests::{Scratch, root};
use fuse_tracks::{Detection, Track, Tracker};
use nalgebra::{Matrix2, SMatrix, Vector2};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// Returns the shop's cameras, calibrated from their annotations, and their image sizes.
fn shop() -> (Vec<(String, Camera)>, Vec<[u32; 2]>) {
    let demo = demo_site();
    let solved = demo.site.calibrate(&Options::default()).write_into(&demo.site);
    let shop = solved.cameras.iter().filter(|entry| entry.id.starts_with("shop"));
    shop.map(|entry| ((entry.id.clone(), entry.camera().unwrap()), entry.size_px)).unzip()
}

/// Comparison of the tracks with the people.
#[derive(Default)]
struct Followed {
    squares: f64,
    nees: f64,
    count: usize,
    /// Tracks of every person in order of time, with the cameras that saw the person.
    tracks: BTreeMap<usize, Vec<(u32, BTreeSet<usize>)>>,
    /// Tracks that were never assigned to a person.
    strangers: BTreeSet<u32>,
}

/// Largest distance between a person and an assigned track, in metres.
const NEAR: f64 = 1.0;

/// Tracks people with the estimated cameras, from detections of the true cameras.
///
/// A person keeps the track of the moment before as long as it is near. Otherwise it gets the nearest free
/// track (CLEAR MOT, Bernardin and Stiefelhagen 2008).
fn follow(calibrated: &[(String, Camera)], walk: &Walk) -> Followed {
    let mut tracker = Tracker::new(calibrated.to_vec());
    let mut followed = Followed::default();
    let mut before: BTreeMap<usize, u32> = BTreeMap::new();
    for (moment, people) in walk.truth.iter().enumerate() {
        let at_s = moment as f64 * Walk::STEP;
        let seen: Vec<_> = walk.detections.iter().filter(|seen| seen.moment == moment).collect();
        let detections: Vec<Detection> = seen
            .iter()
            .map(|s| Detection { at_s, camera: calibrated[s.camera].0.clone(), pixel: s.pixel })
            .collect();
        tracker.step(at_s, &detections).unwrap();
        let mut pairs: Vec<(bool, f64, usize, &Track)> = Vec::new();
        for (person, at) in people.iter().enumerate() {
            for track in tracker.tracks() {
                let distance =
                    at.map_or(f64::INFINITY, |at| (at.x - track.state.x).hypot(at.y - track.state.y));
                if distance < NEAR {
                    pairs.push((before.get(&person) != Some(&track.id), distance, person, track));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let (mut met, mut used) = (BTreeSet::new(), BTreeSet::new());
        for (_, _, person, track) in pairs {
            if met.contains(&person) || used.contains(&track.id) {
                continue;
            }
            met.insert(person);
            used.insert(track.id);
            before.insert(person, track.id);
            // Errors count only while a camera sees the person: not while the track is extrapolated.
            let sees = |s: &&&FootDetection| s.person == Some(person);
            let cameras: BTreeSet<usize> = seen.iter().filter(sees).map(|s| s.camera).collect();
            let Some(truth) = people[person].filter(|_| !cameras.is_empty()) else { continue };
            let error = Vector2::new(truth.x - track.state.x, truth.y - track.state.y);
            let covariance: Matrix2<f64> = track.covariance.fixed_view::<2, 2>(0, 0).into_owned();
            followed.squares += error.norm_squared();
            followed.nees += (error.transpose() * covariance.try_inverse().unwrap() * error).x;
            followed.count += 1;
            let tracks = followed.tracks.entry(person).or_default();
            match tracks.last_mut().filter(|(id, _)| *id == track.id) {
                Some((_, by)) => by.extend(cameras),
                None => tracks.push((track.id, cameras)),
            }
        }
        followed.strangers.extend(tracker.tracks().map(|track| track.id));
    }
    for (id, _) in followed.tracks.values().flatten() {
        followed.strangers.remove(id);
    }
    followed
}

/// Returns the true cameras of the shop with their image sizes.
fn true_shop(demo: &DemoSite, sizes: Vec<[u32; 2]>) -> Vec<(Camera, [u32; 2])> {
    let shop = demo.truth.iter().filter(|(id, _)| id.starts_with("shop"));
    shop.map(|(_, camera)| *camera).zip(sizes).collect()
}

#[test]
fn people_keep_their_track_from_camera_to_camera() {
    let (calibrated, sizes) = shop();
    let truth = true_shop(&demo_site(), sizes);
    for seed in 0..5 {
        let walk = walk(&truth, seed);
        let followed = follow(&calibrated, &walk);
        let rmse = (followed.squares / followed.count as f64).sqrt();
        println!(
            "seed {seed}: {:.3} m rms, NEES {:.2}, {} points, {} strangers, tracks {:?}",
            rmse,
            followed.nees / followed.count as f64,
            followed.count,
            followed.strangers.len(),
            followed.tracks,
        );
        assert_eq!(followed.tracks.len(), 5);
        for tracks in followed.tracks.values() {
            assert_eq!(tracks.len(), 1, "one person, one track: {tracks:?}");
            assert!(tracks[0].1.len() >= 2, "seen by several cameras: {tracks:?}");
        }
        assert!(followed.strangers.is_empty(), "{:?}", followed.strangers);
        assert!(rmse < 0.1, "{rmse}");
    }
}

/// Draws a camera from the distribution given by its covariance.
fn drawn_from_covariance(camera: &Camera, random: &mut ChaCha8Rng) -> Camera {
    let covariance = SMatrix::<f64, { Covariance::SIZE }, { Covariance::SIZE }>::from(camera.covariance.0);
    let eigen = covariance.symmetric_eigen();
    let draws = eigen.eigenvalues.map(|value| value.max(0.0).sqrt() * normal(random));
    let by = eigen.eigenvectors * draws;
    let mut drawn = *camera;
    drawn.position.x += by[Covariance::X];
    drawn.position.y += by[Covariance::Y];
    drawn.position.z += by[Covariance::Z];
    drawn.yaw += by[Covariance::YAW];
    drawn.pitch += by[Covariance::PITCH];
    drawn.roll += by[Covariance::ROLL];
    drawn.focal += by[Covariance::FOCAL];
    if let Distortion::BrownConrady(brown) = &mut drawn.lens.distortion {
        brown.k1 += by[Covariance::LENS];
        brown.k2 += by[Covariance::LENS + 1];
    }
    drawn.lens.principal_point.u += by[Covariance::CENTRE];
    drawn.lens.principal_point.v += by[Covariance::CENTRE + 1];
    drawn
}

#[test]
fn track_covariance_matches_its_error() {
    let (calibrated, sizes) = shop();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let (mut nees, mut rmse) = (Vec::new(), Vec::new());
    for seed in 0..40 {
        let truth: Vec<(Camera, [u32; 2])> = calibrated
            .iter()
            .zip(&sizes)
            .map(|((_, camera), size)| (drawn_from_covariance(camera, &mut random), *size))
            .collect();
        let followed = follow(&calibrated, &walk(&truth, 100 + seed));
        nees.push(followed.nees / followed.count as f64);
        rmse.push((followed.squares / followed.count as f64).sqrt());
    }
    // All moments of a run share one calibration, so only the mean over many runs approaches 2. People do not
    // move exactly like the filter's model, hence the tolerance.
    let mean = nees.iter().sum::<f64>() / nees.len() as f64;
    println!("NEES {mean:.2} of 2, {:.3} m rms", rmse.iter().sum::<f64>() / rmse.len() as f64);
    assert!((1.7..2.3).contains(&mean), "{mean}");
}

#[test]
fn program_reads_detections_and_writes_tracks() {
    let (_, sizes) = shop();
    let demo = demo_site();
    let walk = walk(&true_shop(&demo, sizes), 0);
    let scratch = Scratch::new();
    scratch.write("site.json", demo.site.to_json());
    let mut rows = String::from("at_s,camera,u,v\n");
    for seen in &walk.detections {
        let (at_s, id) = (seen.moment as f64 * Walk::STEP, &demo.truth[seen.camera].0);
        writeln!(rows, "{at_s},{id},{},{}", seen.pixel.u, seen.pixel.v).unwrap();
    }
    scratch.write("detections.csv", rows);
    let run = |detections: &str| {
        let mut command = Command::new(env!("CARGO"));
        command.args(["run", "--quiet", "--package", "calib-site", "--example", "fuse_tracks", "--"]);
        let paths = ["site.json", detections, "tracks.csv"].map(|name| scratch.path(name));
        command.args(paths).current_dir(root()).output().unwrap()
    };
    let ended = run("detections.csv");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let mut tracks = csv::Reader::from_path(scratch.path("tracks.csv")).unwrap();
    let rows: Vec<(f64, u32, f64, f64, f64, f64, String)> =
        tracks.deserialize().collect::<Result<_, _>>().unwrap();
    let ids: BTreeSet<u32> = rows.iter().map(|row| row.1).collect();
    assert_eq!(ids.len(), walk.truth[0].len(), "one track a person");
    scratch.write("unknown.csv", "at_s,camera,u,v\n0.0,garden,10,10\n");
    let ended = run("unknown.csv");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(!ended.status.success() && said.contains("garden"), "{said}");
}
