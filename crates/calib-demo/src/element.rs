//! Marks that coincide with objects of the scene, and landmarks.
//!
//! Landmarks are scene points that an operator can recognise in images. They serve as control points and links.

use calib_core::{MarkKind, Pixel, WorldPoint};
use calib_site::{ControlPointEntry, Link, LinkKind, LinkObservation, Mark};

use crate::building::{CEILING, COLUMN, COLUMNS};
use crate::edge::exact;
use crate::figure::PEOPLE;
use crate::hand::{Operator, spread};
use crate::shop::{
    BARREL, CHECKOUT, CHECKOUTS, GONDOLA_HALF, GONDOLA_HEIGHT, GONDOLAS, PALLET, PALLET_SIZE, POLE,
    POLE_HEIGHT, RUG,
};

/// Point with a name.
pub(crate) type Landmark = (String, WorldPoint);

/// Returns points of the shop, on the floor and above it.
pub(crate) fn shop_landmarks() -> Vec<Landmark> {
    let mut points = Vec::new();
    let mut add = |name: String, x: f64, y: f64, z: f64| points.push((name, WorldPoint { x, y, z }));
    let sides = [("SW", -1.0, -1.0), ("SE", 1.0, -1.0), ("NE", 1.0, 1.0), ("NW", -1.0, 1.0)];
    for (i, [x, y]) in COLUMNS.map(|column| column.map(exact)).into_iter().enumerate() {
        let half = exact(COLUMN) + 0.012;
        for (side, sx, sy) in sides {
            add(format!("column {} foot {side}", i + 1), x + sx * half, y + sy * half, 0.0);
        }
    }
    for (i, [from, to, y]) in GONDOLAS.map(|row| row.map(exact)).into_iter().enumerate() {
        for (side, x, sy) in [("SW", from, -1.0), ("SE", to, -1.0), ("NE", to, 1.0), ("NW", from, 1.0)] {
            let y = y + sy * exact(GONDOLA_HALF);
            add(format!("shelf {} foot {side}", i + 1), x, y, 0.0);
            add(format!("shelf {} top {side}", i + 1), x, y, exact(GONDOLA_HEIGHT));
        }
    }
    let [width, length, _] = CHECKOUT.map(exact);
    for (i, [x, y]) in CHECKOUTS.map(|at| at.map(exact)).into_iter().enumerate() {
        add(format!("checkout {} SE", i + 1), x + width, y, 0.0);
        add(format!("checkout {} NW", i + 1), x, y + length, 0.0);
    }
    let ([x, y], [width, depth, _]) = (PALLET.map(exact), PALLET_SIZE.map(exact));
    for (side, x, y) in
        [("SW", x, y), ("SE", x + width, y), ("NE", x + width, y + depth), ("NW", x, y + depth)]
    {
        add(format!("pallet {side}"), x, y, 0.0);
    }
    for (name, x, y, z) in [
        ("barn door top W", 13.2, 0.02, 2.1),
        ("barn door top E", 14.4, 0.02, 2.1),
        ("store door top S", 23.98, 6.0, 2.1),
        ("store door top N", 23.98, 7.2, 2.1),
        ("entrance top W", 2.4, 14.38, 2.7),
        ("entrance top E", 4.8, 14.38, 2.7),
        ("window 1 top W", 7.2, 14.38, 3.3),
        ("window 2 top E", 15.6, 14.38, 3.3),
        ("window 3 top E", 20.4, 14.38, 3.3),
    ] {
        add(name.into(), x, y, z);
    }
    points
}

/// Returns points of the barn: feet of its posts, ends of saw cuts, corners of the gate.
pub(crate) fn barn_landmarks() -> Vec<Landmark> {
    let mut points = Vec::new();
    for i in 1..6 {
        let x = 5.0 * f64::from(i);
        for (side, y) in [("S", -8.25), ("N", -4.25)] {
            points.push((format!("post {i} {side}"), WorldPoint { x: x - 0.11, y, z: 0.5 }));
        }
        for (side, y) in [("S", -7.9), ("N", -4.6)] {
            points.push((format!("cut {i} {side}"), WorldPoint { x, y, z: 0.0 }));
        }
    }
    for (side, y) in [("S", -7.9), ("N", -4.6)] {
        points.push((format!("gate top {side}"), WorldPoint { x: 29.98, y, z: 3.3 }));
    }
    points
}

/// Returns up to `count` landmarks as control points of a camera, spread over its image.
pub(crate) fn control_points(
    hand: &mut Operator,
    landmarks: &[Landmark],
    count: usize,
) -> Vec<ControlPointEntry> {
    let seen: Vec<(&Landmark, Pixel)> = landmarks
        .iter()
        .filter(|(_, point)| hand.sees(*point))
        .filter_map(|landmark| Some((landmark, hand.pixel(landmark.1)?)))
        .collect();
    spread(&seen, count, |(_, pixel)| *pixel, |_| 1.0)
        .into_iter()
        .filter_map(|((name, point), _)| {
            let px = hand.annotate_point(*point)?;
            Some(ControlPointEntry {
                id: Some(name.clone()),
                world_m: Some(*point),
                ..ControlPointEntry::new(px)
            })
        })
        .collect()
}

