//! One command opens files of every kind: their content decides.

use std::io::Cursor;

use calib_app::choice::{Chosen, Purpose};
use calib_app::command::Command;
use calib_editor::Pane;
use calib_site::Site;
use calib_tests::Scratch;
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{Desk, demo, still};

/// Opens files of a folder as dropped files, and waits until they are read.
fn open(desk: &mut Desk, scratch: &Scratch, names: &[&str]) {
    let ctx = desk.harness.ctx.clone();
    desk.app().open_paths(&ctx, names.iter().map(|name| scratch.path(name)));
    desk.wait(|app| !app.is_working());
    desk.harness.run_steps(3);
}

fn note(desk: &Desk) -> String {
    desk.harness.state().editor.session().note.clone().unwrap_or_default()
}

fn error(desk: &Desk) -> String {
    desk.harness.state().editor.error().unwrap_or_default().to_owned()
}

fn jpeg() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image::RgbImage::new(64, 48).write_to(&mut bytes, image::ImageFormat::Jpeg).unwrap();
    bytes.into_inner()
}

#[test]
fn folder_opens_its_images_and_names_the_other_files() {
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path("shop")).unwrap();
    still(&scratch, "shop/a.png", [64, 48]);
    scratch.write("shop/b.dat", jpeg());
    scratch.write("shop/readme.txt", "no image");
    scratch.write("shop/.hidden", "");
    let mut desk = Desk::new(Site::new());
    open(&mut desk, &scratch, &["shop"]);
    let ids: Vec<&str> = desk.site().cameras.iter().map(|camera| camera.id.as_str()).collect();
    assert_eq!(ids, ["a", "b"], "{}", error(&desk));
    assert!(note(&desk).contains("readme.txt") && !note(&desk).contains("hidden"), "{}", note(&desk));
    std::fs::create_dir(scratch.path("empty")).unwrap();
    open(&mut desk, &scratch, &["empty"]);
    assert!(error(&desk).contains("empty"), "{}", error(&desk));
}

#[test]
fn image_opened_on_an_empty_plan_becomes_the_plan() {
    let scratch = Scratch::new();
    for name in ["camera.png", "plan.png", "second.png"] {
        still(&scratch, name, [64, 48]);
    }
    let mut desk = Desk::new(Site::new());
    open(&mut desk, &scratch, &["camera.png"]);
    desk.key(Key::Num2);
    open(&mut desk, &scratch, &["plan.png"]);
    let plan = desk.site().plan.clone().unwrap();
    assert!(plan.image.unwrap().ends_with("plan.png"));
    assert_eq!(desk.site().cameras.len(), 1);
    desk.undo();
    assert!(desk.site().plan.is_none());
    desk.redo();
    // A plan is never replaced by accident.
    open(&mut desk, &scratch, &["second.png"]);
    assert_eq!(desk.site().cameras.len(), 2);
}

#[test]
fn files_of_other_programs_are_imported() {
    let scratch = Scratch::new();
    scratch.write(
        "calibration.yml",
        "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\n\
         camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 60., 0., 32., 0., 60., 24., 0., 0., 1. ]\n\
         distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.01, 0., 0., 0. ]\n",
    );
    scratch.write("points.csv", "name,lat_deg,lon_deg\nhydrant,48.137154,11.576124\n");
    for order in [["calibration.yml", "points.csv"], ["points.csv", "calibration.yml"]] {
        let mut desk = Desk::new(Site::new());
        // No format consists of both files, so each file is imported alone.
        open(&mut desk, &scratch, &order);
        assert_eq!(error(&desk), "");
        let lens = desk.site().cameras[0].lens.clone().unwrap();
        assert_eq!(lens.focal_px.unwrap().value, 60.0);
        let points: Vec<_> = desk.site().ground_points.iter().map(|point| point.name.clone()).collect();
        assert_eq!(points.len(), 1, "{points:?}");
    }
    // An image and its lens: the lens belongs to the camera of the image, and not to the selected camera.
    still(&scratch, "calibration.png", [64, 48]);
    for site in [Site::new(), demo()] {
        let count = site.cameras.len();
        let first = site.cameras.first().map(|camera| camera.lens.clone());
        let mut desk = Desk::new(site);
        open(&mut desk, &scratch, &["calibration.yml", "calibration.png"]);
        assert_eq!(desk.site().cameras.len(), count + 1, "{}", error(&desk));
        let lens = desk.site().cameras[count].lens.clone();
        assert_eq!(lens.and_then(|lens| lens.focal_px).map(|focal| focal.value), Some(60.0));
        if let Some(first) = first {
            assert_eq!(desk.site().cameras[0].lens, first);
        }
    }
}

