//! Views, units, and the import and export of files.

use calib_app::choice::{Chosen, Purpose};
use calib_app::command::{self, Command};
use calib_app::state::Place;
use calib_app::storage::files::Images;
use calib_core::floor::{Geographic, TangentPlane};
use calib_core::{Annotation, Kind, Pixel, WorldPoint};
use calib_editor::{Action, Pane, Part, PlanHandle, TOOLS, Units, plan_handles};
use calib_site::Site;
use calib_tests::Scratch;
use egui::{Event, Key, Modifiers, Pos2, Vec2};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{self, Desk, demo, last_vertical, still, with_edge};

/// Returns all text on screen.
fn words(desk: &Desk) -> String {
    desk.words().join("\n")
}

#[test]
fn lengths_are_shown_in_metres_or_feet_and_stored_in_metres() {
    let mut desk = Desk::new(demo());
    let before = desk.site().clone();
    let shown = |desk: &mut Desk| {
        let mut all = String::new();
        for key in [Key::Num1, Key::Num2, Key::Num3, Key::Num4] {
            desk.key(key);
            let middle = desk.harness.ctx.content_rect().center() + Vec2::new(80.0, 120.0);
            desk.harness.hover_at(middle);
            desk.harness.run_steps(2);
            all += &words(desk);
            all.push('\n');
        }
        all
    };
    assert!(shown(&mut desk).contains(" m"));
    desk.tell(Command::Feet);
    assert_eq!(desk.app().editor.session().site.units, Units::Feet);
    let feet = shown(&mut desk);
    let metres = |line: &&str| {
        let mut words = line.split_whitespace().peekable();
        std::iter::from_fn(|| words.next()).any(|word| word == "m" || word == "cm")
    };
    let left: Vec<&str> = feet.lines().filter(metres).collect();
    assert!(left.is_empty(), "{left:?}");
    assert!(feet.contains(" ft"), "{feet}");
    assert!(*desk.site() == Site { units: Units::Feet, ..before }, "the site differs");
}

#[test]
fn positions_on_the_map_have_a_standard_deviation() {
    let mut site = demo();
    let origin = Geographic { latitude: 0.84, longitude: 0.2, height: 0.0 };
    let plane = TangentPlane::new(origin, 0.5);
    let scale = site.plan.as_ref().expect("a plan").scale();
    for point in &mut site.cameras[0].control_points {
        let on_floor = |px| scale.floor_from_plan(px).at_height(point.height_m.unwrap_or(0.0));
        let world = point.world_m.or_else(|| point.plan_px.map(on_floor)).expect("coordinates");
        let at = plane.to_geographic(world);
        point.lat_deg = Some(at.latitude.to_degrees());
        point.lon_deg = Some(at.longitude.to_degrees());
        point.sigma_m = Some(0.5);
    }
    let mut desk = Desk::new(site);
    // Returns latitude, longitude and standard deviation of a shown position.
    let shown = |desk: &Desk| {
        let all = desk.words();
        let read = |text: &String| {
            let (at, sigma) = text.split_once(" \u{b1} ")?;
            let (lat, lon) = at.split_once(", ")?;
            let number = |text: &str| text.parse::<f64>().ok();
            Some([number(lat)?, number(lon)?, number(sigma.strip_suffix(" m")?)?])
        };
        all.iter().find_map(read).unwrap_or_else(|| panic!("no position: {all:?}"))
    };
    desk.key(Key::Num2);
    let at = [12.0, 5.0];
    let place = desk.screen(Pane::Plan, at);
    desk.harness.hover_at(place);
    desk.harness.run_steps(2);
    let [lat, lon, sigma] = shown(&desk);
    let truth = plane.to_geographic(WorldPoint::new(at[0], at[1], 0.0));
    let found = Geographic { latitude: lat.to_radians(), longitude: lon.to_radians(), height: 0.0 };
    let error = plane.to_world(found).distance(plane.to_world(truth));
    assert!(error < 0.1, "{error} m");
    // The mean of seven points of 0.5 m each, and the azimuth, determine the standard deviation.
    assert!((0.15..0.6).contains(&sigma), "{sigma}");
    let [near, far] = [[12.0, 5.0], [30.0, -12.0]].map(|[x, y]| {
        let [[a, b], [_, d]] =
            desk.app().editor.session().georeference_covariance(calib_core::FloorPoint { x, y });
        assert!(a > 0.0 && d > 0.0 && a * d > b * b, "not a covariance: {a} {b} {d}");
        a + d
    });
    assert!(far > near, "the azimuth moves far points more: {near} {far}");
}

