//! `calib watch`: detects cameras that moved from the people in view, without false alarms for the others.

use std::fmt::Write as _;

use calib_core::Camera;

use calib_core::camera::PanTiltZoom;

use calib_health::{CameraHealth, DriftStatus, Sighting, Watch};

use calib_demo::{Crowd, PoseChange, SECOND, demo_site};
use calib_site::{Method, Site, Solution, Stage};
use calib_tests::Scratch;

const DAY: i64 = 86_400 * SECOND;
/// Time 2026-05-01T00:00:00Z, in nanoseconds since 1970.
const MAY: i64 = 1_777_593_600 * SECOND;

/// Returns the true cameras of the demonstration: three share the view of the shop, two are alone.
fn cameras() -> Vec<(Camera, [u32; 2])> {
    let demo = demo_site();
    demo.truth.iter().zip(&demo.site.cameras).map(|((_, camera), entry)| (*camera, entry.size_px)).collect()
}

fn watched(cameras: &[(Camera, [u32; 2])], seen: &[Sighting]) -> Vec<CameraHealth> {
    let cameras: Vec<(Camera, [f64; 2])> =
        cameras.iter().map(|(camera, size)| (*camera, size.map(f64::from))).collect();
    let mut watch = Watch::new(&cameras);
    seen.iter().for_each(|sighting| watch.add_sighting(sighting));
    watch.health()
}

fn degrees(pan: f64, tilt: f64, roll: f64) -> PanTiltZoom {
    let [pan, tilt, roll] = [pan, tilt, roll].map(f64::to_radians);
    PanTiltZoom { pan, tilt, roll, zoom: 0.0 }
}

fn zoomed() -> PanTiltZoom {
    PanTiltZoom { zoom: 1.03_f64.ln(), ..PanTiltZoom::default() }
}

/// Returns two weeks of detections in which one camera moves in the last quarter. About `after` people pass
/// each camera after that time.
fn archive(camera: usize, by: PanTiltZoom, after: usize) -> (Crowd, i64) {
    let span = [MAY, MAY + 14 * DAY];
    let share = 0.25;
    let at = MAY + (14.0 * DAY as f64 * (1.0 - share)) as i64;
    let people = (6.0 * after as f64 / share) as usize;
    (Crowd { change: Some(PoseChange { camera, at, by }), season: 0.01, ..Crowd::new(people, span) }, at)
}

fn clearest(health: &CameraHealth) -> f64 {
    health.statistics.iter().map(|(_, clear)| *clear).fold(0.0, f64::max)
}

