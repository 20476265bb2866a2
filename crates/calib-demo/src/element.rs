//! Virtual elements that coincide with things of the scene.

use calib_core::{MarkKind, WorldPoint};

use calib_site::Mark;

use crate::building::{CEILING, COLUMN, COLUMNS};
use crate::edge::exact;
use crate::figure::PEOPLE;
use crate::shop::{BARREL, CHECKOUT, CHECKOUTS, PALLET, PALLET_SIZE, RUG};

/// The marks of the site.
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
        off: false,
        keep: false,
        kind,
        at_m: WorldPoint { x, y, z: 0.0 },
        turn_deg,
        size_m: size.to_vec(),
        fixed: false,
        seen: Vec::new(),
        solution: None,
    }
}