#[test]
fn site_opens_with_its_images_and_names_other_files() {
    let scratch = Scratch::new();
    still(&scratch, "a.png", [64, 48]);
    still(&scratch, "other.png", [64, 48]);
    let site = r#"{"cameras": [{"id": "a", "image": "a.png", "size_px": [64, 48]}], "version": 1, "format": "calib-site"}"#;
    scratch.write("site.json", site);
    let mut desk = Desk::new(Site::new());
    open(&mut desk, &scratch, &["a.png", "other.png", "site.json"]);
    assert_eq!(desk.site().cameras.len(), 1, "{}", error(&desk));
    assert!(note(&desk).contains("other.png") && !note(&desk).contains("a.png,"), "{}", note(&desk));
    // In a file with sorted keys, the format is after the cameras. A damaged site file does not change the open site.
    let padding = " ".repeat(70_000);
    let sorted =
        site.replace("\"image\": \"a.png\", ", "").replace("\"version\"", &format!("{padding}\"version\""));
    scratch.write("sorted", &sorted);
    open(&mut desk, &scratch, &["sorted"]);
    assert!(desk.site().cameras[0].image.is_none(), "{}", error(&desk));
    scratch.write("damaged.json", site.replace("64, 48", "64"));
    open(&mut desk, &scratch, &["damaged.json", "a.png"]);
    assert!(error(&desk).contains("size_px"), "{}", error(&desk));
    scratch.write("formless.json", r#"{"version": 1, "cameras": []}"#);
    open(&mut desk, &scratch, &["formless.json"]);
    assert!(error(&desk).contains("format"), "{}", error(&desk));
    // The page has the content of the files, and no paths.
    let loose = |name: &str| Chosen {
        name: name.into(),
        path: None,
        bytes: Some(std::fs::read(scratch.path(name)).unwrap()),
    };
    let ctx = desk.harness.ctx.clone();
    desk.app().open_site(Site::new(), calib_app::storage::files::Images::default(), None);
    desk.app().open_files(&ctx, vec![loose("a.png"), loose("site.json")]);
    desk.harness.run_steps(3);
    assert!(desk.site().cameras[0].image.as_ref().unwrap().starts_with("stored:"));
}

#[test]
fn other_files_are_refused_with_a_way_out() {
    let scratch = Scratch::new();
    scratch.write("notes.txt", "some notes");
    scratch.write("photo.bin", b"\0\0\0\x18ftypavif\0\0\0\0");
    scratch.write("other.json", "{\"a\": 1}");
    scratch.write("BM1.csv", "BM1;48.1;11.5\n");
    for (name, expected) in
        [("notes.txt", "Cannot open"), ("photo.bin", "JPEG"), ("other.json", "Cannot open")]
    {
        let mut desk = Desk::new(Site::new());
        open(&mut desk, &scratch, &[name]);
        let shown = error(&desk);
        assert!(
            shown.contains(expected) && shown.contains(name.split('.').next().unwrap()),
            "{name}: {shown}"
        );
        assert!(desk.site().cameras.is_empty());
    }
}

#[test]
fn open_command_takes_any_file() {
    let scratch = Scratch::new();
    still(&scratch, "a.png", [64, 48]);
    let mut desk = Desk::new(Site::new());
    desk.answer(Some(scratch.path("a.png")));
    desk.tell(Command::Open);
    desk.wait(|app| !app.editor.site().cameras.is_empty());
    assert_eq!(desk.site().cameras[0].id, "a");
}

#[test]
fn images_opened_together_are_one_undo_step() {
    let scratch = Scratch::new();
    let names = ["a.png", "b.png", "c.png", "later.png"];
    for name in names {
        still(&scratch, name, [64, 48]);
    }
    let mut desk = Desk::new(Site::new());
    open(&mut desk, &scratch, &names[..3]);
    open(&mut desk, &scratch, &names[3..]);
    let count = |desk: &Desk| desk.site().cameras.len();
    assert_eq!(count(&desk), 4);
    desk.undo();
    assert_eq!(count(&desk), 3);
    assert_eq!(desk.app().editor.session().history.undo_name(), Some("add 3 images"));
    desk.undo();
    assert_eq!(count(&desk), 0);
    desk.redo();
    assert_eq!(count(&desk), 3);
    // A refused image does not remove the others of its batch.
    let ctx = desk.harness.ctx.clone();
    let png = std::fs::read(scratch.path("a.png")).unwrap();
    let loose = |name: &str| Chosen { name: name.into(), path: None, bytes: Some(png.clone()) };
    desk.app().open_files(&ctx, vec![loose("d.png"), loose("bad\u{7}.png"), loose("e.png")]);
    desk.wait(|app| !app.is_working());
    assert_eq!(count(&desk), 5, "{}", error(&desk));
}

#[test]
fn typed_names_get_an_extension() {
    let scratch = Scratch::new();
    let mut desk = Desk::new(demo());
    for (purpose, name, written) in [
        (Purpose::SaveSite, "shop", "shop.json"),
        (Purpose::SaveReport, "report", "report.html"),
        (Purpose::SavePlain, "plain.json", "plain.json"),
    ] {
        desk.app().type_path(purpose);
        desk.harness.run_steps(2);
        desk.app().dialogs.path_field.as_mut().unwrap().text = scratch.path(name).display().to_string();
        desk.key(Key::Enter);
        desk.harness.run_steps(3);
        assert!(scratch.path(written).is_file(), "{written}: {}", error(&desk));
    }
    // An existing file is not replaced without confirmation if its extension was not typed.
    scratch.write("other.json", "keep");
    desk.app().type_path(Purpose::SavePlain);
    desk.harness.run_steps(2);
    desk.app().dialogs.path_field.as_mut().unwrap().text = scratch.path("other").display().to_string();
    desk.key(Key::Enter);
    desk.harness.run_steps(3);
    assert_eq!(std::fs::read_to_string(scratch.path("other.json")).unwrap(), "keep");
    desk.key(Key::Enter);
    desk.harness.run_steps(3);
    assert_ne!(std::fs::read_to_string(scratch.path("other.json")).unwrap(), "keep", "{}", error(&desk));
}

#[test]
fn commands_are_found_by_other_words() {
    for (typed, expected) in [
        ("delete camera", "Remove this camera"),
        ("blind", "Show or hide the pixel density on the plan"),
        ("photo", "Add images\u{2026}"),
        ("load", "Open\u{2026}"),
        ("imperial", "Switch between metres and feet"),
    ] {
        let mut desk = Desk::new(demo());
        let is_shown = |desk: &Desk| desk.words().iter().any(|word| word.starts_with(expected));
        assert!(!is_shown(&desk), "{expected} is always shown");
        desk.keys(Modifiers::COMMAND, Key::K);
        desk.harness.event(egui::Event::Text(typed.into()));
        desk.harness.run_steps(3);
        assert!(is_shown(&desk), "{typed}: {:?}", desk.words());
    }
}

#[test]
fn zoom_of_an_image_has_limits() {
    let mut desk = Desk::new(demo());
    let zoom = |desk: &Desk| {
        let pane = Pane::Image(0);
        f64::from(desk.screen(pane, [1.0, 0.0]).x - desk.screen(pane, [0.0, 0.0]).x)
    };
    for (command, limit) in [(Command::ZoomIn, 64.0), (Command::ZoomOut, 0.05)] {
        for _ in 0..60 {
            desk.tell(command);
        }
        let found = zoom(&desk);
        assert!((found / limit - 1.0).abs() < 0.02, "{found} instead of {limit}");
    }
}

/// Starts a server that sends an image for every request with the user name "admin" and the password "secret".
/// Returns its address without scheme.
fn camera() -> String {
    use std::io::{BufRead as _, BufReader, Write as _};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let mut jpeg = Vec::new();
    let image = image::RgbImage::from_pixel(64, 48, image::Rgb([90, 120, 150]));
    image.write_with_encoder(image::codecs::jpeg::JpegEncoder::new(&mut jpeg)).unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let lines = BufReader::new(stream.try_clone().unwrap()).lines();
            let head: Vec<String> = lines.map_while(Result::ok).take_while(|line| !line.is_empty()).collect();
            let is_allowed = head.iter().any(|line| line.ends_with("Basic YWRtaW46c2VjcmV0"));
            let (status, body) =
                if is_allowed { ("200 OK", &jpeg[..]) } else { ("401 Unauthorized", &[][..]) };
            let challenge = "WWW-Authenticate: Basic realm=\"camera\"\r\nConnection: close";
            let head = format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\n{challenge}\r\n\r\n", body.len());
            // A client may not read the whole answer.
            let _ = stream.write_all(&[head.as_bytes(), body].concat());
        }
    });
    address
}

