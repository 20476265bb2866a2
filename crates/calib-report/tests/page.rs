//! Tests of the report of the demonstration site: it is self-contained and reproducible.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_report::{EmbeddedImage, ImageRequest, page};
use calib_site::{Measurement, MeasurementKind, MeasurementPoint, Options, Site};

/// Time of the reports: 15 May 2026, in seconds since 1970.
const CREATED: u64 = 1_778_803_200;

fn solved() -> Site {
    let site = calib_demo::demo_site().site;
    site.calibrate(&Options::default()).write_into(&site)
}

fn pictures(shown: ImageRequest<'_>) -> Result<EmbeddedImage, String> {
    match shown {
        ImageRequest::Camera(camera) if camera.id == "store" => Err("store.png: <not there>".into()),
        ImageRequest::Camera(camera) => {
            Ok(EmbeddedImage { href: format!("data:,{}", camera.id), size: camera.size_px })
        }
        ImageRequest::Plan => Ok(EmbeddedImage { href: "data:,plan".into(), size: [1200, 900] }),
    }
}

#[test]
fn every_camera_has_its_image_or_the_reason_why_it_is_missing() {
    let site = solved();
    let html = page(&site, CREATED, None, &mut pictures);
    assert_eq!(html, page(&site, CREATED, None, &mut pictures));
    assert!(html.contains(r#"href="data:,plan" width="1200" height="900" opacity="0.55""#));
    for camera in &site.cameras {
        let section = html.split(&format!("<section id=\"{}\">", camera.id)).nth(1).unwrap();
        let section = &section[..section.find("</section>").unwrap()];
        let is_shown = section.contains(&format!("href=\"data:,{}\"", camera.id));
        let says_why = section.contains("store.png: &lt;not there&gt;");
        assert_eq!((is_shown, says_why), (camera.id != "store", camera.id == "store"), "{}", camera.id);
        assert!(section.contains("<th>Line or point"), "{}", camera.id);
    }
}

#[test]
fn the_summary_names_unusable_cameras_with_their_reason() {
    let mut site = solved();
    let start = |site: &Site| {
        let html = page(site, CREATED, None, &mut pictures);
        let (start, _) = html.split_once("<h2>Numbers</h2>").unwrap();
        start.to_owned()
    };
    let good = start(&site);
    assert!(good.contains("2026-05-15") && good.contains(env!("CARGO_PKG_VERSION")), "{good}");
    assert!(good.contains(">6 good<") && !good.contains(" check<") && !good.contains(" bad<"), "{good}");
    // The floor error of the first camera is too large, and the second camera has no result.
    let sigma = site.cameras[0].solution.as_mut().unwrap().sigma.as_mut().unwrap();
    sigma.floor_length_rel = Some(0.05);
    site.cameras[1].solution = None;
    // A floor error above 100 % is not shown as a number, but the camera counts as bad.
    let sigma = site.cameras[2].solution.as_mut().unwrap().sigma.as_mut().unwrap();
    sigma.floor_length_rel = Some(1.3);
    let found = start(&site);
    assert!(found.contains("3 good") && found.contains("1 check") && found.contains("2 bad"), "{found}");
    assert!(found.contains("uncertain by \u{b1} 5.0 %") && found.contains("Not solved."), "{found}");
    // Without a scale, no camera of the joint solve is good.
    site.solution.as_mut().unwrap().scale = Some(calib_site::Scale::Unknown);
    let found = start(&site);
    assert!(found.contains("The scale is unknown") && !found.contains("3 good"), "{found}");
}

#[test]
fn measurements_are_listed_with_their_values() {
    let mut site = solved();
    assert!(!page(&site, CREATED, None, &mut pictures).contains("<h2>Measurements</h2>"));
    let id = site.cameras[0].id.clone();
    let points = [[800.0, 800.0], [1200.0, 820.0]].map(|px| MeasurementPoint::new(id.clone(), px.into()));
    let length = Measurement::new(MeasurementKind::Length, points.to_vec());
    let value = site.measure(&length).unwrap().value;
    let sky = MeasurementPoint::new(id, [800.0, -4000.0].into());
    let above = Measurement { points: vec![points[0].clone(), sky], ..length.clone() };
    site.measurements = vec![length, above];
    let html = page(&site, CREATED, None, &mut pictures);
    let (_, section) = html.split_once("<h2>Measurements</h2>").unwrap();
    let (section, _) = section.split_once("</table>").unwrap();
    assert!(
        section.contains("length 1") && section.contains(&format!("<td class=why>{value:.1}")),
        "{section}"
    );
    // A measurement without a value has the reason.
    assert!(section.contains("length 2") && section.contains("is outside the image"), "{section}");
}

#[test]
fn the_page_loads_nothing_and_runs_no_scripts() {
    let html = page(&solved(), CREATED, None, &mut pictures);
    assert!(html.contains("default-src 'none'"));
    for fetched in ["src=\"http", "href=\"http", "<script", "<link", "url("] {
        assert!(!html.contains(fetched), "{fetched}");
    }
}