#[test]
fn lengths_of_unknown_scale_are_multiples_of_the_camera_height() {
    let mut site = demo();
    site.cameras.truncate(1);
    let camera = &mut site.cameras[0];
    (camera.placement, camera.height_m) = (None, None);
    camera.control_points.clear();
    camera.annotations.retain(|drawn| !matches!(drawn.kind, Kind::Upright | Kind::KnownLength));
    (site.links, site.marks, site.distances) = (Vec::new(), Vec::new(), Vec::new());
    let mut desk = Desk::new(site);
    desk.key(Key::Num1);
    let middle = desk.harness.ctx.content_rect().center() + Vec2::new(80.0, 120.0);
    desk.harness.hover_at(middle);
    desk.harness.run_steps(2);
    let shown = words(&desk);
    assert!(shown.contains("camera height"), "{shown}");
    assert!(shown.contains("Height, assumed") && shown.contains("Ratio of floor lengths"), "{shown}");
    // The result offers the annotations that determine the scale.
    desk.harness.get_by_label_contains("Draw a person, a door").click();
    desk.harness.run_steps(2);
    desk.harness.get_by_label_contains("Person or door").click();
    desk.harness.run_steps(2);
    // The new upright waits for its height.
    let camera = *desk.app().editor.session().solved.pose(0).unwrap();
    let foot = camera.pixel_to_floor(Pixel::new(900.0, 700.0), 0.0).unwrap();
    let ends = [0.0, 1.0].map(|z| camera.world_to_pixel(WorldPoint::new(foot.x, foot.y, z)).unwrap());
    desk.line(0, ends[0], ends[1]);
    assert!(desk.site().cameras[0].annotations.last().unwrap().off);
    assert!(!desk.app().editor.session().solved.scale_is_known(0));
    let last = desk.site().cameras[0].annotations.len() - 1;
    // Without a height, it cannot be switched on.
    desk.app().act(Action::Select(Part::Line { annotation: last, segment: 0 }));
    desk.tell(Command::OnOff);
    assert!(desk.site().cameras[0].annotations[last].off);
    let drawn = desk.site().cameras[0].annotations[last].clone();
    let sized = Annotation { off: false, height_m: None, like: Some("person".into()), ..drawn };
    let change = Action::Annotate { index: last, annotation: Box::new(sized), name: "size".into() };
    desk.app().act(change);
    assert!(desk.app().editor.session().solved.scale_is_known(0));
    desk.harness.run_steps(2);
    assert!(!words(&desk).contains("camera height"));
    // The next upright has the size of the last one.
    desk.take("Upright");
    desk.line(0, ends[0], ends[1]);
    assert!(!desk.site().cameras[0].annotations.last().unwrap().off);
}

#[test]
fn height_typed_in_feet_is_stored_in_metres() {
    let mut desk = Desk::new(demo());
    desk.tell(Command::Feet);
    desk::change(desk.app(), "no control points", |site| {
        site.cameras.iter_mut().for_each(|camera| camera.control_points.clear());
    });
    desk.key(Key::Num2);
    let field = desk.harness.get_all_by_label("Height").last().unwrap().rect();
    desk.drag_screen(&[field.center()], Modifiers::NONE);
    desk.harness.run_steps(2);
    desk.keys(Modifiers::COMMAND, Key::A);
    desk.harness.event(Event::Text("10".into()));
    desk.harness.run_steps(2);
    desk.key(Key::Enter);
    let height = desk.app().editor.session().placement(0).unwrap().scale * calib_core::floor::STAGE_1_HEIGHT;
    assert!((height - 3.048).abs() < 1e-6, "{height} m");
}

#[test]
fn line_drawn_on_an_undistorted_image_follows_the_cursor() {
    let site = demo();
    let is_distorted = |camera: &calib_site::SiteCamera| {
        camera.lens.as_ref().is_some_and(|lens| lens.distortion.is_some())
            || camera.annotations.iter().any(|a| a.kind == Kind::Straight)
    };
    let camera = site.cameras.iter().position(is_distorted).expect("a camera with distortion");
    let mut desk = Desk::new(site);
    for _ in 0..camera {
        desk.key(Key::CloseBracket);
    }
    let at = [150.0, 120.0];
    let raw = desk.screen(Pane::Image(camera), at);
    desk.key(Key::T);
    let flat = desk.screen(Pane::Image(camera), at);
    assert!(raw.distance(flat) > 2.0, "the bend is taken out");
    desk.take("Vertical");
    desk.line(camera, Pixel::from(at), Pixel::new(160.0, 400.0));
    let drawn = desk.site().cameras[camera].annotations.iter().rfind(|a| a.kind == Kind::Vertical).unwrap();
    let line = drawn.segments.as_ref().unwrap().last().unwrap();
    assert!(line[0].distance(at.into()) < 0.02, "{line:?}");
}

#[test]
fn overview_map_moves_the_view() {
    let mut desk = Desk::new(demo());
    let label = "Whole image: drag to move the view";
    let key = (Place::Main, Pane::Image(0));
    assert!(desk.harness.query_by_label(label).is_none(), "all of it is shown");
    desk.take("Vertical");
    for _ in 0..6 {
        desk.key(Key::Plus);
    }
    let rect = desk.harness.get_by_label(label).rect();
    let centre = |desk: &mut Desk| desk.app().view.panes.mapping(key.0, key.1).unwrap().view.centre;
    let before = centre(&mut desk);
    let to = rect.min + 0.25 * rect.size();
    desk.drag_screen(&[rect.center(), to, to], Modifiers::NONE);
    desk.harness.run_steps(2);
    let after = centre(&mut desk);
    assert!((after[0] - 480.0).abs() < 20.0 && (after[1] - 270.0).abs() < 20.0, "{before:?} to {after:?}");
    assert_eq!(desk.site(), &demo(), "no annotation is added there");
    assert_eq!(desk.app().editor.session().history.depth(), 0);
}

