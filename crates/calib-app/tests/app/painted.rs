//! Painted text and shapes without accessibility nodes: tags, focus rings, numbers next to views.

use calib_app::command::Command;
use calib_app::state::{App, Mode, Place};
use calib_app::theme;
use calib_core::{Kind, Pixel};
use calib_editor::{Pane, PlanHandle, plan_handles};
use calib_site::{Link, LinkObservation, Mark, Site};
use egui::{Key, Modifiers, Pos2, Rect, Shape, Vec2};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{Desk, demo};

/// Returns every text on the screen with its position.
fn texts(desk: &Desk) -> Vec<(String, Pos2)> {
    let mut found = Vec::new();
    for clipped in &desk.harness.output().shapes {
        visit(&clipped.shape, &mut |shape| {
            if let Shape::Text(text) = shape
                && clipped.clip_rect.intersects(text.visual_bounding_rect())
            {
                found.push((text.galley.text().to_owned(), text.pos));
            }
        });
    }
    found
}

/// Returns every rectangle outline of a colour.
fn outlines(desk: &Desk, colour: egui::Color32) -> Vec<Rect> {
    let mut found = Vec::new();
    for clipped in &desk.harness.output().shapes {
        visit(&clipped.shape, &mut |shape| {
            if let Shape::Rect(rect) = shape
                && rect.stroke.color == colour
                && rect.stroke.width > 0.0
            {
                found.push(rect.rect);
            }
        });
    }
    found
}

fn visit(shape: &Shape, take: &mut dyn FnMut(&Shape)) {
    match shape {
        Shape::Vec(shapes) => shapes.iter().for_each(|shape| visit(shape, take)),
        shape => take(shape),
    }
}

/// Returns the demonstration without control points, so that cameras are placed by hand.
fn by_hand() -> Site {
    let mut site = demo();
    site.cameras.iter_mut().for_each(|camera| camera.control_points.clear());
    site
}

fn words(desk: &Desk) -> String {
    desk.words().join("\n")
}

#[test]
fn links_and_marks_are_labelled_in_every_view() {
    let mut site = demo();
    let named =
        |(i, mark): (usize, &Mark)| Mark { id: Some(format!("M{}", i + 1)), name: None, ..mark.clone() };
    site.marks = site.marks.iter().enumerate().map(named).collect();
    let marks = site.marks.len();
    let is_point = |link: &&Link| link.seen.iter().all(|seen| seen.px.is_some());
    let link = site.links.iter().find(is_point).unwrap().clone();
    let seen = [(0, 700.0), (1, 900.0)].map(|(camera, u)| LinkObservation {
        camera: site.cameras[camera].id.clone(),
        px: Some(Pixel::new(u, 600.0)),
        ..link.seen[0].clone()
    });
    site.links = vec![Link { id: Some("L1".into()), seen: seen.to_vec(), ..link }];
    let mut desk = Desk::new(site);
    desk.key(Key::Num3);
    desk.harness.run_steps(3);
    let within = |desk: &Desk, name: &str| -> Vec<usize> {
        let panes = &desk.harness.state().view.panes;
        let said: Vec<Pos2> =
            texts(desk).into_iter().filter(|(text, _)| text == name).map(|(_, at)| at).collect();
        let shows = |camera: &usize| {
            let rect = panes.rects.get(&(Place::Tile, Pane::Image(*camera)));
            rect.is_some_and(|rect| said.iter().any(|at| rect.contains(*at)))
        };
        (0..desk.site().cameras.len()).filter(shows).collect()
    };
    assert_eq!(within(&desk, "L1"), [0, 1]);
    let in_two = (1..=marks).find(|i| within(&desk, &format!("M{i}")).len() > 1);
    assert!(in_two.is_some(), "no mark is labelled in two views: {:?}", texts(&desk));
}

#[test]
fn focused_view_has_a_ring() {
    let mut desk = Desk::new(demo());
    let accent = theme::palette(&desk.harness.ctx).accent;
    for view in ["View Image", "View Plan", "View All cameras", "View Scene"] {
        let rect = desk.harness.get_by_label(view).rect();
        let has_ring = |desk: &Desk| {
            outlines(desk, accent).iter().any(|ring| ring.center().distance(rect.center()) < 2.0)
        };
        assert!(!has_ring(&desk), "{view} before");
        desk.harness.get_by_label(view).focus();
        desk.harness.run_steps(2);
        assert!(has_ring(&desk), "{view}");
    }
}

