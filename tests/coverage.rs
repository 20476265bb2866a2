//! `calib coverage` on the demonstration, compared with projected sticks and sampled lines of sight.

use calib_core::camera::{Camera, FloorPoint, WorldPoint};
use calib_core::floor::{Extent, Wall};
use calib_site::{Area, Site, SiteCamera, SiteSolution, Stage, WallEntry};
use calib_tests::{Scratch, above, entry};
use serde_json::Value;

/// Height of the targets, in metres.
const HEIGHT: f64 = 1.6;

/// Returns the solved demonstration with a wall and two areas.
fn demonstration(scratch: &Scratch) -> Site {
    scratch.calib(&["demo", "demo"]).expect_code(0);
    let mut site = Site::from_json(&scratch.read_json("demo/solved.json").to_string()).unwrap();
    let at = |x: f64, y: f64| FloorPoint { x, y };
    site.walls = vec![
        WallEntry { from_m: at(5.0, 5.0), to_m: at(9.0, 5.0), height_m: Some(1.8) },
        WallEntry { from_m: at(12.0, 2.0), to_m: at(12.5, 7.0), height_m: None },
    ];
    let area = |id: &str, [left, bottom, right, top]: [f64; 4]| Area {
        id: id.into(),
        name: None,
        polygon_m: vec![at(left, bottom), at(right, bottom), at(right, top), at(left, top)],
        level: None,
    };
    site.areas = vec![area("wall", [5.0, 4.0, 9.0, 7.0]), area("outside", [100.0, 100.0, 101.0, 101.0])];
    scratch.write("demo/survey.json", site.to_json());
    site
}

/// Camera of the site with the parts that visibility depends on.
struct Seeing {
    id: String,
    camera: Camera,
    size: [f64; 2],
    efov: Vec<FloorPoint>,
}

fn all_seeing(site: &Site) -> Vec<Seeing> {
    let of = |entry: &SiteCamera| Seeing {
        id: entry.id.clone(),
        camera: entry.camera().unwrap(),
        size: entry.size(),
        efov: site.efov_on_floor(entry),
    };
    site.cameras.iter().map(of).collect()
}

impl Seeing {
    /// Returns the smallest image scale of a stick of 1 cm, in pixels per metre, over all directions across the view.
    /// The centre of the stick is `HEIGHT` above `foot`; `None` if the camera does not see it.
    fn density(&self, foot: FloorPoint, walls: &[Wall]) -> Option<f64> {
        const STICK: f64 = 0.01;
        let extent = Extent { size: self.size, efov: &self.efov };
        let target = foot.at_height(HEIGHT);
        let pixel = self.camera.world_to_pixel(target)?;
        if !extent.contains(foot) || !extent.shows(pixel) || self.is_hidden(target, walls) {
            return None;
        }
        let sight = [foot.x - self.camera.position.x, foot.y - self.camera.position.y];
        let level = sight[0].hypot(sight[1]);
        let end = |share: f64, across: f64, up: f64| {
            let (x, y) = (-sight[1] / level * across * share, sight[0] / level * across * share);
            self.camera.world_to_pixel(WorldPoint::new(foot.x + x, foot.y + y, HEIGHT + up * share))
        };
        let lengths = (0..180).filter_map(|degree| {
            let (up, across) = f64::from(degree).to_radians().sin_cos();
            Some(end(0.5 * STICK, across, up)?.distance(end(-0.5 * STICK, across, up)?) / STICK)
        });
        lengths.reduce(f64::min)
    }

    /// Whether a wall hides the target. The line of sight is sampled every few millimetres, and tested for samples on
    /// different sides of the wall.
    fn is_hidden(&self, target: WorldPoint, walls: &[Wall]) -> bool {
        const SAMPLES: usize = 4000;
        let eye = self.camera.position;
        let at = |index: usize| {
            let share = index as f64 / SAMPLES as f64;
            let along = |from: f64, to: f64| from + share * (to - from);
            [along(eye.x, target.x), along(eye.y, target.y), along(eye.z, target.z)]
        };
        walls.iter().any(|wall| {
            let [ax, ay] = [wall.to.x - wall.from.x, wall.to.y - wall.from.y];
            let length = ax.hypot(ay);
            let beside = |[x, y, _]: [f64; 3]| (ax * (y - wall.from.y) - ay * (x - wall.from.x)) / length;
            let along = |[x, y, _]: [f64; 3]| (ax * (x - wall.from.x) + ay * (y - wall.from.y)) / length;
            (0..SAMPLES).any(|index| {
                let (a, b) = (at(index), at(index + 1));
                beside(a) * beside(b) < 0.0 && (0.0..=length).contains(&along(a)) && a[2] < wall.height
            })
        })
    }
}