#[test]
fn dragged_points_snap_only_on_request() {
    for snaps in [false, true] {
        let mut site = demo();
        for camera in &mut site.cameras {
            camera.control_points.clear();
        }
        let mut desk = Desk::new(site);
        desk.key(Key::Num2);
        if snaps {
            desk.tell(Command::Snap);
        }
        desk.take("Select");
        let foot = plan_handles(desk.app().editor.session(), 0)[0];
        assert_eq!(foot.0, PlanHandle::Foot);
        let from = desk.screen(Pane::Plan, foot.1);
        desk.drag_screen(&[from, from + Vec2::new(37.0, -23.0)], Modifiers::NONE);
        let at = desk.site().cameras[0].placement.as_ref().unwrap().move_m;
        let off = (10.0 * at.x - (10.0 * at.x).round()).abs() + (10.0 * at.y - (10.0 * at.y).round()).abs();
        assert_eq!(off < 1e-4, snaps, "{at:?}");
    }
}

#[test]
fn line_dragged_with_alt_snaps_to_the_edge() {
    let edge = |v: f64| 800.3 + 0.1 * v;
    let mut desk = with_edge(demo(), edge);
    desk.take("Vertical");
    desk.line(0, Pixel::new(edge(300.0) + 60.0, 300.0), Pixel::new(edge(700.0) + 60.0, 700.0));
    desk.take("Select");
    let middle = Pixel::new(edge(500.0) + 60.0, 500.0);
    let [from, to] = [0.0, 57.0].map(|by| desk.screen(Pane::Image(0), [middle.u - by, middle.v]));
    desk.drag_screen(&[from, to], Modifiers::ALT);
    for p in last_vertical(&desk) {
        assert!((p.u - edge(p.v)).abs() < 0.15, "{} px off the edge", p.u - edge(p.v));
    }
}

#[test]
fn warnings_and_list_use_the_same_names() {
    let mut desk = Desk::new(demo());
    desk.take("Vertical");
    desk.line(0, Pixel::new(300.0, 900.0), Pixel::new(900.0, 300.0));
    desk.harness.run_steps(3);
    let words = words(&desk);
    let name = desk.site().cameras[0].annotations.iter().rposition(|a| a.kind == Kind::Vertical).unwrap();
    let annotations = &desk.site().cameras[0].annotations;
    let last = annotations[name].segments.as_ref().unwrap().len() - 1;
    let name = calib_core::single::line_name(annotations, name, last);
    assert!(words.contains(&format!("{name} contradicts the other lines")), "{name}: {words}");
    assert!(!words.contains("(annotation"), "{words}");
}

#[test]
fn scene_rotates_pans_zooms_and_selects_a_camera() {
    let mut desk = Desk::new(demo());
    desk.key(Key::Num4);
    let start = desk.app().view.orbit.unwrap();
    let middle = desk.harness.get_by_label("Scene").rect().center();
    let path = [middle, middle + Vec2::new(40.0, 10.0), middle + Vec2::new(80.0, 30.0)];
    let drag = |desk: &mut Desk, modifiers| {
        for (i, &at) in path.iter().enumerate() {
            desk.harness.event_modifiers(Event::PointerMoved(at), modifiers);
            if i == 0 {
                desk.press(at, modifiers);
            }
            desk.harness.step();
        }
        desk.release(path[2], modifiers);
        desk.harness.run_steps(2);
    };
    drag(&mut desk, Modifiers::NONE);
    let turned = desk.app().view.orbit.unwrap();
    assert!(turned.yaw != start.yaw && turned.target == start.target, "{turned:?}");
    drag(&mut desk, Modifiers::SHIFT);
    let panned = desk.app().view.orbit.unwrap();
    assert!(panned.target != turned.target && panned.yaw == turned.yaw, "{panned:?}");
    desk.harness.event(Event::Zoom(1.5));
    desk.harness.run_steps(3);
    assert!(desk.app().view.orbit.unwrap().distance < panned.distance);
    let (orbit, rect) = (desk.app().view.orbit.unwrap(), desk.harness.get_by_label("Scene").rect());
    let shown: Vec<(usize, Pos2)> = (1..desk.site().cameras.len())
        .filter_map(|i| Some((i, orbit.project(rect, desk.app().editor.session().solved.pose(i)?.position)?)))
        .collect();
    let (camera, at) = shown.into_iter().find(|(_, at)| rect.shrink(10.0).contains(*at)).unwrap();
    desk.drag_screen(&[at], Modifiers::NONE);
    desk.harness.run_steps(2);
    let picked = desk.app().editor.session().camera;
    assert!(picked == camera || picked != 0, "{picked}");
}

