//! How long a frame takes: sixteen cameras, all views live, a mark dragged. Printed, not judged.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod desk;

use std::time::Instant;

use calib_app::tools::Pane;
use calib_core::{Options, Site};
use desk::{Desk, demo};
use egui::{Event, Key, Modifiers, PointerButton, Pos2};

/// Three shop cameras again and again, sixteen in all.
fn sixteen() -> Site {
    let mut site = demo();
    let shop = site.cameras[..3].to_vec();
    site.cameras = (0..16)
        .map(|i| {
            let mut camera = shop[i % 3].clone();
            camera.id = format!("{}-{i}", camera.id);
            camera
        })
        .collect();
    (site.links, site.distances) = (Vec::new(), Vec::new());
    site
}

#[test]
#[ignore = "measures, and says nothing about right or wrong"]
fn a_frame_of_sixteen_cameras_with_a_mark_in_the_hand() {
    let mut desk = Desk::new(sixteen());
    desk.key(Key::Num3);
    desk.take("Select");
    let foot = desk.site().marks[0].at_m;
    let from = desk.app().session.solved.pose(0).unwrap().world_to_pixel(foot).unwrap();
    let at = desk.screen(Pane::Image(0), from.into());
    let button = |pressed| Event::PointerButton {
        pos: at,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    desk.harness.event(Event::PointerMoved(at));
    desk.harness.event(button(true));
    desk.harness.step();
    let mut times: Vec<f64> = (0..1000)
        .map(|i| {
            let angle = f64::from(i) * 0.05;
            let to = Pos2::new(at.x + 20.0 * angle.cos() as f32, at.y + 10.0 * angle.sin() as f32);
            desk.harness.event(Event::PointerMoved(to));
            let start = Instant::now();
            desk.harness.step();
            1e3 * start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("app_frame_16_cameras_ms median {:.2}, worst {:.2}", times[500], times[999]);
    let site = demo();
    let options = Options { refine: false, cameras: Some(vec!["shop-1".into()]), ..Options::default() };
    let start = Instant::now();
    for _ in 0..100 {
        std::hint::black_box(site.calibrate(&options));
    }
    println!("one camera's solve {:.2} ms", 10.0 * start.elapsed().as_secs_f64());
}
