//! Tests of the overlays of the demonstration site, and of variants of it.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use std::sync::OnceLock;

use calib_core::{FloorPoint, MarkKind, Pixel, WorldPoint};

use calib_core::floor::annotated_line_curve;

use calib_core::single::{KINDS, Shape};

use calib_draw::{
    Geometry, ImageLayer, ImageView, Item, Meaning, PlanLayer, PlanView, Scene as _, Signs, cone_corners,
    extension, on_image, on_plan,
};
use calib_site::{Options, Site};

/// Returns the solved demonstration site.
fn solved() -> &'static Site {
    static SITE: OnceLock<Site> = OnceLock::new();
    SITE.get_or_init(|| {
        let site = calib_demo::demo_site().site;
        site.calibrate(&Options::default()).write_into(&site)
    })
}

fn polylines<P: Clone>(items: &[Item<P>]) -> Vec<(Meaning, Vec<P>)> {
    let of = |item: &Item<P>| match &item.geometry {
        Geometry::Polyline(points) => Some((item.meaning, points.clone())),
        _ => None,
    };
    items.iter().filter_map(of).collect()
}

fn labels<P: Copy>(items: &[Item<P>]) -> Vec<(P, &str)> {
    let mut found = Vec::new();
    for item in items {
        if let Geometry::Label(at, text) = &item.geometry {
            found.push((*at, text.as_str()));
        }
    }
    found
}

/// Returns the largest distance of the points from the straight line through the first and the last.
fn bend(points: &[[f64; 2]]) -> f64 {
    let ([ax, ay], [bx, by]) = (points[0], points[points.len() - 1]);
    let length = (bx - ax).hypot(by - ay).max(1e-9);
    let off = |[x, y]: [f64; 2]| ((bx - ax) * (y - ay) - (by - ay) * (x - ax)).abs() / length;
    points.iter().copied().map(off).fold(0.0, f64::max)
}

/// Returns the largest sine of the angle between a bearing and the plane of two of them: the first, and the
/// one at a quarter of the list.
fn out_of_plane(bearings: &[[f64; 3]], focal: f64) -> f64 {
    let unit = |[x, y, z]: [f64; 3]| {
        let length = x.hypot(y).hypot(z);
        [x / length, y / length, z / length]
    };
    let rays: Vec<[f64; 3]> = bearings.iter().map(|&[x, y, z]| unit([x / focal, y / focal, z])).collect();
    let ([a, b, c], [p, q, r]) = (rays[0], rays[rays.len() / 4]);
    let [x, y, z] = unit([b * r - c * q, c * p - a * r, a * q - b * p]);
    rays.iter().map(|ray| (x * ray[0] + y * ray[1] + z * ray[2]).abs()).fold(0.0, f64::max)
}

#[test]
fn every_annotated_line_appears_exactly_once() {
    let site = solved();
    for (camera, entry) in site.cameras.iter().enumerate() {
        let view = ImageView::new(site, camera);
        let items = on_image(&view, &[ImageLayer::Annotations(Signs::All)]);
        let lens = entry.solution.as_ref().unwrap().lens();
        // Lines of a fisheye are curved between the annotated points; lines of other lenses are not.
        let drawn = entry.annotations.iter().flat_map(|a| a.polylines());
        let drawn: Vec<Vec<Pixel>> = drawn.map(|points| annotated_line_curve(&lens, &points)).collect();
        let lines = polylines(&items);
        assert_eq!(lines.iter().map(|(_, points)| points.clone()).collect::<Vec<_>>(), drawn);
        for (meaning, points) in lines {
            let Meaning::Annotation(line) = meaning else { panic!("{meaning:?} among annotated lines") };
            let annotation = &entry.annotations[line.annotation];
            assert_eq!((line.kind, line.is_off), (annotation.kind, annotation.off));
            let drawn = annotation.polylines().nth(line.segment);
            assert_eq!(drawn.map(|drawn| annotated_line_curve(&lens, &drawn)), Some(points));
        }
        assert!(labels(&items).is_empty(), "names are optional");
        let named = on_image(&view.with_labels(1.0), &[ImageLayer::Annotations(Signs::All)]);
        assert_eq!(labels(&named).len(), drawn.len());
    }
}