#[test]
fn report_is_one_page_with_every_camera_and_its_image() {
    let (mut site, mut images) = (demo(), Images::default());
    let jpeg: &[u8] = &[0xff, 0xd8, 0xff, 0xe0];
    site.cameras[0].image = Some(images.store(jpeg.into(), "image/jpeg", Some("first.jpg")));
    site.cameras[1].image = Some("nowhere.png".into());
    site.cameras[2].image = None;
    let mut desk = Desk::with(site, images);
    let scratch = Scratch::new();
    let path = scratch.path("report.html");
    desk.answer(Some(path.clone()));
    let ctx = desk.harness.ctx.clone();
    command::run(desk.app(), &ctx, Command::Report, Modifiers::NONE);
    desk.harness.run_steps(4);
    let html = std::fs::read_to_string(path).unwrap();
    for (index, camera) in desk.site().cameras.iter().enumerate() {
        let section = html.split(&format!("<section id=\"{}\">", camera.id)).nth(1).unwrap();
        let section = &section[..section.find("</section>").unwrap()];
        assert!(section.contains("Residual, px"), "{}", camera.id);
        assert_eq!(section.contains("data:image/jpeg;base64,/9j/4A=="), index == 0, "{}", camera.id);
        assert_eq!(section.contains("note bad"), index == 1, "missing images are reported: {}", camera.id);
        assert_eq!(section.contains("<figure>"), index == 0, "{}", camera.id);
    }
    assert!(html.contains("View from above"));
}

#[test]
fn image_of_the_view_is_saved_to_a_chosen_file() {
    let mut desk = Desk::new(demo());
    let scratch = Scratch::new();
    let path = scratch.path("view.png");
    desk.answer(Some(path.clone()));
    let ctx = desk.harness.ctx.clone();
    command::run(desk.app(), &ctx, Command::SavePicture, Modifiers::NONE);
    desk.harness.step();
    let asked: Vec<_> =
        desk.harness.output().viewport_output.values().flat_map(|v| &v.commands).cloned().collect();
    let window = egui::ColorImage::filled([1440, 900], egui::Color32::RED);
    for command in asked {
        if let egui::ViewportCommand::Screenshot(callback) = command {
            callback.complete(std::sync::Arc::new(window.clone()));
        }
    }
    desk.harness.run_steps(4);
    let saved = calib_editor::decode(&std::fs::read(path).unwrap()).unwrap();
    let rect = desk.app().view.panes.rects[&(Place::Main, Pane::Image(0))];
    let off = [saved.width() as f32 - rect.width(), saved.height() as f32 - rect.height()];
    assert!(off.iter().all(|by| by.abs() <= 2.0), "{off:?}");
}

#[test]
fn lossy_export_needs_confirmation() {
    let mut desk = Desk::new(demo());
    let scratch = Scratch::new();
    desk.keys(Modifiers::COMMAND, Key::E);
    // WILDTRACK does not support distortion.
    desk.app().dialogs.export.choose("wildtrack");
    desk.harness.run_steps(2);
    let patience = std::time::Instant::now();
    while desk.harness.query_by_label_contains("files\u{2026}").is_none() {
        desk.harness.step();
        assert!(patience.elapsed().as_secs() < 300, "no file is created");
    }
    assert!(words(&desk).contains("distortion"), "{}", words(&desk));
    desk.answer(Some(scratch.path("")));
    let press = |desk: &mut Desk, label: &str| {
        let at = desk.harness.get_by_label_contains(label).rect().center();
        desk.drag_screen(&[at], Modifiers::NONE);
        desk.harness.run_steps(4);
    };
    press(&mut desk, "files\u{2026}");
    let count = || std::fs::read_dir(scratch.path("")).unwrap().count();
    assert_eq!(count(), 0, "no file is written before the losses are confirmed");
    press(&mut desk, "Export anyway");
    press(&mut desk, "files\u{2026}");
    assert!(count() > 0, "{:?}", desk.app().editor.error());
}

#[test]
fn imported_lens_is_set_on_the_selected_camera() {
    let mut desk = Desk::new(demo());
    let scratch = Scratch::new();
    // For images of half the size: the lens is scaled to this camera's size.
    let [w, h] = desk.site().cameras[0].size_px.map(|side| side / 2);
    let k = format!("700.0, 0.0, {}.0, 0.0, 700.0, {}.0, 0.0, 0.0, 1.0", w / 2, h / 2);
    scratch.write(
        "elsewhere.yaml",
        format!(
            "image_width: {w}\nimage_height: {h}\ncamera_name: elsewhere\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [{k}]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.2, 0.05, 0.0, 0.0, 0.0]\n"
        ),
    );
    desk.answer(Some(scratch.path("elsewhere.yaml")));
    desk.tell(Command::Import);
    assert_eq!(desk.app().editor.error(), None);
    let lens = desk.site().cameras[0].lens.clone().unwrap();
    assert_eq!(lens.focal_px.map(|focal| focal.value), Some(1400.0));
    assert_eq!(lens.distortion.and_then(|distortion| distortion.k1), Some(-0.2));
    desk.undo();
    assert_eq!(desk.site().cameras[0].lens, demo().cameras[0].lens);
}

