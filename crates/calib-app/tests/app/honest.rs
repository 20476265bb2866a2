//! Uncertainties are correct: only drawn annotations and measured lengths enter the solution.

use calib_app::storage::files::Images;
use calib_core::Kind;
use calib_editor::Pane;
use calib_site::Site;
use egui::{Event, Key, Role};
use egui_kittest::kittest::{NodeT as _, Queryable as _};

use crate::desk::{Desk, demo};

/// Returns the first camera of the demonstration with only its verticals, so that floor lines would help.
fn verticals_alone() -> Site {
    let mut site = demo();
    site.cameras.truncate(1);
    (site.links, site.marks, site.distances) = (Vec::new(), Vec::new(), Vec::new());
    let camera = &mut site.cameras[0];
    camera.annotations.retain(|annotation| annotation.kind == Kind::Vertical);
    (camera.control_points, camera.placement) = (Vec::new(), None);
    site
}

fn focal_sigma(desk: &Desk) -> Option<f64> {
    desk.harness.state().editor.session().solution().unwrap().sigma.as_ref().unwrap().focal_px
}

#[test]
fn suggestion_selects_its_tool_and_draws_nothing() {
    let mut desk = Desk::new(verticals_alone());
    let (before, sigma) = (desk.site().clone(), focal_sigma(&desk));
    let kind = desk.app().proposal().expect("something would help").kind;
    desk.key(Key::N);
    assert!(*desk.site() == before, "no annotation is added");
    assert_eq!(focal_sigma(&desk), sigma, "the uncertainty does not change");
    assert_eq!(desk.app().editor.tool_kind(), kind, "the tool is selected");
}

#[test]
fn declined_suggestion_is_not_repeated() {
    let mut desk = Desk::new(verticals_alone());
    let ranked = desk.app().proposal().unwrap().clone();
    assert!(!ranked.otherwise.is_empty(), "{ranked:?}");
    assert!(ranked.otherwise.iter().all(|next| next.floor_length_rel >= ranked.floor_length_rel));
    let mut seen = vec![ranked.drawing];
    for _ in 0..=ranked.otherwise.len() {
        desk.keys(egui::Modifiers::SHIFT, Key::N);
        let Some(next) = desk.app().proposal().cloned() else { break };
        assert!(!seen.contains(&next.drawing), "{next:?} again");
        seen.push(next.drawing);
    }
    assert_eq!(seen.len(), 1 + ranked.otherwise.len());
    assert!(desk.app().proposal().is_none());
}

#[test]
fn suggested_edge_is_drawn_by_a_click() {
    let mut site = verticals_alone();
    let plain = Desk::new(site.clone());
    let next = plain.harness.state().proposal().unwrap().clone();
    assert_ne!(next.kind, Some(Kind::EqualLength));
    // One image with bars slightly off the suggested lines, and one without bars.
    let bars: Vec<_> = next.segments_px.iter().map(|[a, b]| [[a.u + 25.0, a.v], [b.u + 25.0, b.v]]).collect();
    for has_bars in [false, true] {
        let picture = image::RgbImage::from_fn(1920, 1080, |x, y| {
            let at = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            image::Rgb([if has_bars && bars.iter().any(|bar| is_on(bar, at)) { 220 } else { 70 }; 3])
        });
        let mut png = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
        let mut images = Images::default();
        site.cameras[0].image = Some(images.store(png.into_inner().into(), "image/png", None));
        let mut desk = Desk::with(site.clone(), images);
        desk.key(Key::N);
        desk.harness.run_steps(2);
        desk.wait(|app| app.pictures.loading() == 0 && !app.is_working());
        desk.harness.run_steps(3);
        let ctx = desk.harness.ctx.clone();
        let suggested = desk.app().suggested(&ctx);
        assert_eq!(suggested.len(), if has_bars { next.segments_px.len() } else { 0 });
        let Some(&[a, b]) = suggested.first() else { continue };
        desk.click(Pane::Image(0), [0.5 * (a.u + b.u), 0.5 * (a.v + b.v)]);
        let drawn = desk.site().cameras[0].annotations.last().unwrap();
        assert_eq!(Some(drawn.kind), next.kind);
        let line = drawn.polylines().next().unwrap();
        assert!(line.contains(&a) && line.contains(&b), "{line:?} is not the edge {a:?} {b:?}");
    }
}