#[test]
fn coverage_agrees_with_brute_force() {
    let scratch = Scratch::new();
    let site = demonstration(&scratch);
    let height = HEIGHT.to_string();
    let table = ["coverage", "demo/survey.json", "--height-m", &height, "--step-m", "0.2", "-o", "table.csv"];
    // One area is outside all fields of view and misses its level.
    let report = scratch.calib(&table).expect_code(4).json();
    let walls: Vec<Wall> = site.walls.iter().map(Wall::from).collect();
    let cameras = all_seeing(&site);
    let text = std::fs::read_to_string(scratch.path("table.csv")).unwrap();
    let mut rows = text.lines();
    assert_eq!(rows.next(), Some("x_m,y_m,height_m,px_per_m,best,seen_by"));
    let (mut checked, mut differ, mut seen) = (0, 0, 0);
    for row in rows {
        let cells: Vec<&str> = row.split(',').collect();
        let number = |index: usize| cells[index].parse::<f64>().unwrap();
        let foot = FloorPoint { x: number(0), y: number(1) };
        let found: Vec<(&str, f64)> = cameras
            .iter()
            .filter_map(|camera| Some((camera.id.as_str(), camera.density(foot, &walls)?)))
            .collect();
        checked += 1;
        if found.len() != number(5) as usize {
            differ += 1;
            continue;
        }
        let best = found.iter().map(|(_, density)| *density).fold(0.0, f64::max);
        seen += usize::from(best > 0.0);
        assert!((best - number(3)).abs() <= 0.01 * best, "{row}: {best}");
        assert!(best == 0.0 || found.iter().any(|(id, density)| *id == cells[4] && *density > 0.99 * best));
    }
    println!("{checked} points, {seen} visible, {differ} with another number of cameras");
    assert!(seen > 2000 && differ * 100 < checked, "{differ} of {checked}");
    let area =
        |id: &str| report["areas"].as_array().unwrap().iter().find(|area| area["id"] == id).unwrap().clone();
    // The centres of 10,000 cells of the area.
    let cells = (0..100).flat_map(|i| (0..100).map(move |k| (f64::from(i), f64::from(k))));
    let blind = cells
        .map(|(i, k)| FloorPoint { x: 5.0 + 0.04 * (i + 0.5), y: 4.0 + 0.03 * (k + 0.5) })
        .filter(|&foot| cameras.iter().all(|camera| camera.density(foot, &walls).is_none()))
        .count();
    let (share, reported) = (blind as f64 / 10_000.0, area("wall")["blind_share"].as_f64().unwrap());
    assert!(share > 0.02 && (share - reported).abs() < 0.01, "{share} {reported}");
    assert_eq!(
        (area("outside")["share"].as_f64(), &area("outside")["worst_px_per_m"]),
        (Some(0.0), &Value::Null)
    );
}

#[test]
fn files_are_written_and_levels_decide_the_exit_code() {
    let scratch = Scratch::new();
    let camera = above(0.0);
    let polygon_m = [[-1.0, 6.0], [1.0, 6.0], [1.0, 9.0], [-1.0, 9.0]].map(FloorPoint::from).to_vec();
    let area = Area { id: "door".into(), name: Some("Door".into()), polygon_m, level: None };
    let site = Site { cameras: vec![entry("a", &camera)], areas: vec![area], ..Site::new() };
    scratch.write("survey.json", site.to_json());
    for (level, code) in [("monitor", 0), ("identify", 4)] {
        let run = scratch.calib(&["coverage", "survey.json", "--level", level]).expect_code(code);
        let area = &run.json()["areas"][0];
        assert_eq!((area["level"].as_str(), area["met"].as_bool()), (Some(level), Some(code == 0)), "{area}");
        assert_eq!(area["blind_share"], 0.0);
    }
    for name in ["plan.png", "page.html", "zones.geojson"] {
        scratch.calib(&["coverage", "survey.json", "-o", name]).expect_code(0);
    }
    let page = std::fs::read_to_string(scratch.path("page.html")).unwrap();
    assert!(page.contains("<h2>Coverage</h2>") && page.contains("100.0 %"));
    let zones = scratch.read_json("zones.geojson");
    let kinds: Vec<_> =
        zones["features"].as_array().unwrap().iter().map(|f| f["properties"]["kind"].clone()).collect();
    assert!(kinds.contains(&"visible".into()) && kinds.contains(&"area".into()));
    scratch.calib(&["coverage", "survey.json", "-o", "plan.bmp"]).expect_code(2);
    scratch.calib(&["coverage", "survey.json", "-o", "zones.json"]).expect_code(2);
    scratch.calib(&["coverage", "survey.json", "-o", "plan.png"]).expect_code(1);
    scratch.calib(&["coverage", "survey.json", "--step-m", "0.001"]).expect_code(2);
    scratch.calib(&["coverage", "survey.json", "--level", "read"]).expect_code(2);
}