#[test]
fn annotations_are_copied_to_another_camera_at_its_size() {
    let mut desk = Desk::new(demo());
    let own = desk.site().cameras[0].annotations.len();
    let before = desk.site().cameras[1].annotations.len();
    desk.keys(Modifiers::COMMAND | Modifiers::SHIFT, Key::C);
    desk.key(Key::CloseBracket);
    desk.keys(Modifiers::COMMAND | Modifiers::SHIFT, Key::V);
    assert_eq!(desk.site().cameras[1].annotations.len(), before + own);
    desk.undo();
    assert_eq!(desk.site().cameras[1].annotations.len(), before);
}

#[test]
fn replaced_image_keeps_annotations_and_overlays_the_old_image() {
    let scratch = Scratch::new();
    let mut site = demo();
    let size = site.cameras[0].size_px;
    still(&scratch, "old.png", size);
    still(&scratch, "new.png", size.map(|side| side / 2));
    site.cameras[0].image = Some(scratch.path("old.png").to_string_lossy().into_owned());
    let mut desk = Desk::new(site);
    let id = desk.site().cameras[0].id.clone();
    let drawn = |desk: &Desk| {
        let site = desk.site();
        let linked =
            site.links.iter().flat_map(|link| &link.seen).find(|seen| seen.camera == id && seen.px.is_some());
        let line = site.cameras[0].annotations[0].polylines().next().unwrap()[0];
        [line, linked.unwrap().px.unwrap()]
    };
    let before = drawn(&desk);
    desk.answer(Some(scratch.path("new.png")));
    desk.tell(Command::ReplaceStill);
    desk.wait(|app| app.editor.replaced_image().is_some());
    assert_eq!(drawn(&desk), before, "annotations are not rescaled");
    desk.harness.run_steps(3);
    assert!(desk.harness.query_by_label("Old image").is_some(), "old and new are blended");
    desk.harness.get_by_label_contains("Rescale the annotations to").click();
    desk.harness.run_steps(3);
    for (now, before) in drawn(&desk).iter().zip(before) {
        assert!(now.distance(Pixel::new(0.5 * before.u, 0.5 * before.v)) < 1e-9, "{now:?}");
    }
    desk.undo();
    assert_eq!(drawn(&desk), before);
    desk.undo();
    assert_eq!(desk.site().cameras[0].size_px, size);
}

#[test]
fn a_saved_version_is_compared_camera_by_camera() {
    let scratch = Scratch::new();
    let mut site = demo();
    for camera in &mut site.cameras {
        camera.control_points.clear();
    }
    let solved =
        site.calibrate(&calib_site::Options { refine: false, ..Default::default() }).write_into(&site);
    scratch.write("saved.json", solved.to_json());
    site.cameras[1].placement.as_mut().unwrap().move_m.x += 0.5;
    let mut desk = Desk::new(site);
    desk.answer(Some(scratch.path("saved.json")));
    desk.tell(Command::Compare);
    let text = words(&desk);
    assert!(text.contains("50.0 cm") && text.contains("0.0 cm"), "{text}");
}

#[test]
fn reading_can_be_cancelled_and_resumed() {
    let scratch = Scratch::new();
    let mut site = demo();
    for (index, camera) in site.cameras.iter_mut().enumerate() {
        let name = format!("{index}.png");
        still(&scratch, &name, camera.size_px);
        camera.image = Some(scratch.path(&name).to_string_lossy().into_owned());
    }
    let mut desk = Desk::new(site);
    assert!(desk.app().is_working());
    desk.tell(Command::StopWork);
    assert!(!desk.app().is_working(), "no image is pending");
    desk.tell(Command::ReadAgain);
    desk.wait(|app| app.pictures.loading() == 0);
    let name = desk.site().cameras[0].image.clone().unwrap();
    assert!(desk.app().pictures.ready(&name).is_some());
}

#[test]
fn svg_plan_is_converted_to_png() {
    let scratch = Scratch::new();
    scratch.write("plan.svg", r#"<svg xmlns="http://www.w3.org/2000/svg" width="60" height="40"><rect width="30" height="40"/></svg>"#);
    let mut desk = Desk::new(demo());
    desk.answer(Some(scratch.path("plan.svg")));
    desk::change(desk.app(), "no plan", |site| site.plan = None);
    desk.tell(Command::LoadPlan);
    desk.wait(|app| app.editor.session().site.plan.is_some());
    let images = desk.app().editor.session().images.clone();
    let saved = images.embed_into(desk.site(), None);
    let image = saved.plan.and_then(|plan| plan.image).unwrap();
    assert!(image.starts_with("data:image/png;base64,"), "{}", &image[..40]);
}

/// Returns a DXF in this unit with the outline of a hall of 20 x 12, and a line on the layer FURNITURE.
fn hall_dxf(unit: i32) -> String {
    let line = |layer: &str, [a, b, c, d]: [f64; 4]| {
        format!("0\nLINE\n8\n{layer}\n10\n{a}\n20\n{b}\n11\n{c}\n21\n{d}\n")
    };
    let lines = line("WALLS", [0.0, 0.0, 20.0, 0.0])
        + &line("WALLS", [20.0, 0.0, 20.0, 12.0])
        + &line("WALLS", [20.0, 12.0, 0.0, 12.0])
        + &line("WALLS", [0.0, 12.0, 0.0, 0.0])
        + &line("FURNITURE", [5.0, 5.0, 9.0, 5.0]);
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n{unit}\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{lines}0\nENDSEC\n0\nEOF\n"
    )
}