/// Returns links to up to `count` floor points, spread over the floor, and to the pole. At least two cameras other
/// than the fisheye show each floor point.
pub(crate) fn links(hands: &mut [(&str, Operator)], count: usize) -> Vec<Link> {
    /// Scale that makes floor distances comparable to the pixels of `spread`.
    const PIXELS_PER_METRE: f64 = 100.0;
    let shared: Vec<(Landmark, usize)> = shop_landmarks()
        .into_iter()
        .filter(|(_, point)| point.z == 0.0)
        .map(|landmark| {
            // The fisheye shows nearly all points, so only observations by the other cameras count.
            let others = hands.iter().filter(|(_, hand)| !hand.camera.lens.distortion.is_wide());
            let count = others.filter(|(_, hand)| hand.sees(landmark.1)).count();
            (landmark, count)
        })
        .filter(|(_, count)| *count >= 2)
        .collect();
    let refs: Vec<&(Landmark, usize)> = shared.iter().collect();
    let on_floor = |item: &&(Landmark, usize)| {
        let WorldPoint { x, y, .. } = item.0.1;
        Pixel { u: PIXELS_PER_METRE * x, v: PIXELS_PER_METRE * y }
    };
    let chosen = spread(&refs, count, on_floor, |item| item.1 as f64);
    let mut links: Vec<Link> =
        chosen.iter().map(|((name, point), _)| point_link(hands, name, *point)).collect();
    links.push(pole_link(hands));
    links
}

fn point_link(hands: &mut [(&str, Operator)], name: &str, point: WorldPoint) -> Link {
    let seen = hands
        .iter_mut()
        .filter(|(_, hand)| hand.sees(point))
        .map(|(id, hand)| LinkObservation { px: hand.annotate_point(point), ..LinkObservation::new(*id) })
        .collect();
    Link::new(Some(name.into()), LinkKind::Point, seen)
}

/// Returns a link to the pole with the sign, from the centre of its foot to its top.
fn pole_link(hands: &mut [(&str, Operator)]) -> Link {
    let [x, y] = POLE.map(exact);
    let (foot, head) = (WorldPoint { x, y, z: 0.0 }, WorldPoint { x, y, z: exact(POLE_HEIGHT) });
    // The foot plate hides the centre of the foot. This occlusion is ignored.
    let shows = |hand: &Operator, point| crate::world::visible(&hand.camera, hand.size, point, 0.3);
    let seen = hands
        .iter_mut()
        .filter(|(_, hand)| shows(hand, foot) && shows(hand, head))
        .map(|(id, hand)| LinkObservation {
            foot: hand.annotate_point(foot),
            head: hand.annotate_point(head),
            ..LinkObservation::new(*id)
        })
        .collect();
    Link::new(Some("sign pole".into()), LinkKind::Post, seen)
}

/// Returns the marks of the site.
pub(crate) fn marks() -> Vec<Mark> {
    let half = 0.5;
    let [column_x, column_y] = COLUMNS[1].map(exact);
    let side = 2.0 * exact(COLUMN);
    let ([pallet_x, pallet_y], pallet) = (PALLET.map(exact), PALLET_SIZE.map(exact));
    let ([till_x, till_y], till) = (CHECKOUTS[1].map(exact), CHECKOUT.map(exact));
    let [barrel_x, barrel_y, radius, tall] = BARREL.map(exact);
    let [rug_x, rug_y, rug] = RUG.map(exact);
    let person = &PEOPLE[0];
    let [person_x, person_y] = person.at.map(exact);
    vec![
        mark("cross", "Tile crossing", MarkKind::Cross, [19.2, 10.2], 0.0, &[0.6]),
        mark("column", "Column", MarkKind::Post, [column_x, column_y], 0.0, &[side, side, exact(CEILING)]),
        mark(
            "pallet",
            "Pallet",
            MarkKind::Box,
            [pallet_x + half * pallet[0], pallet_y + half * pallet[1]],
            0.0,
            &pallet,
        ),
        mark(
            "till",
            "Checkout",
            MarkKind::Box,
            [till_x + half * till[0], till_y + half * till[1]],
            0.0,
            &till,
        ),
        mark("barrel", "Barrel", MarkKind::Cylinder, [barrel_x, barrel_y], 0.0, &[radius, tall]),
        mark(
            "customer",
            "Customer",
            MarkKind::Person,
            [person_x, person_y],
            f64::from(person.turn).to_degrees().round() + 90.0,
            &[exact(person.height)],
        ),
        mark("rug", "Rug", MarkKind::Circle, [rug_x, rug_y], 0.0, &[rug]),
        mark("tiles", "Tiles", MarkKind::Grid, [14.4, 1.2], 0.0, &[0.6, 6.0, 3.0]),
    ]
}

fn mark(id: &str, name: &str, kind: MarkKind, [x, y]: [f64; 2], turn_deg: f64, size: &[f64]) -> Mark {
    Mark {
        id: Some(id.into()),
        name: Some(name.into()),
        turn_deg,
        ..Mark::new(kind, WorldPoint { x, y, z: 0.0 }, size.to_vec())
    }
}