#[test]
fn enter_ends_a_line_while_alt_is_pressed() {
    let mut desk = Desk::new(demo());
    let straight = |desk: &Desk| {
        let all = desk.site().cameras[0].annotations.iter().filter(|a| a.kind == Kind::Straight);
        all.map(|a| a.polylines().count()).sum::<usize>()
    };
    let before = straight(&desk);
    desk.take("Straight edge");
    for at in [[300.0, 400.0], [700.0, 402.0], [1100.0, 400.0]] {
        desk.click(Pane::Image(0), at);
    }
    assert!(!desk.harness.state().editor.tool().is_idle(), "the line is under way");
    desk.keys(Modifiers::ALT, Key::Enter);
    assert_eq!(straight(&desk), before + 1);
    assert!(desk.harness.state().editor.tool().is_idle());
}

#[test]
fn selected_straight_edge_shows_the_residual_of_each_point() {
    let mut site = demo();
    let camera = site.cameras[0].clone();
    let line = |v: f64| (0..7).map(|i| Pixel::new(300.0 + 200.0 * f64::from(i), v)).collect::<Vec<_>>();
    let mut drawn = line(500.0);
    drawn[4].v += 9.0;
    let any = camera.annotations[0].clone();
    let straight =
        calib_core::Annotation { kind: Kind::Straight, segments: None, points: Some(drawn), ..any };
    site.cameras[0].annotations.push(straight);
    let mut desk = Desk::new(site);
    let annotation = desk.site().cameras[0].annotations.len() - 1;
    let said = |desk: &Desk| -> Vec<f64> {
        let off = |word: String| {
            word.strip_prefix("Point ")?.split(' ').nth(2)?.replace('\u{2212}', "-").parse().ok()
        };
        let mut all: Vec<f64> = desk.words().into_iter().filter_map(off).collect();
        all.truncate(7);
        all
    };
    assert!(said(&desk).is_empty(), "no line is selected");
    desk.app().act(calib_editor::Action::Select(calib_editor::Part::Line { annotation, segment: 0 }));
    desk.harness.run_steps(2);
    let off = said(&desk);
    let worst = (0..off.len()).max_by(|&a, &b| off[a].abs().total_cmp(&off[b].abs()));
    assert_eq!((off.len(), worst), (7, Some(4)), "{off:?}");
}

/// Returns the zoom shown next to the name of the selected camera, and the true zoom of its pane.
fn zoom(desk: &Desk, place: Place) -> (String, f64) {
    let id = &desk.site().cameras[0].id;
    let said = desk.words().into_iter().find(|word| word.starts_with(&format!("{id} at "))).unwrap();
    let mapping = desk.harness.state().view.panes.mapping(place, Pane::Image(0)).unwrap();
    let points = mapping.screen([1.0, 0.0]).distance(mapping.screen([0.0, 0.0]));
    (said, f64::from(points * desk.harness.ctx.pixels_per_point()))
}

#[test]
fn hundred_percent_is_one_image_pixel_per_screen_pixel() {
    for (pixels_per_point, key, place) in
        [(1.0, Key::Num1, Place::Main), (2.0, Key::Num1, Place::Main), (1.0, Key::Num2, Place::Half)]
    {
        let mut desk = Desk::new(demo());
        desk.harness.set_pixels_per_point(pixels_per_point);
        desk.key(key);
        desk.harness.run_steps(3);
        let (said, shown) = zoom(&desk, place);
        assert!(said.ends_with(&format!(" {:.0} %", 100.0 * shown)), "{said}, shown at {shown}");
        let at = (place, Pane::Image(0));
        desk.app().view.panes.views.get_mut(&at).unwrap().zoom = 1.0 / f64::from(pixels_per_point);
        desk.harness.run_steps(2);
        let (said, shown) = zoom(&desk, place);
        assert!(said.ends_with(" 100 %") && (shown - 1.0).abs() < 1e-3, "{said}, shown at {shown}");
    }
}

/// Returns the text about another camera in the agreement panel of the plan view.
fn agreement(desk: &Desk, id: &str) -> Option<String> {
    desk.words().into_iter().find(|word| word.starts_with(&format!("{id}: overlap ")))
}