/// Opens the drawing of the hall in metres as the plan, and shows the plan.
fn hall_in_metres() -> (Scratch, Desk) {
    let scratch = Scratch::new();
    scratch.write("hall.dxf", hall_dxf(6));
    let mut desk = Desk::new(demo());
    let ctx = desk.harness.ctx.clone();
    desk.app().open_paths(&ctx, [scratch.path("hall.dxf")]);
    desk.wait(|app| app.editor.site().plan.as_ref().is_some_and(|plan| plan.metres_per_px == 0.005));
    desk.key(Key::Num2);
    desk.wait(|app| app.plan_picture().is_some());
    (scratch, desk)
}

#[test]
fn dxf_plan_has_its_scale_layers_and_corners() {
    let (_scratch, mut desk) = hall_in_metres();
    // The origin of the drawing is world (0, 0).
    let corner = desk.site().plan.as_ref().unwrap().scale().plan_from_floor([20.0, 12.0].into());
    let drawing = desk.app().plan_picture().unwrap().drawing.clone().unwrap();
    assert!(
        drawing
            .corners_px
            .iter()
            .any(|&[x, y]| (f64::from(x) - corner.x).hypot(f64::from(y) - corner.y) < 0.01)
    );
    let names: Vec<&str> = drawing.layers.iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(names, ["FURNITURE", "WALLS"]);
    // A click near a corner measures from the corner.
    let measure = TOOLS.iter().position(|tool| tool.title == "Measure").unwrap();
    desk.app().act(Action::SelectTool(measure));
    desk.click(Pane::Plan, [0.02, 0.02]);
    desk.click(Pane::Plan, [19.98, 0.03]);
    let [a, b] = desk.app().editor.session().tool.measured.unwrap();
    assert!((a.distance(b) * 0.005 - 20.0).abs() < 1e-6, "{}", a.distance(b) * 0.005);
    // Hidden layers do not move the pixels.
    desk::change(desk.app(), "walls alone", |site| {
        site.plan.as_mut().unwrap().layers = Some(vec!["WALLS".into()]);
    });
    desk.harness.run_steps(2);
    desk.wait(|app| app.plan_picture().is_some());
    let walls = desk.app().plan_picture().unwrap();
    assert_eq!(walls.size(), drawing.size);
    assert!(!walls.drawing.as_ref().unwrap().layers[0].is_shown);
}

#[test]
fn dxf_plan_is_sharp_at_every_zoom() {
    let (_scratch, mut desk) = hall_in_metres();
    desk.harness.run_steps(20);
    assert_eq!(desk.app().plan_picture().unwrap().sharp_part(), None);
    desk.app().view.panes.active = Some((Place::Main, Pane::Plan));
    (0..25).for_each(|_| desk.tell(Command::ZoomIn));
    desk.wait(|app| app.plan_picture().is_some_and(|picture| picture.sharp_part().is_some()));
    let part = desk.app().plan_picture().unwrap().sharp_part().unwrap();
    let density = f64::from(part.pixels[0]) / part.size[0];
    assert!(density > 3.0 && part.size[0] < 1000.0, "{part:?}");
    // The whole plan needs no detail.
    desk.tell(Command::Fit);
    desk.harness.run_steps(3);
    assert_eq!(desk.app().plan_picture().unwrap().sharp_part(), None);
}

#[test]
fn dxf_plan_without_unit_asks_for_a_length() {
    let scratch = Scratch::new();
    scratch.write("hall.dxf", hall_dxf(0));
    let mut desk = Desk::new(demo());
    let ctx = desk.harness.ctx.clone();
    let before = desk.site().plan.as_ref().unwrap().metres_per_px;
    desk.app().open_paths(&ctx, [scratch.path("hall.dxf")]);
    desk.wait(|app| app.waiting() == 0);
    let plan = desk.site().plan.clone().unwrap();
    assert_eq!(plan.metres_per_px, before);
    assert_eq!(TOOLS[desk.app().editor.tool_row()].title, "Measure");
    scratch.write("broken.dxf", "0\nSECTION\n2\nENTITIES\n0\nEOF\n");
    desk.app().open_paths(&ctx, [scratch.path("broken.dxf")]);
    desk.wait(|app| app.waiting() == 0);
    let error = desk.app().editor.error().map(str::to_owned).unwrap();
    assert!(error.contains("broken.dxf") && error.contains("no visible lines"), "{error}");
    assert_eq!(desk.site().plan, Some(plan), "the plan stays");
}