#[test]
fn periods_and_groups_of_cameras_are_not_mixed() {
    let scratch = Scratch::new();
    let period = |from: Option<&str>, to: Option<&str>| SiteCamera {
        valid_from: from.map(str::to_owned),
        valid_to: to.map(str::to_owned),
        ..entry("a", &above(0.0))
    };
    let change = Some("2026-05-01T00:00:00Z");
    let site = Site { cameras: vec![period(None, change), period(change, None)], ..Site::new() };
    scratch.write("periods.json", site.to_json());
    let refused = scratch.calib(&["coverage", "periods.json"]).expect_code(2);
    assert!(refused.stderr.contains("--at"), "{}", refused.stderr);
    let coverage = ["coverage", "periods.json", "--at", "2026-06-01T00:00:00Z", "-o", "periods.csv"];
    scratch.calib(&coverage).expect_code(0);
    let table = std::fs::read_to_string(scratch.path("periods.csv")).unwrap();
    assert!(table.lines().skip(1).all(|row| !row.ends_with(",2")), "one camera is counted twice");
    // Two pairs without common coordinates.
    let refined = |id: &str, x: f64| {
        let mut camera = entry(id, &above(x));
        camera.solution.as_mut().unwrap().stage = Stage::Refined;
        camera
    };
    let cameras =
        vec![refined("a", 0.0), refined("b", 2.0), refined("c", 0.0), refined("d", 2.0), refined("e", 9.0)];
    let groups =
        [["a", "b"].as_slice(), &["c", "d", "e"]].map(|ids| ids.iter().map(|id| (*id).to_owned()).collect());
    let solution = SiteSolution { components: groups.to_vec(), ..SiteSolution::default() };
    let mut site = Site { cameras, solution: Some(solution), ..Site::new() };
    scratch.write("groups.json", site.to_json());
    let found = scratch.calib(&["coverage", "groups.json"]).expect_code(0).json();
    assert_eq!(found["left_out"], serde_json::json!(["a", "b"]), "{found}");
    scratch.calib(&["coverage", "groups.json", "-o", "groups.html"]).expect_code(0);
    let page = std::fs::read_to_string(scratch.path("groups.html")).unwrap();
    assert!(
        page.contains("Cameras without a position relative to the others are left out: a, b")
            && page.contains("a, b"),
        "the page does not name the cameras left out"
    );
    let measure = [
        "measure",
        "groups.json",
        "--camera",
        "a",
        "--from",
        "900,700",
        "--to",
        "900,700",
        "--to-camera",
        "c",
    ];
    let refused = scratch.calib(&measure).expect_code(4);
    assert!(refused.stderr.contains("no common coordinate system"), "{}", refused.stderr);
    // A placement on the plan gives the first group the coordinates of the site.
    site.cameras[0].placement = Some(serde_json::from_str("{}").unwrap());
    scratch.write("groups.json", site.to_json());
    let found = scratch.calib(&["coverage", "groups.json"]).expect_code(0).json();
    assert_eq!(found["left_out"], serde_json::json!(["c", "d", "e"]), "{found}");
}