#[test]
fn plan_shows_the_agreement_of_every_pair_before_and_after() {
    let mut desk = Desk::new(by_hand());
    desk.key(Key::Num2);
    desk.harness.run_steps(2);
    let ids: Vec<String> = desk.site().cameras.iter().map(|camera| camera.id.clone()).collect();
    let shown: Vec<&String> = ids.iter().filter(|id| agreement(&desk, id).is_some()).collect();
    assert!(!shown.is_empty(), "{}", words(&desk));
    let linked =
        shown.iter().find(|id| !agreement(&desk, id).unwrap().contains("no link")).unwrap().to_string();
    assert!(!agreement(&desk, &linked).unwrap().contains('\u{2192}'), "no camera was moved");
    // While a foot is dragged, both error values are shown, and the tag shows the distance.
    desk.take("Select");
    let to = drag_handle(&mut desk, PlanHandle::Foot, Vec2::new(60.0, 40.0));
    let during = agreement(&desk, &linked).unwrap();
    assert!(during.contains(" \u{2192} "), "{during}");
    assert!(texts(&desk).iter().any(|(text, _)| text.starts_with("moved ")));
    assert!(words(&desk).contains(" disagrees by "), "the wrong position causes a warning: {}", words(&desk));
    desk.release(to, Modifiers::NONE);
    desk.harness.run_steps(2);
    // One click selects the worst link in every view.
    let says = |text: &str| text.contains(" disagrees by ");
    let nodes = desk.harness.get_all_by(|node| node.value().or(node.label()).is_some_and(|text| says(&text)));
    let apart = nodes.last().unwrap().rect().center().y;
    let below = |node: &egui_kittest::Node| node.rect().center().y - apart;
    let shows = desk.harness.get_all_by_label("Show").filter(|node| below(node) > 0.0);
    shows.min_by(|a, b| below(a).total_cmp(&below(b))).unwrap().click();
    desk.harness.run_steps(3);
    assert_eq!(desk.app().view.mode, Mode::All);
    let selected = &desk.app().editor.session().selection;
    assert!(selected.iter().any(|part| matches!(part, calib_editor::Part::Link { .. })), "{selected:?}");
}

/// Drags a plan handle of the first camera, and does not release it. Returns the position of the pointer.
fn drag_handle(desk: &mut Desk, wanted: PlanHandle, by: Vec2) -> Pos2 {
    let handles = plan_handles(desk.app().editor.session(), 0);
    let (_, at) = handles.into_iter().find(|(handle, _)| *handle == wanted).unwrap();
    let from = desk.screen(Pane::Plan, at);
    desk.harness.event(egui::Event::PointerMoved(from));
    desk.press(from, Modifiers::NONE);
    desk.harness.event(egui::Event::PointerMoved(from + by));
    desk.harness.run_steps(2);
    from + by
}

#[test]
fn rotation_handle_shows_the_change_and_the_old_value() {
    let mut desk = Desk::new(by_hand());
    desk.key(Key::Num2);
    desk.take("Select");
    drag_handle(&mut desk, PlanHandle::Rotate, Vec2::new(50.0, 30.0));
    let tag = texts(&desk).into_iter().find(|(text, _)| text.starts_with("yaw ") && text.contains(", was "));
    assert!(tag.is_some(), "{:?}", texts(&desk));
}