/// Whether a point is on a bar 12 px wide.
fn is_on(bar: &[[f64; 2]; 2], at: [f64; 2]) -> bool {
    let [a, b] = bar;
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy);
    let along = ((at[0] - a[0]) * dx + (at[1] - a[1]) * dy) / length;
    let across = ((at[0] - a[0]) * dy - (at[1] - a[1]) * dx) / length;
    (0.0..=length).contains(&along) && across.abs() <= 6.0
}

#[test]
fn distance_is_empty_until_value_and_sigma_are_typed() {
    let mut site = demo();
    site.distances.clear();
    let mut desk = Desk::new(site);
    desk.key(Key::Num3);
    let ids: Vec<String> = desk.site().links.iter().filter_map(|link| link.id.clone()).take(2).collect();
    desk.app().pair = [ids[0].clone(), ids[1].clone()];
    desk.harness.run_steps(3);
    assert!(desk.site().distances.is_empty(), "selecting two points adds no distance");
    let label = "measured";
    let field = "the empty field";
    desk.harness.get_all_by_label(label).last().expect(field).focus();
    desk.harness.run_steps(2);
    desk.key(Key::Enter);
    assert!(desk.site().distances.is_empty(), "an empty field adds no distance");
    desk.harness.get_all_by_label(label).last().expect(field).focus();
    desk.harness.run_steps(2);
    desk.harness.event(Event::Text("4.25".into()));
    desk.harness.run_steps(2);
    desk.key(Key::Enter);
    let distances = &desk.site().distances;
    assert_eq!(distances.len(), 1);
    assert_eq!(
        (distances[0].length_m.value, &distances[0].between),
        (4.25, &[ids[0].clone(), ids[1].clone()])
    );
    desk.undo();
    assert!(desk.site().distances.is_empty());
}

#[test]
fn known_length_has_no_effect_until_entered() {
    let mut desk = Desk::new(demo());
    let height =
        |desk: &Desk| desk.harness.state().editor.session().solution().unwrap().position_m.map(|at| at.z);
    let before = (height(&desk), desk.harness.state().editor.session().solution().unwrap().focal_px);
    desk.take("Known length");
    desk.line(0, [700.0, 800.0].into(), [1100.0, 820.0].into());
    let after = (height(&desk), desk.harness.state().editor.session().solution().unwrap().focal_px);
    assert_eq!(before, after);
    let drawn = desk.site().cameras[0].annotations.iter().rfind(|a| a.kind == Kind::KnownLength).unwrap();
    assert!(drawn.off);
}

#[test]
fn sigma_and_scene_can_be_set_per_annotation_and_camera() {
    let mut desk = Desk::new(demo());
    let index = desk.site().cameras[0].annotations.iter().position(|a| a.kind == Kind::Parallel).unwrap();
    let name = calib_core::single::line_name(&desk.site().cameras[0].annotations, index, 0);
    let drawn = |desk: &Desk| desk.site().cameras[0].annotations[index].clone();
    assert!(desk.harness.query_by_label("Exact").is_none());
    desk.harness.get_by_label(&format!("Line {name}")).click_accesskit();
    desk.harness.run_steps(3);
    desk.harness.get_by_label("Exact").click_accesskit();
    desk.harness.run_steps(3);
    assert!(drawn(&desk).exact);
    desk.harness.get_by_label("Reset").click_accesskit();
    desk.harness.run_steps(3);
    assert!(!drawn(&desk).exact && desk.harness.query_by_label("Reset").is_none());
    desk.undo();
    assert!(drawn(&desk).exact);
    desk.undo();
    assert!(!drawn(&desk).exact);
    desk.harness.get_by_role_and_label(Role::ComboBox, "Scene type (camera)").click_accesskit();
    desk.harness.run_steps(3);
    desk.harness.get_by_label("Level floor").click_accesskit();
    desk.harness.run_steps(3);
    let errors = |desk: &Desk, camera: usize| desk.site().scene_errors(&desk.site().cameras[camera]);
    assert!(
        (errors(&desk, 0).floor_tilt.to_degrees() - 0.3).abs() < 1e-9 && errors(&desk, 0).crossfall == 0.0
    );
    assert_eq!(desk.site().cameras[1].scene, None);
    desk.undo();
    assert_eq!(desk.site().cameras[0].scene, None);
}