#[test]
fn hand_over_zones_state_how_far_two_cameras_disagree() {
    let scratch = Scratch::new();
    let site = demonstration(&scratch);
    let report = scratch.calib(&["coverage", "demo/survey.json", "--format", "json", "--height-m", "1.6"]);
    let report: Value = serde_json::from_str(&report.stdout).unwrap();
    let zones = report["hand_overs"].as_array().unwrap();
    let area = |zone: &Value| zone["area_m2"].as_f64().unwrap();
    assert!(zones.len() >= 3 && zones.windows(2).all(|pair| area(&pair[0]) >= area(&pair[1])));
    let camera = |id: &Value| site.cameras.iter().find(|entry| id == &entry.id).unwrap().camera().unwrap();
    let known: Vec<&Value> = zones.iter().filter(|zone| zone["disagreement_m"].is_f64()).collect();
    assert!(known.len() >= 3, "{zones:?}");
    for zone in &known {
        let [rms, worst] = ["disagreement_m", "worst_disagreement_m"].map(|key| zone[key].as_f64().unwrap());
        assert!(0.0 < rms && rms <= worst, "{zone}");
        let at = zone["worst_m"].as_array().unwrap();
        let target = WorldPoint::new(at[0].as_f64().unwrap(), at[1].as_f64().unwrap(), 1.6);
        // The errors of both cameras bound the error of their difference.
        let sigmas = [0, 1].map(|k| {
            let camera = camera(&zone["cameras"][k]);
            let pixel = camera.world_to_pixel(target).unwrap();
            let on_plane = camera.plane_covariance(pixel, 0.0, 1.6).unwrap().calibration.unwrap();
            (on_plane[0][0] + on_plane[1][1]).sqrt()
        });
        let [least, most] = [(sigmas[0] - sigmas[1]).abs(), sigmas[0] + sigmas[1]];
        assert!((least..=most * (1.0 + 1e-6)).contains(&worst), "{zone}: {sigmas:?}");
    }
    // Cameras of one joint solution have common errors, which cancel. Without the joint solution, the common errors
    // are unknown.
    let mut stale = site.clone();
    stale.solution = None;
    scratch.write("demo/stale.json", stale.to_json());
    let report = scratch.calib(&["coverage", "demo/stale.json", "--format", "json", "--height-m", "1.6"]);
    let report: Value = serde_json::from_str(&report.stdout).unwrap();
    let pair = |zones: &Value| {
        let of_pair = |zone: &&Value| zone["cameras"] == serde_json::json!(["shop-1", "shop-3"]);
        zones.as_array().unwrap().iter().find(of_pair).unwrap().clone()
    };
    let unknown = pair(&report["hand_overs"]);
    assert!(unknown["disagreement_m"].is_null(), "{unknown}");
    assert!(unknown["unknown"].as_str().unwrap().contains("does not contain the correlation"), "{unknown}");
    // A camera whose errors are unknown.
    let mut by_hand = site;
    let shop = by_hand.cameras.iter_mut().find(|entry| entry.id == "shop-1").unwrap();
    let solution = shop.solution.as_mut().unwrap();
    (solution.covariance, solution.sigma) = (None, None);
    scratch.write("demo/unknown.json", by_hand.to_json());
    let report = scratch.calib(&["coverage", "demo/unknown.json", "--format", "text"]).stdout;
    let line = report.lines().find(|line| line.starts_with("hand-over") && line.contains("shop-1")).unwrap();
    assert!(line.contains("unknown, because \"shop-1\""), "{line}");
}

#[test]
fn a_site_can_change_the_limits_of_the_levels() {
    let scratch = Scratch::new();
    let mut site = demonstration(&scratch);
    let area_of = |path: &str, level: &str| {
        let output = scratch.calib(&["coverage", path, "-o", "map.geojson", "--force", "--format", "json"]);
        let report: Value = serde_json::from_str(&output.stdout).unwrap();
        let map = scratch.read_json("map.geojson");
        let of_level = |feature: &&Value| feature["properties"]["level"] == level;
        let count = map["features"].as_array().unwrap().iter().filter(of_level).count();
        (report["level_px_per_m"][level].as_f64().unwrap(), count)
    };
    let (usual, before) = area_of("demo/survey.json", "identify");
    assert_eq!((usual, before), (250.0, 0));
    site.level_px_per_m = Some(calib_site::LevelLimitsEntry { identify: Some(150.0), ..Default::default() });
    scratch.write("demo/own.json", site.to_json());
    let (own, after) = area_of("demo/own.json", "identify");
    assert!(own == 150.0 && after > 0, "{after} rectangles");
    let mut json = scratch.read_json("demo/own.json");
    json["level_px_per_m"] = serde_json::json!({"recognise": 300.0});
    scratch.write("demo/wrong.json", json.to_string());
    let refused = scratch.calib(&["coverage", "demo/wrong.json"]).expect_code(3);
    let why = &refused.stderr;
    assert!(why.contains("/level_px_per_m/identify") && why.contains("more than 300 px/m"), "{why}");
}