#[test]
fn a_layer_has_only_its_own_meanings() {
    let site = solved();
    let is_of = |layer: ImageLayer, meaning: Meaning| match layer {
        ImageLayer::LensGrid => matches!(meaning, Meaning::LensGrid),
        ImageLayer::Grid(_) => matches!(meaning, Meaning::Grid),
        ImageLayer::Planes => matches!(meaning, Meaning::Plane(_)),
        ImageLayer::AnnotatedEfov => matches!(meaning, Meaning::Efov(_)),
        ImageLayer::AnnotatedPrism => matches!(meaning, Meaning::Prism(_)),
        ImageLayer::SolvedEfov => matches!(meaning, Meaning::Efov(_) | Meaning::Prism(_)),
        ImageLayer::OtherEfovs => matches!(meaning, Meaning::OtherEfov(_)),
        ImageLayer::Horizon => matches!(meaning, Meaning::Horizon),
        ImageLayer::Marks => matches!(meaning, Meaning::Mark(_)),
        ImageLayer::Pins => matches!(meaning, Meaning::MarkObservation(_) | Meaning::Residual { .. }),
        ImageLayer::Annotations(_) => matches!(meaning, Meaning::Annotation(_)),
        ImageLayer::ControlPoints => {
            matches!(meaning, Meaning::ControlPoint { .. } | Meaning::Residual { .. })
        }
        ImageLayer::Links { .. } => matches!(meaning, Meaning::Link { .. }),
        ImageLayer::Observations => matches!(meaning, Meaning::Observed(_) | Meaning::Solved(_)),
    };
    let layers = [
        ImageLayer::LensGrid,
        ImageLayer::Grid(1.0),
        ImageLayer::Planes,
        ImageLayer::AnnotatedEfov,
        ImageLayer::AnnotatedPrism,
        ImageLayer::SolvedEfov,
        ImageLayer::OtherEfovs,
        ImageLayer::Horizon,
        ImageLayer::Marks,
        ImageLayer::Pins,
        ImageLayer::Annotations(Signs::RightAngles),
        ImageLayer::ControlPoints,
        ImageLayer::Links { incomplete: None },
        ImageLayer::Observations,
    ];
    for camera in 0..site.cameras.len() {
        let view = ImageView::new(site, camera).with_labels(1.0);
        let apart: Vec<Item<Pixel>> = layers.iter().flat_map(|&layer| on_image(&view, &[layer])).collect();
        assert_eq!(on_image(&view, &layers), apart, "layers keep the requested order");
        for layer in layers {
            assert!(on_image(&view, &[layer]).iter().all(|item| is_of(layer, item.meaning)), "{layer:?}");
        }
    }
}

#[test]
fn grid_lines_are_at_whole_multiples_of_the_step() {
    let site = solved();
    for camera in 0..site.cameras.len() {
        let pose = site.pose(camera).unwrap();
        let lines = polylines(&on_image(&ImageView::new(site, camera), &[ImageLayer::Grid(2.0)]));
        assert!(!lines.is_empty());
        for (_, points) in lines {
            let [w, h] = site.cameras[camera].size();
            let inside = |p: &&Pixel| (0.0..w).contains(&p.u) && (0.0..h).contains(&p.v);
            let floor: Vec<FloorPoint> =
                points.iter().filter(inside).filter_map(|&p| pose.pixel_to_floor(p, 0.0)).collect();
            let off = |value: f64| (value / 2.0 - (value / 2.0).round()).abs();
            let along = |value: fn(&FloorPoint) -> f64| floor.iter().map(value).map(off).fold(0.0, f64::max);
            assert!(along(|p| p.x) < 1e-3 || along(|p| p.y) < 1e-3, "camera {camera}");
        }
    }
}