#[test]
fn known_values_of_the_lens_are_entered_and_removed() {
    let mut desk = Desk::new(demo());
    let lens = |desk: &Desk| desk.site().cameras[0].lens.clone().unwrap_or_default();
    desk.harness.get_by_label("Known values").click_accesskit();
    desk.harness.run_steps(20);
    let enter = |desk: &mut Desk, text: &str| {
        let field = desk.harness.get_by_role_and_label(Role::TextInput, "Data sheet");
        field.focus();
        desk.harness.run_steps(3);
        desk.keys(egui::Modifiers::COMMAND, Key::A);
        desk.harness.event(Event::Text(text.into()));
        desk.harness.run_steps(2);
        desk.key(Key::Enter);
        desk.harness.run_steps(3);
    };
    enter(&mut desk, "2.8 mm");
    assert!(desk.harness.query_by_label_contains("Add the size of the sensor").is_some());
    assert_eq!(lens(&desk).focal_mm, None);
    enter(&mut desk, "2.8 mm 1/2.7");
    assert!(desk.harness.query_by_label_contains("Add the size of the sensor").is_none());
    assert_eq!(lens(&desk).data_sheet().to_string(), "2.8 mm 1/2.7");
    desk.undo();
    assert_eq!(lens(&desk).focal_mm, None);
    desk.harness.get_by_role_and_label(Role::ComboBox, "Principal point").click_accesskit();
    desk.harness.run_steps(3);
    desk.harness.get_by_label("entered with \u{b1}").click_accesskit();
    desk.harness.run_steps(3);
    assert!(lens(&desk).principal_point_px.unwrap().sigma.unwrap() > 1.0);
    desk.harness.get_by_role_and_label(Role::ComboBox, "Pixel aspect").click_accesskit();
    desk.harness.run_steps(3);
    desk.harness.get_by_label("from the lines").click_accesskit();
    desk.harness.run_steps(3);
    assert_eq!(lens(&desk).pixel_aspect, Some(calib_site::PixelAspectEntry::Fit));
}

#[test]
fn warnings_about_pixels_and_slope_have_answers() {
    let mut site = demo();
    site.cameras.truncate(1);
    (site.links, site.marks, site.distances) = (Vec::new(), Vec::new(), Vec::new());
    let camera = &mut site.cameras[0];
    // The same annotations in an image that a recorder has coded with 704 x 576 pixels.
    let [width, height] = camera.size_px.map(f64::from);
    let scaled = |pixel: &mut calib_core::Pixel| {
        (pixel.u, pixel.v) = (pixel.u * 704.0 / width, pixel.v * 576.0 / height);
    };
    for annotation in &mut camera.annotations {
        annotation.segments.iter_mut().flatten().flatten().for_each(scaled);
        annotation.points.iter_mut().flatten().for_each(scaled);
        annotation.foot.iter_mut().chain(&mut annotation.head).for_each(scaled);
    }
    (camera.size_px, camera.efov_px, camera.image) = ([704, 576], None, None);
    (camera.control_points, camera.placement, camera.lens) = (Vec::new(), None, None);
    let mut desk = Desk::new(site);
    let show_all = |desk: &mut Desk| {
        let buttons = desk.harness.query_all_by_role(Role::Button);
        let more =
            buttons.filter(|node| node.accesskit_node().label().is_some_and(|text| text.ends_with(" more")));
        more.for_each(|more| more.click_accesskit());
        desk.harness.run_steps(3);
    };
    show_all(&mut desk);
    desk.harness.get_by_label_contains("Pixel aspect 1.").click_accesskit();
    desk.harness.run_steps(5);
    let aspect = desk.site().cameras[0].lens.as_ref().unwrap().pixel_aspect;
    assert!(matches!(aspect, Some(calib_site::PixelAspectEntry::Known(value)) if value > 1.05));
    assert!(desk.harness.query_by_label_contains("Pixel aspect 1.").is_none(), "the question is answered");
}
