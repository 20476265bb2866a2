//! Tests of the report of the demonstration site: it is self-contained and reproducible.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_report::{EmbeddedImage, ImageRequest, page};
use calib_site::{Options, Site};

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
    let html = page(&site, None, &mut pictures);
    assert_eq!(html, page(&site, None, &mut pictures));
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
fn the_page_loads_nothing_and_runs_no_scripts() {
    let html = page(&solved(), None, &mut pictures);
    assert!(html.contains("default-src 'none'"));
    for fetched in ["src=\"http", "href=\"http", "<script", "<link", "url("] {
        assert!(!html.contains(fetched), "{fetched}");
    }
}