#[test]
fn world_file_aligns_its_plan_or_the_existing_one() {
    let loose =
        |name: &str, bytes: &[u8]| Chosen { name: name.into(), path: None, bytes: Some(bytes.into()) };
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(80, 60).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let mut desk = Desk::new(demo());
    let (before, ctx) = (desk.site().clone(), desk.harness.ctx.clone());
    let world = loose("hall.pgw", b"0.05\n0\n0\n-0.05\n2\n9\n");
    desk.app().open_files(&ctx, vec![world, loose("hall.png", png.get_ref())]);
    desk.wait(|app| app.waiting() == 0);
    assert_eq!(desk.site().cameras.len(), before.cameras.len(), "it is not an image of a camera");
    let first = |desk: &Desk| {
        let plan = desk.site().plan.as_ref().unwrap();
        (plan.metres_per_px, plan.scale().floor_from_plan(calib_core::PlanPixel::new(0.5, 0.5)))
    };
    let (scale, at) = first(&desk);
    assert!((scale - 0.05).abs() < 1e-12 && at.distance([2.0, 9.0].into()) < 1e-9, "{scale} {at:?}");
    desk.app().open_files(&ctx, vec![loose("other.wld", b"0.1 0 0 -0.1 5 5")]);
    let (scale, at) = first(&desk);
    assert!((scale - 0.1).abs() < 1e-12 && at.distance([5.0, 5.0].into()) < 1e-9, "{scale} {at:?}");
    assert_eq!(desk.harness.state().editor.error(), None);
    desk.app().open_files(&ctx, vec![loose("mirrored.wld", b"0.1 0 0 0.1 5 5")]);
    assert!(desk.harness.state().editor.error().unwrap().contains("mirrored.wld"));
    desk.undo();
    desk.undo();
    assert_eq!(desk.site().plan, before.plan);
    desk.app().act(Action::CloseError);
    let two = vec![loose("hall.png", png.get_ref()), loose("yard.png", png.get_ref()), loose("c.wld", b"")];
    desk.app().load_plan(&ctx, two);
    desk.wait(|app| app.waiting() == 0);
    let error = desk.harness.state().editor.error().map(str::to_owned).unwrap();
    assert!(error.contains("yard.png") && error.contains("c.wld"), "ignored parts are reported: {error}");
    assert_eq!(desk.site().plan.as_ref().unwrap().metres_per_px, before.plan.unwrap().metres_per_px);
}

#[test]
fn alternative_solution_is_offered_and_the_view_is_kept() {
    let mut site = demo();
    let camera = &mut site.cameras[0];
    camera.annotations.retain(|annotation| annotation.kind == Kind::Vertical);
    (camera.control_points, camera.placement) = (Vec::new(), None);
    let mut desk = Desk::new(site);
    desk.harness.run_steps(3);
    let rect = desk.app().view.panes.rects[&(Place::Main, Pane::Image(0))];
    let at = desk.harness.get_by_label("Compare them").rect().center();
    assert!(rect.contains(at), "it is over the image");
    desk.drag_screen(&[at], Modifiers::NONE);
    desk.harness.run_steps(3);
    assert!(desk.harness.query_by_label("Horizontal field of view 2").is_some(), "a family has sliders");
    let (camera, family) =
        desk.app().editor.family().map(|(camera, family)| (camera, family.clone())).unwrap();
    let view = family.shown[1].view;
    let button = format!("Use {view:.0}\u{b0}");
    let at = desk.harness.get_all_by_label(&button).last().unwrap().rect().center();
    desk.drag_screen(&[at], Modifiers::NONE);
    desk.harness.run_steps(3);
    let focal = desk.site().cameras[camera].lens.as_ref().and_then(|lens| lens.focal_px).unwrap();
    assert!((focal.value - family.shown[1].solution.focal_px).abs() < 1e-6 && !focal.fixed, "{focal:?}");
}

#[test]
fn closed_chooser_changes_nothing() {
    for purpose in [
        Purpose::Open,
        Purpose::SaveSite,
        Purpose::AddImages,
        Purpose::LoadPlan,
        Purpose::ReplaceStill,
        Purpose::NewerStill,
        Purpose::Compare,
        Purpose::Import,
        Purpose::Export,
        Purpose::SavePicture,
        Purpose::SaveReport,
    ] {
        let mut desk = Desk::new(demo());
        let before = desk.site().clone();
        desk.app().open_dialog(purpose);
        desk.harness.run_steps(3);
        assert!(*desk.site() == before && desk.app().editor.error().is_none(), "{purpose:?}");
    }
}