#[test]
fn every_number_of_a_placed_camera_has_a_sigma_and_a_lock() {
    let mut desk = Desk::new(by_hand());
    desk.key(Key::Num2);
    desk.harness.run_steps(2);
    for number in ["x", "y", "rotation", "height", "pitch", "roll", "focal length"] {
        assert!(
            desk.harness.query_by_label(&format!("Fix the {number}")).is_some(),
            "{number}: {}",
            words(&desk)
        );
    }
    // A placement by hand has an unknown uncertainty, and the panel shows it.
    assert_eq!(desk.words().iter().filter(|word| *word == "\u{b1} ?").count() / 2, 3, "x, y and rotation");
    let press = |desk: &mut Desk, label: &str| {
        desk.harness.get_by_label(label).click();
        desk.harness.run_steps(2);
    };
    press(&mut desk, "Fix the height");
    let held = desk.site().cameras[0].height_m.unwrap();
    let z = desk.app().editor.session().solution().unwrap().position_m.unwrap().z;
    assert!(held.fixed && (held.value - z).abs() < 0.01, "{held:?}, {z}");
    press(&mut desk, "Fix the focal length");
    assert!(desk.site().cameras[0].lens.as_ref().unwrap().focal_px.unwrap().fixed);
    let held = |desk: &Desk| {
        let placement = desk.site().cameras[0].placement.clone().unwrap();
        (placement.fixed, [placement.held.x, placement.held.y, placement.held.turn])
    };
    press(&mut desk, "Fix the rotation");
    assert_eq!(held(&desk), (false, [false, false, true]));
    press(&mut desk, "Fix the x");
    assert_eq!(held(&desk), (false, [true, false, true]));
    assert_eq!(desk.words().iter().filter(|word| *word == "\u{b1} ?").count() / 2, 1, "only y is unknown");
    press(&mut desk, "Unfix the rotation");
    assert_eq!(held(&desk), (false, [true, false, false]));
    desk.undo();
    assert_eq!(held(&desk), (false, [true, false, true]), "undone");
    press(&mut desk, "Unfix the height");
    assert_eq!(desk.site().cameras[0].height_m, None);
    // In a fully fixed placement, each number can be released separately.
    press(&mut desk, "Fix here");
    assert!(held(&desk).0);
    press(&mut desk, "Unfix the y");
    assert_eq!(held(&desk), (false, [true, false, true]));
    assert!(desk.site().cameras[0].height_m.is_some_and(|height| height.fixed));
}

#[test]
fn site_warning_selects_its_subject() {
    let mut site = demo();
    let wrong = site.links.iter().rposition(|link| link.seen.len() > 2 && link.seen[0].px.is_some()).unwrap();
    site.links[wrong].seen[0].px.as_mut().unwrap().u += 150.0;
    let mut desk = Desk::new(site);
    desk.refine();
    desk.key(Key::Num3);
    desk.harness.run_steps(3);
    let report = desk.app().editor.session().solved.joint_report().unwrap().clone();
    assert!(!report.site.warnings.is_empty(), "the link is rejected and reported");
    // The button may be below the visible part of the panel.
    desk.harness.get_all_by_label("Show").last().unwrap().click_accesskit();
    desk.harness.run_steps(3);
    let selected: Vec<usize> = desk
        .app()
        .editor
        .session()
        .selection
        .iter()
        .filter_map(|part| match part {
            calib_editor::Part::Link { link, .. } => Some(*link),
            _ => None,
        })
        .collect();
    assert_eq!(selected, [wrong], "{:?}", report.site.warnings);
}

#[test]
fn singular_is_used_for_one() {
    let mut site = demo();
    site.cameras.truncate(1);
    (site.links, site.marks, site.distances) = (Vec::new(), Vec::new(), Vec::new());
    site.cameras[0].control_points.truncate(1);
    site.cameras[0].annotations.retain(|annotation| annotation.kind == Kind::Vertical);
    let mut desk = Desk::new(site);
    desk.tell(Command::Export);
    desk.harness.run_steps(4);
    let mut said = words(&desk);
    for key in [Key::Escape, Key::Num2, Key::Num3, Key::Num4] {
        desk.key(key);
        desk.harness.run_steps(2);
        said += &words(&desk);
    }
    let is_many =
        |word: &str| word.ends_with('s') && !word.ends_with("ss") && word.chars().all(char::is_alphabetic);
    let pairs: Vec<&str> = said.lines().collect();
    for line in pairs {
        let words: Vec<&str> = line.split([' ', ',', '.', ':']).collect();
        let wrong = words.windows(2).find(|pair| pair[0] == "1" && is_many(pair[1]) && pair[1].len() > 2);
        assert!(wrong.is_none(), "{line}");
    }
}

/// Tests of the site storage (shelf), and of the stored sites on the start page.
mod start {
    use super::*;
    use calib_app::storage::autosave::{Entry, News, Shelf, Work};
    use egui_kittest::Harness;
    use std::cell::RefCell;
    use std::rc::Rc;

    /// Storage for tests: the stored sites, and the thumbnail of every call of `keep`.
    #[derive(Debug)]
    struct Kept(Vec<Entry>, Rc<RefCell<Vec<Option<String>>>>);

