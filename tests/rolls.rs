//! Cameras with a roll of any size: on the ceiling, on their side, and slightly looking up.

use calib_core::camera::{Camera, Covariance, Pixel, WorldPoint};
use calib_core::outcome::Code;
use calib_core::single::{Annotation, Kind, Known};
use calib_demo::random::{AnnotationSet, RandomScene};
use calib_site::{LensEntry, Options, SceneEntry, Site, SiteCamera, Solution};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

const WIDTH: f64 = 1920.0;
const HEIGHT: f64 = 1080.0;

/// Rotation of the camera about its optical axis, clockwise seen from behind.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Turn {
    None,
    Right,
    Half,
    Left,
}

impl Turn {
    fn degrees(self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Right => 90.0,
            Self::Half => 180.0,
            Self::Left => -90.0,
        }
    }

    /// Returns the size of the image of the rotated camera.
    fn size(self) -> [u32; 2] {
        let [w, h] = [WIDTH as u32, HEIGHT as u32];
        if matches!(self, Self::Right | Self::Left) { [h, w] } else { [w, h] }
    }

    /// Maps a pixel of the camera to the pixel of the rotated camera.
    fn pixel(self, Pixel { u, v }: Pixel) -> Pixel {
        match self {
            Self::None => Pixel { u, v },
            Self::Right => Pixel { u: v, v: WIDTH - u },
            Self::Half => Pixel { u: WIDTH - u, v: HEIGHT - v },
            Self::Left => Pixel { u: HEIGHT - v, v: u },
        }
    }

    fn annotation(self, mut drawn: Annotation) -> Annotation {
        drawn.segments.iter_mut().flatten().flatten().for_each(|pixel| *pixel = self.pixel(*pixel));
        [&mut drawn.foot, &mut drawn.head]
            .into_iter()
            .flatten()
            .for_each(|pixel| *pixel = self.pixel(*pixel));
        drawn
    }
}

/// Returns a person of 1.75 m ahead of a camera at (0, 0) with yaw 0; `None` if the camera does not show it.
fn person(camera: &Camera) -> Option<Annotation> {
    let at = |z: f64| camera.world_to_pixel(WorldPoint::new(0.3, 7.0, z));
    let (foot, head) = (at(0.0)?, at(1.75)?);
    let height_m = Some(Known::prior(1.75, 0.07));
    Some(Annotation { foot: Some(foot), head: Some(head), height_m, ..Annotation::new(Kind::Upright) })
}

/// Returns a site whose camera is rotated by `turn` and has these annotations.
fn turned(turn: Turn, annotations: Vec<Annotation>, lens: LensEntry) -> Site {
    let camera = SiteCamera {
        annotations: annotations.into_iter().map(|drawn| turn.annotation(drawn)).collect(),
        sigma_px: Some(1.0),
        lens: Some(lens),
        ..SiteCamera::new("a", turn.size())
    };
    Site { cameras: vec![camera], scene: Some(SceneEntry::EXACT), ..Site::new() }
}

fn solve(site: &Site) -> Option<Solution> {
    site.calibrate(&Options::default()).cameras.remove(0).1.ok()
}

/// Whether a solution is the true camera: roll, pitch and focal length are within five standard deviations.
fn is_true(solution: &Solution, truth: &Camera, turn: Turn) -> bool {
    let Some(found) = solution.camera() else { return false };
    let is_near = |index: usize, off: f64| {
        found.covariance.sigma(index).is_some_and(|sigma| off.abs() < 5.0 * sigma + 1e-9)
    };
    let roll = (found.roll - truth.roll - turn.degrees().to_radians()).sin().asin();
    let same_side = (found.roll - truth.roll - turn.degrees().to_radians()).cos() > 0.0;
    same_side
        && is_near(Covariance::ROLL, roll)
        && is_near(Covariance::PITCH, found.pitch - truth.pitch)
        && is_near(Covariance::FOCAL, found.focal - truth.focal)
}

#[test]
fn a_person_or_lengths_determine_a_roll_of_any_size() {
    let mut random = ChaCha8Rng::seed_from_u64(41);
    for drawn in [AnnotationSet::Directions, AnnotationSet::Lengths] {
        for turn in [Turn::None, Turn::Right, Turn::Half, Turn::Left] {
            let (mut right, mut wrong, mut all) = (0, 0, 0);
            while all < 40 {
                let scene = RandomScene::new(&mut random, drawn, None, None);
                let mut annotations = scene.noisy(&mut random, 1.0);
                if drawn == AnnotationSet::Directions {
                    let Some(person) = person(&scene.camera) else { continue };
                    annotations.push(person);
                }
                all += 1;
                let Some(solution) = solve(&turned(turn, annotations, LensEntry::default())) else {
                    continue;
                };
                let is_right = is_true(&solution, &scene.camera, turn);
                let is_doubtful = [Code::TwoSolutions, Code::FocalUnobservable, Code::Misfit, Code::Unusable]
                    .into_iter()
                    .any(|code| solution.has_warning(code));
                right += u32::from(is_right);
                wrong += u32::from(!is_right && !is_doubtful);
            }
            println!("{drawn:?} {turn:?}: {right} of {all} right, {wrong} wrong without a finding");
            assert!(right >= 36 && wrong == 0, "{drawn:?} {turn:?}: {right} right, {wrong} wrong");
        }
    }
}

#[test]
fn an_expected_roll_determines_the_side_of_a_camera_with_lines_only() {
    let mut random = ChaCha8Rng::seed_from_u64(42);
    for turn in [Turn::Right, Turn::Half, Turn::Left] {
        let mut right = 0;
        for _ in 0..20 {
            let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
            let roll_deg = Some(Known::prior(turn.degrees(), 5.0));
            let lens = LensEntry { roll_deg, ..LensEntry::default() };
            let found = solve(&turned(turn, scene.noisy(&mut random, 1.0), lens));
            right += u32::from(found.is_some_and(|solution| is_true(&solution, &scene.camera, turn)));
        }
        assert!(right >= 18, "{turn:?}: {right} of 20");
    }
}

#[test]
fn a_camera_that_looks_up_slightly_stays_upright() {
    let mut random = ChaCha8Rng::seed_from_u64(43);
    for _ in 0..20 {
        // A camera that hangs upside down and looks down shows the same lines as an upright camera that looks
        // up.
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, Some(12.0));
        let lines = scene.noisy(&mut random, 1.0);
        let Some(solution) = solve(&turned(Turn::Half, lines, LensEntry::default())) else { continue };
        assert!(solution.roll_deg.is_some_and(|roll| roll.abs() < 45.0), "{:?}", solution.roll_deg);
        assert!(solution.pitch_deg.is_some_and(|pitch| pitch < 0.0), "{:?}", solution.pitch_deg);
    }
}

#[test]
fn lines_of_a_camera_on_the_ceiling_are_reported_as_ambiguous() {
    let mut random = ChaCha8Rng::seed_from_u64(44);
    let mut reported = 0;
    for _ in 0..20 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, Some(30.0));
        let lines = scene.noisy(&mut random, 1.0);
        let Some(solution) = solve(&turned(Turn::Half, lines, LensEntry::default())) else { continue };
        let turned = solution.alternatives.iter().any(|other| other.roll_deg.abs() > 135.0);
        reported += u32::from(turned && solution.has_warning(Code::TwoSolutions));
    }
    assert!(reported >= 18, "{reported} of 20");
}