#[test]
fn labels_of_grid_and_horizon_are_inside_the_image() {
    let site = solved();
    for (camera, entry) in site.cameras.iter().enumerate() {
        let [w, h] = entry.size();
        for scale in [0.5, 1.0, 3.0] {
            let view = ImageView::new(site, camera).with_labels(scale);
            let items = on_image(&view, &[ImageLayer::Grid(1.0), ImageLayer::Horizon]);
            for (at, text) in labels(&items) {
                assert!((0.0..w).contains(&at.u) && (0.0..h).contains(&at.v), "{text} at {at:?}");
            }
        }
    }
}

#[test]
fn lens_grid_lines_are_straight_in_the_scene_and_clipped_to_the_image() {
    let site = solved();
    for (camera, entry) in site.cameras.iter().enumerate() {
        let lens = entry.solution.as_ref().unwrap().lens();
        let [w, h] = entry.size();
        for (_, points) in polylines(&on_image(&ImageView::new(site, camera), &[ImageLayer::LensGrid])) {
            let inside = |p: &&Pixel| (0.0..w).contains(&p.u) && (0.0..h).contains(&p.v);
            if lens.distortion.is_wide() {
                let rays: Vec<[f64; 3]> = points.iter().filter_map(|&p| lens.bearing(p)).collect();
                let off = out_of_plane(&rays, lens.focal);
                assert!(off < 1e-6, "camera {camera}: {off}");
            } else {
                let flat: Vec<[f64; 2]> = points
                    .iter()
                    .filter(inside)
                    .filter_map(|&p| lens.undistort(p))
                    .map(|p| [p.u, p.v])
                    .collect();
                assert!(flat.len() < 2 || bend(&flat) < 1e-2, "camera {camera}: {}", bend(&flat));
            }
            let margin = 0.05 * w;
            let is_near =
                |p: &Pixel| (-margin..w + margin).contains(&p.u) && (-margin..h + margin).contains(&p.v);
            assert!(points.iter().all(is_near));
        }
    }
}

#[test]
fn marks_behind_a_camera_are_not_on_its_image() {
    let mut site = solved().clone();
    let pose = site.pose(0).unwrap();
    let mark = site.marks.first().cloned();
    let mut mark = mark.unwrap_or_else(|| any_mark(MarkKind::Cross));
    let ahead = [-pose.yaw.sin(), pose.yaw.cos()];
    let at =
        |far: f64| WorldPoint::new(pose.position.x + far * ahead[0], pose.position.y + far * ahead[1], 0.0);
    mark.off = false;
    for (far, is_seen) in [(-30.0, false), (2.0 * pose.position.z, true)] {
        mark.at_m = at(far);
        site.marks = vec![mark.clone()];
        let items = on_image(&ImageView::new(&site, 0), &[ImageLayer::Marks]);
        assert_eq!(!items.is_empty(), is_seen, "{far} m ahead");
    }
    mark.off = true;
    site.marks = vec![mark];
    assert!(on_image(&ImageView::new(&site, 0), &[ImageLayer::Marks, ImageLayer::Pins]).is_empty());
    assert!(on_plan(&PlanView::new(&site), &[PlanLayer::Marks]).is_empty());
}

fn any_mark(kind: MarkKind) -> calib_site::Mark {
    calib_site::Mark::new(kind, WorldPoint::default(), vec![1.0; kind.size_names().len()])
}