    impl Shelf for Kept {
        fn entries(&self) -> Vec<Entry> {
            self.0.clone()
        }
        fn keep(&mut self, work: Work<'_>) {
            self.1.borrow_mut().push(work.thumbnail.map(str::to_owned));
        }
        fn begin(&mut self) {}
        fn open(&mut self, _: &str) {}
        fn remove(&mut self, _: &str) {}
        fn news(&mut self) -> Option<News> {
            None
        }
        fn is_behind(&self) -> bool {
            false
        }
    }

    #[test]
    fn site_is_kept_with_its_first_image() {
        let mut png = std::io::Cursor::new(Vec::new());
        image::RgbImage::new(1920, 1080).write_to(&mut png, image::ImageFormat::Png).unwrap();
        let (mut site, mut images) = (demo(), calib_editor::Images::default());
        site.cameras[0].image = Some(images.store(png.into_inner().into(), "image/png", None));
        let mut desk = Desk::with(site, images);
        let told = Rc::default();
        desk.app().storage.shelf = Some(Box::new(Kept(Vec::new(), Rc::clone(&told))));
        desk.wait(|app| app.pictures.loading() == 0);
        desk.take("Vertical");
        desk.line(0, Pixel::new(400.0, 300.0), Pixel::new(402.0, 500.0));
        desk.harness.run_steps(2);
        let told: Vec<Option<String>> = told.take();
        let last = told.last().cloned().flatten().expect("a thumbnail");
        assert!(last.starts_with("data:image/jpeg;base64,") && last.len() < 20_000, "{}", last.len());
    }

    #[test]
    fn kept_site_shows_image_time_and_camera_count() {
        let mut png = std::io::Cursor::new(Vec::new());
        image::RgbImage::from_pixel(168, 104, image::Rgb([200, 30, 30]))
            .write_to(&mut png, image::ImageFormat::Png)
            .unwrap();
        let entry = Entry {
            id: "a".into(),
            name: "Shelter".into(),
            cameras: 1,
            bytes: 250_000,
            when: "2 hours ago".into(),
            last: "draw V3".into(),
            thumbnail: Some(calib_editor::data_uri("image/png", png.get_ref())),
        };
        let mut app = App::new(&egui::Context::default(), None);
        app.storage.shelf = Some(Box::new(Kept(vec![entry], Rc::default())));
        let mut harness = Harness::builder()
            .with_size([1440.0, 900.0])
            .with_context_setup(theme::install)
            .build_ui_state(|ui, app: &mut App| app.show_ui(ui), app);
        for _ in 0..200 {
            harness.step();
            std::thread::sleep(std::time::Duration::from_millis(5));
            if harness.state().pictures.loading() == 0 && harness.state().pictures.ready("a 250000").is_some()
            {
                break;
            }
        }
        harness.run_steps(2);
        assert!(harness.state().pictures.ready("a 250000").is_some(), "its image is decoded");
        let desk = Desk { harness };
        let said = words(&desk);
        assert!(said.contains("1 site, 0.2 MB") || said.contains("1 site, 0.3 MB"), "{said}");
        assert!(said.contains("1 camera, 2 hours ago"), "{said}");
    }
}

#[test]
fn borders_of_the_density_levels_are_in_the_image() {
    let mut desk = Desk::new(demo());
    let borders = |desk: &Desk| -> Vec<String> {
        texts(desk)
            .into_iter()
            .map(|(text, _)| text)
            .filter(|text| text.contains("px/m, border \u{b1} "))
            .collect()
    };
    assert!(borders(&desk).is_empty());
    desk.tell(Command::Coverage);
    let shown = borders(&desk);
    assert!(shown.iter().any(|text| text.starts_with("recognise: 125 px/m, border \u{b1} ")), "{shown:?}");
    // A floor of unknown scale has no pixels per metre.
    let mut site = demo();
    site.cameras.truncate(1);
    let camera = &mut site.cameras[0];
    (camera.placement, camera.height_m) = (None, None);
    camera.control_points.clear();
    camera.annotations.retain(|annotation| {
        !matches!(annotation.kind, Kind::Upright | Kind::KnownLength | Kind::EqualLength)
    });
    site.links.clear();
    site.marks.clear();
    let mut desk = Desk::new(site);
    desk.tell(Command::Coverage);
    assert!(borders(&desk).is_empty());
}