#[test]
fn the_address_of_a_camera_gives_an_image() {
    let address = camera();
    let mut desk = Desk::new(Site::new());
    desk.tell(Command::AddFromAddress);
    desk.harness.run_steps(3);
    assert!(desk.harness.get_by_label("Address").is_focused(), "the address has the focus");
    let enter = |desk: &mut Desk, field: &str, text: &str| {
        desk.harness.get_by_label(field).focus();
        desk.harness.run_steps(2);
        desk.harness.get_by_label(field).type_text(text);
        desk.harness.run_steps(2);
    };
    enter(&mut desk, "Address", &format!("http://{address}/snapshot.jpg"));
    desk.harness.get_by_label("Get the image").click();
    let mut answer = None;
    for _ in 0..600 {
        desk.harness.step();
        answer = desk.words().into_iter().find(|word| word.contains("requires a user name"));
        if answer.is_some() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    assert!(answer.is_some(), "{:?}", desk.words());
    enter(&mut desk, "User name", "admin");
    enter(&mut desk, "Password", "secret");
    enter(&mut desk, "Camera", "door");
    desk.harness.get_by_label("Get the image").click();
    desk.wait(|app| app.editor.site().cameras.len() == 1 && !app.is_working());
    let camera = &desk.site().cameras[0];
    assert_eq!((camera.id.as_str(), camera.size_px), ("door", [64, 48]));
    assert!(!desk.site().to_json().contains("secret"));
}