#[test]
fn every_kind_of_mark_is_drawn_and_unknown_kinds_are_refused() {
    let text = |kind: &str| {
        format!(
            r#"{{"format": "calib-site", "version": 1, "marks": [{{"kind": {kind}, "at_m": [0, 0, 0], "size_m": [1]}}]}}"#
        )
    };
    assert!(Site::from_json(&text(r#""cross""#)).is_ok());
    assert!(Site::from_json(&text(r#""teapot""#)).is_err());
    for kind in MarkKind::ALL {
        let mut site = solved().clone();
        site.marks = vec![any_mark(kind)];
        let items = on_plan(&PlanView::new(&site), &[PlanLayer::Marks]);
        assert_eq!(polylines(&items).len(), site.marks[0].shape().polylines().len(), "{kind:?}");
        assert!(items.iter().all(|item| item.meaning == Meaning::Mark(0)));
    }
}

#[test]
fn extensions_are_straight_in_the_scene_and_polylines_have_none() {
    let pose = solved().pose(0).unwrap();
    let points = [Pixel::new(700.0, 400.0), Pixel::new(900.0, 500.0)];
    for row in &KINDS {
        let items = extension(&pose, row.kind, &points);
        assert_eq!(items.is_empty(), row.shape == Shape::Polyline, "{}", row.name);
        for (meaning, line) in polylines(&items) {
            assert_eq!(meaning, Meaning::Extension(row.kind));
            let both = line.iter().chain(&points).filter_map(|&p| pose.undistort(p));
            let flat: Vec<[f64; 2]> = both.map(|p| [p.u, p.v]).collect();
            assert!(bend(&flat) < 1e-3, "{}", bend(&flat));
        }
    }
}

#[test]
fn links_are_on_the_plan_at_their_positions_in_each_view() {
    let site = solved();
    let items = on_plan(&PlanView::new(site), &[PlanLayer::Links]);
    let mut count = 0;
    for item in &items {
        let (Geometry::Point(at), Meaning::LinkPosition { index, camera: Some(camera) }) =
            (&item.geometry, item.meaning)
        else {
            continue;
        };
        let (link, pose) = (&site.links[index], site.pose(camera).unwrap());
        let seen = link.seen.iter().find(|seen| seen.camera == site.cameras[camera].id).unwrap();
        let height = link.height_m.unwrap_or(0.0);
        let pixel = pose.world_to_pixel(at.at_height(height)).unwrap();
        assert!(pixel.distance(seen.px.or(seen.foot).unwrap()) < 1e-3);
        count += 1;
    }
    assert!(count > 4, "{count} points of links");
}

#[test]
fn solved_links_are_close_to_their_annotations() {
    let site = solved();
    let mut count = 0;
    for camera in 0..site.cameras.len() {
        let items = on_image(&ImageView::new(site, camera), &[ImageLayer::Observations]);
        for (meaning, points) in polylines(&items) {
            let Meaning::Observed(of) = meaning else { continue };
            assert_eq!(of.camera, Some(camera));
            assert!(
                of.is_rejected || points[0].distance(points[1]) < 5.0,
                "within the agreement of the views"
            );
            count += 1;
        }
    }
    assert!(count > 4, "{count} sightings");
}

#[test]
fn a_plan_shows_placed_cameras_with_the_selected_one_on_top() {
    let mut site = solved().clone();
    let of = |site: &Site, view: PlanView| -> Vec<usize> {
        assert!(site.cameras.len() > 2);
        let items = on_plan(&view, &[PlanLayer::Cameras]);
        let of = items.iter().map(|item| match item.meaning {
            Meaning::Camera(index) => index,
            other => panic!("{other:?} among cameras"),
        });
        of.collect()
    };
    let all: Vec<usize> = (0..site.cameras.len()).collect();
    assert_eq!(of(&site, PlanView::new(&site)), all);
    assert_eq!(of(&site, PlanView::new(&site).with_uppermost(1)).last(), Some(&1));
    site.cameras[0].solution.as_mut().unwrap().stage = calib_site::Stage::Partial;
    assert_eq!(of(&site, PlanView::new(&site).placed_only()), all[1..]);
    site.cameras[1].solution = None;
    assert_eq!(of(&site, PlanView::new(&site)).len(), all.len() - 1);
}

#[test]
fn the_field_of_a_superseded_camera_is_visible_only_if_selected() {
    let mut site = solved().clone();
    let bump = Some("2026-06-01T09:00:00Z".to_owned());
    site.cameras.push(calib_site::SiteCamera { valid_to: bump.clone(), ..site.cameras[0].clone() });
    site.cameras[0].valid_from = bump;
    let old = site.cameras.len() - 1;
    let fields = |view: PlanView| -> Vec<usize> {
        let items = on_plan(&view, &[PlanLayer::Efovs]);
        let of = items.iter().filter_map(|item| match item.meaning {
            Meaning::Efov(index) => Some(index),
            _ => None,
        });
        of.collect()
    };
    assert_eq!(fields(PlanView::new(&site)), (0..old).collect::<Vec<_>>());
    assert_eq!(fields(PlanView::new(&site).with_uppermost(old)).last(), Some(&old));
    // The old period has ended without a successor.
    site.cameras.remove(0);
    assert!(fields(PlanView::new(&site)).contains(&(old - 1)));
}

#[test]
fn a_cone_is_centred_on_the_viewing_direction() {
    let corners = cone_corners([10.0, 20.0], [13.0, 16.0], 0.4, 44.0);
    let [foot, left, right]: [[f64; 2]; 3] = corners.try_into().unwrap();
    let way = [0.6, -0.8];
    for [x, y] in [left, right] {
        let along = (x - foot[0]) * way[0] + (y - foot[1]) * way[1];
        assert!((along - 44.0 * 0.4_f64.cos()).abs() < 1e-9);
        assert!(((x - foot[0]).hypot(y - foot[1]) - 44.0).abs() < 1e-9);
    }
}

#[test]
fn regions_and_fields_follow_height_and_slope_of_their_plane() {
    let text = r#"{"format": "calib-site", "version": 1,
        "planes": [{"id": "ramp", "name": "Ramp", "height_m": 1,
            "tilt": {"toward_deg": 0, "fall_deg": 5}, "region": [[-2, 6], [2, 6], [2, 10], [-2, 10]]}],
        "cameras": [{"id": "a", "size_px": [1920, 1080], "efov_plane": "ramp",
            "efov_px": [[100, 900], [1800, 900], [900, 300]], "solution": {"method": "given",
            "stage": "placed", "position_m": [0, 0, 5], "yaw_deg": 0, "pitch_deg": 30, "roll_deg": 0,
            "focal_px": 1200, "principal_point_px": [960, 540], "efov_m": [[-1, 7], [1, 7], [1, 9], [-1, 9]]}}]}"#;
    let site = Site::from_json(text).unwrap();
    let (camera, plane) = (site.pose(0).unwrap(), site.plane_or_floor(Some("ramp")));
    let shown = |x: f64, y: f64| {
        let at = FloorPoint { x, y };
        camera.world_to_pixel(at.at_height(plane.height_at(at))).unwrap()
    };
    let items = on_image(&ImageView::new(&site, 0), &[ImageLayer::Planes]);
    assert_eq!(labels(&items).iter().map(|label| label.1).collect::<Vec<_>>(), ["Ramp"]);
    let (_, corners) = &polylines(&items)[0];
    assert!(corners[0].distance(shown(-2.0, 6.0)) < 1e-9 && corners[2].distance(shown(2.0, 10.0)) < 1e-9);
    for (layer, x, y) in [(ImageLayer::SolvedEfov, -1.0, 7.0), (ImageLayer::Grid(1.0), 0.0, 7.0)] {
        let items = on_image(&ImageView::new(&site, 0), &[layer]);
        let nearest = polylines(&items)
            .iter()
            .flat_map(|(_, line)| line.iter())
            .map(|at| at.distance(shown(x, y)))
            .fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-9, "{layer:?}: {nearest}");
    }
    let items = on_plan(&PlanView::new(&site), &[PlanLayer::Planes]);
    assert!(matches!(&items[0].geometry, Geometry::Polygon(corners) if *corners == site.planes[0].region));
    assert_eq!(items.len(), 2);
}