#[test]
fn image_circle_is_detected_removed_and_detected_again() {
    let scratch = Scratch::new();
    let [w, h] = [480_u32, 400];
    let (u, v, radius) = (243.0, 198.0, 180.0);
    let picture = image::RgbImage::from_fn(w, h, |x, y| {
        let inside = radius - (f64::from(x) + 0.5 - u).hypot(f64::from(y) + 0.5 - v) + 0.5;
        image::Rgb([(150.0 * inside.clamp(0.0, 1.0)) as u8; 3])
    });
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    scratch.write("ceiling.png", png.get_ref());
    let mut desk = Desk::new(Site::new());
    desk.answer(Some(scratch.path("ceiling.png")));
    desk.tell(Command::AddImages);
    desk.wait(|app| !app.editor.site().cameras.is_empty() && !app.is_working());
    let circle = |desk: &Desk| desk.site().cameras[0].image_circle();
    let found = circle(&desk).expect("the circle is detected when the image is loaded");
    assert!(found.centre().distance(Pixel::new(u, v)) < 0.6 && (found.radius - radius).abs() < 0.8);
    desk.harness.run_steps(3);
    desk.harness.get_by_label("Remove").click();
    desk.harness.run_steps(3);
    assert_eq!(circle(&desk), None);
    desk.undo();
    assert_eq!(circle(&desk), Some(found));
    desk.redo();
    // The lens is set to fisheye by hand; the image circle is detected at once.
    desk.harness.get_by_role_and_label(egui::Role::ComboBox, "Lens").click();
    desk.harness.run_steps(3);
    desk.harness.get_by_label("fisheye").click();
    desk.harness.run_steps(3);
    assert_eq!(circle(&desk), Some(found));
    let asked = desk.site().cameras[0].lens.as_ref().and_then(|lens| lens.distortion.clone()).unwrap();
    assert!(asked.model.row().is_wide && asked.distortion().is_none(), "{asked:?}");
    assert!(words(&desk).contains("fisheye: needs straight edges"), "{}", words(&desk));
}

#[test]
fn plan_shows_the_pixel_density_of_the_cameras() {
    let mut desk = Desk::new(demo());
    desk.key(Key::Num2);
    let has = |desk: &Desk, text: &str| desk.words().iter().any(|word| word.contains(text));
    assert!(!has(&desk, "recognise, from 125 px/m"));
    desk.tell(Command::Coverage);
    assert!(has(&desk, "recognise, from 125 px/m") && has(&desk, "m\u{b2}"));
    let session = desk.app().editor.session();
    let foot = session.solved.pose(0).unwrap().position;
    let field = &session.solved.solution(0).unwrap().efov_m;
    let count = field.len() as f64;
    let middle = field.iter().fold([0.0; 2], |sum, at| [sum[0] + at.x / count, sum[1] + at.y / count]);
    let at = desk.screen(Pane::Plan, middle);
    desk.harness.hover_at(at);
    desk.harness.run_steps(3);
    assert!(desk.words().iter().any(|word| word.contains(" px/m (") && word.contains(" from ")), "{foot:?}");
    desk.tell(Command::Coverage);
    assert!(!has(&desk, "recognise, from 125 px/m"));
}

#[test]
fn areas_and_walls_are_drawn_listed_and_removed() {
    let mut desk = Desk::new(demo());
    desk.key(Key::Num2);
    let has = |desk: &Desk, text: &str| desk.words().iter().any(|word| word.contains(text));
    assert!(!has(&desk, "Areas and walls"));
    desk.take("Area of interest");
    desk.harness.run_steps(2);
    assert!(has(&desk, "Areas and walls"), "the tool shows the coverage");
    let corners = [[10.0, 5.0], [16.0, 5.0], [16.0, 9.0], [10.0, 9.0]];
    for at in corners {
        desk.click(Pane::Plan, at);
    }
    // The last corner is removed and drawn again. A click on the first corner closes the area.
    desk.key(Key::Backspace);
    desk.click(Pane::Plan, corners[3]);
    desk.click(Pane::Plan, corners[0]);
    let area = desk.site().areas[0].clone();
    assert_eq!((area.id.as_str(), area.polygon_m.len()), ("area-1", 4));
    for (at, expected) in area.polygon_m.iter().zip(corners) {
        assert!(at.distance(expected.into()) < 0.1, "{at:?}");
    }
    desk.take("Wall");
    for at in corners {
        desk.click(Pane::Plan, at);
    }
    desk.key(Key::Enter);
    assert_eq!(desk.site().walls.len(), 3);
    assert!(has(&desk, "Wall 3") && has(&desk, "area-1"));
    desk.undo();
    assert!(desk.site().walls.is_empty() && desk.site().areas.len() == 1, "all walls are one step");
    desk.redo();
    desk.harness.run_steps(2);
    desk.harness.get_by_label("Remove wall 2").click_accesskit();
    desk.harness.run_steps(3);
    desk.harness.get_by_label("Remove area-1").click_accesskit();
    desk.harness.run_steps(3);
    assert!(desk.site().areas.is_empty() && desk.site().walls.len() == 2);
    desk.undo();
    assert_eq!(desk.site().areas, [area]);
}