#[test]
fn rotation_of_one_degree_and_zoom_of_three_percent_are_dated() {
    let cameras = cameras();
    let cases = [
        (0, degrees(0.0, 1.0, 0.0)),
        (0, degrees(1.0, 0.0, 0.0)),
        (0, degrees(0.0, 0.0, 1.0)),
        (1, degrees(0.0, 0.0, -1.0)),
        (2, zoomed()),
        // For a camera without overlap, no other camera locates the people: the detectable change is twice as
        // large.
        (3, degrees(0.0, 2.0, 0.0)),
        (4, degrees(0.0, -2.0, 0.0)),
    ];
    let mut missed = Vec::new();
    for (camera, by) in cases {
        let (crowd, at) = archive(camera, by, 300);
        let health = watched(&cameras, &crowd.sightings(&cameras, 7));
        for (index, of) in health.iter().enumerate() {
            let date = of.change.map(|change| (change.since - at) as f64 / DAY as f64);
            println!(
                "{camera} {by:.3?}: {index} {} {:.1} {} tracks, {date:?} days off, {:.2?}",
                of.status.name(),
                clearest(of),
                of.tracks,
                of.change.map(|change| change.movement)
            );
            let is_right = match of.change {
                Some(change) => index == camera && (change.since - at).abs() < 14 * DAY / 10,
                None => index != camera,
            };
            if !is_right {
                missed.push((camera, by, index));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// Returns the number in an environment variable, or `default`.
fn number_from_env(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Counts over the archives of one kind of change: changes found, changes dated to a tenth of the window, and other
/// cameras accused.
#[derive(Default)]
struct Found {
    trials: usize,
    found: usize,
    dated: usize,
    accused: usize,
    off: Vec<f64>,
}

impl Found {
    fn add(&mut self, camera: usize, at: i64, health: &[CameraHealth]) {
        self.trials += 1;
        self.accused +=
            health.iter().enumerate().filter(|(i, of)| *i != camera && of.change.is_some()).count();
        let Some(change) = health[camera].change else { return };
        let off = (change.since - at).abs() as f64 / (14 * DAY) as f64;
        self.found += 1;
        self.dated += usize::from(off < 0.1);
        self.off.push(off);
    }

    fn text(&self, name: &str) -> String {
        let mut off = self.off.clone();
        off.sort_by(f64::total_cmp);
        let median = off.get(off.len() / 2).map_or(f64::NAN, |off| 100.0 * off);
        let Self { trials, found, dated, accused, .. } = self;
        format!("| {name} | {trials} | {found} | {dated} | {median:.1} % | {accused} |")
    }
}

#[test]
#[ignore = "takes minutes: `cargo xtask accuracy --watch`"]
fn table_of_moved_cameras() {
    let (cameras, trials) = (cameras(), number_from_env("CALIB_WATCH_TRIALS", 4));
    let zoomed = |share: f64| PanTiltZoom { zoom: (1.0 + share).ln(), ..PanTiltZoom::default() };
    let moved = [
        ("pan 1 deg", degrees(1.0, 0.0, 0.0), degrees(-1.0, 0.0, 0.0)),
        ("tilt 1 deg", degrees(0.0, 1.0, 0.0), degrees(0.0, -1.0, 0.0)),
        ("roll 1 deg", degrees(0.0, 0.0, 1.0), degrees(0.0, 0.0, -1.0)),
        ("zoom 3 %", zoomed(0.03), zoomed(-0.03)),
    ];
    println!(
        "| change, 300 tracks after | trials | found | dated to a tenth | median time error | others accused |"
    );
    println!("|---|---|---|---|---|---|");
    for (name, one, other) in moved {
        // A camera alone has no reference for the positions of the people.
        for (which, range) in [("seen by others", 0..3), ("alone", 3..5)] {
            let mut row = Found::default();
            for (camera, seed) in range.flat_map(|camera| (0..trials).map(move |seed| (camera, seed))) {
                let by = if seed % 2 == 0 { one } else { other };
                let (crowd, at) = archive(camera, by, 300);
                let seed = 5000 + 100 * camera as u64 + seed;
                let health = watched(&cameras, &crowd.sightings(&cameras, seed));
                if std::env::var_os("CALIB_WATCH_VERBOSE").is_some() {
                    let of = &health[camera];
                    println!(
                        "{camera} {name}: z-score {:.1}, smallest detectable {:.4?}",
                        clearest(of),
                        of.smallest_detectable
                    );
                }
                row.add(camera, at, &health);
            }
            println!("{}", row.text(&format!("{name}, {which}")));
        }
    }
}

#[test]
#[ignore = "measures time: `cargo xtask accuracy --watch`"]
fn table_of_rows_per_second() {
    let cameras = cameras();
    let crowd = Crowd { has_scene: false, ..Crowd::new(6000, [MAY, MAY + DAY]) };
    let seen = crowd.sightings(&cameras, 9);
    let cameras: Vec<(Camera, [f64; 2])> =
        cameras.iter().map(|(camera, size)| (*camera, size.map(f64::from))).collect();
    let mut watch = Watch::new(&cameras);
    let start = std::time::Instant::now();
    seen.iter().for_each(|sighting| watch.add_sighting(sighting));
    let rate = seen.len() as f64 / start.elapsed().as_secs_f64();
    let start = std::time::Instant::now();
    let health = watch.health();
    println!("| rows | cameras | rows per second on one thread | seconds of evaluation |\n|---|---|---|---|");
    println!("| {} | {} | {rate:.0} | {:.2} |", seen.len(), health.len(), start.elapsed().as_secs_f64());
}

/// Returns the largest change statistic of every camera and day without a camera change, largest first.
fn quiet_days(seeds: std::ops::Range<u64>) -> Vec<(f64, usize)> {
    let cameras = cameras();
    let mut all = Vec::new();
    for seed in seeds {
        let crowd = Crowd { season: 0.003, ..Crowd::new(1500, [MAY, MAY + DAY]) };
        let health = watched(&cameras, &crowd.sightings(&cameras, 1000 + seed));
        all.extend(health.iter().enumerate().map(|(index, of)| (clearest(of), index)));
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("{:.2?} of {}, median {:.2}", &all[..20.min(all.len())], all.len(), all[all.len() / 2].0);
    all
}

#[test]
fn unchanged_cameras_cause_no_alarm() {
    let days = quiet_days(0..40);
    assert!(days[0].0 < Watch::ALARM, "{:?}", days[0]);
}

#[test]
#[ignore = "takes minutes: 6,000 days of cameras"]
fn false_alarms_are_at_most_one_in_a_thousand_camera_days() {
    let days = quiet_days(0..number_from_env("CALIB_WATCH_DAYS", 1000));
    let alarms = days.iter().filter(|(clear, _)| *clear > Watch::ALARM).count();
    assert!(alarms * 1000 <= days.len(), "{alarms} of {}", days.len());
}

#[test]
fn too_few_people_give_no_status() {
    let cameras = cameras();
    let crowd = Crowd::new(60, [MAY, MAY + DAY]);
    let health = watched(&cameras, &crowd.sightings(&cameras, 3));
    assert!(health.iter().all(|of| of.status == DriftStatus::CannotTell), "{health:?}");
}

/// Returns the demonstration with its true cameras.
fn site() -> Site {
    let demo = demo_site();
    let mut site = demo.site;
    for (entry, (_, camera)) in site.cameras.iter_mut().zip(&demo.truth) {
        entry.solution = Some(Solution::from_camera(camera, Method::Given, Stage::Placed));
    }
    site
}

fn csv(site: &Site, seen: &[Sighting]) -> String {
    let mut rows = String::from("camera,at_ns,x,y,w,h\n");
    for one in seen {
        let head = one.head.unwrap();
        let (x, y, h) = (head.u - 0.5 * one.width, head.v, one.foot.v - head.v);
        writeln!(rows, "{},{},{x},{y},{},{h}", site.cameras[one.camera].id, one.at, one.width).unwrap();
    }
    rows
}

#[test]
fn program_dates_the_change_and_continues_from_its_state() {
    let (site, cameras) = (site(), cameras());
    let (crowd, at) = archive(0, degrees(0.0, 1.0, 0.0), 150);
    let seen = crowd.sightings(&cameras, 7);
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    scratch.write("all.csv", csv(&site, &seen));
    let asked = ["watch", "site.json", "-i", "all.csv", "--format", "json"];
    let whole = scratch.calib(&[&asked[..], &["-o", "watch.html"]].concat()).expect_code(4);
    let found = &whole.json()["cameras"][0];
    assert_eq!((found["id"].as_str(), found["verdict"].as_str()), (Some("shop-1"), Some("moved")));
    let nanoseconds = |name: &str| {
        let time: String = found[name].as_str().unwrap().into();
        assert!(time.ends_with('Z') && time.starts_with("2026-05-1"), "{time}");
        time
    };
    assert!(
        nanoseconds("since_low") <= nanoseconds("since") && nanoseconds("since") <= nanoseconds("since_high")
    );
    assert!(found["tracks"].as_u64().unwrap() > 300);
    let page = std::fs::read_to_string(scratch.path("watch.html")).unwrap();
    assert!(page.contains("shop-1") && page.contains("moved at") && !page.contains("<script"));

    // Read in two parts with a state between them; the first part is read twice.
    let middle = seen.len() / 2;
    scratch.write("part.csv", csv(&site, &seen[..middle]));
    let in_part = ["watch", "site.json", "-i", "part.csv", "--format", "json", "--state", "state.json"];
    let first = scratch.calib(&in_part).expect_code(0).json();
    assert_eq!(first["cameras"][0]["verdict"], "unchanged", "{first}");
    assert_eq!(
        scratch.calib(&in_part).expect_code(0).json(),
        first,
        "rows that were read are not read again"
    );
    // The file has grown.
    scratch.write("part.csv", csv(&site, &seen));
    assert_eq!(scratch.calib(&in_part).expect_code(4).json(), whole.json(), "the same result as in one run");

    let before: Vec<Sighting> = seen.iter().filter(|one| one.at < at).copied().collect();
    scratch.write("before.csv", csv(&site, &before));
    let still = scratch.calib(&["watch", "site.json", "-i", "before.csv"]).expect_code(0);
    assert!(
        still.stdout.contains("shop-1: unchanged") && !still.stdout.contains("moved"),
        "{}",
        still.stdout
    );

    scratch.write("other.json", site.to_json().replace("\"Farm shop and barn\"", "\"Another\""));
    let refused =
        scratch.calib(&["watch", "other.json", "-i", "part.csv", "--state", "state.json"]).expect_code(3);
    assert!(refused.stderr.contains("state.json") && refused.stderr.contains("another calibration"));
}

#[test]
fn table_without_times_or_cameras_is_refused_with_advice() {
    let scratch = Scratch::new();
    scratch.write("site.json", site().to_json());
    scratch.write("no_time.csv", "camera,x,y,w,h\nshop-1,1,2,3,4\n");
    let ended = scratch.calib(&["watch", "site.json", "-i", "no_time.csv"]).expect_code(3);
    assert!(ended.stderr.contains("no_time.csv") && ended.stderr.contains("--at-column"), "{}", ended.stderr);
    scratch.write("no_camera.csv", "at_s,x,y,w,h\n1,1,2,3,4\n");
    let ended = scratch.calib(&["watch", "site.json", "-i", "no_camera.csv"]).expect_code(3);
    assert!(ended.stderr.contains("--camera-column"), "{}", ended.stderr);
}
