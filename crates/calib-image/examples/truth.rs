#![allow(missing_docs, clippy::all)]
use calib_core::*;
fn main() {
    let fix = std::env::args().nth(1).is_none();
    let mut site = Site::from_json(&std::fs::read_to_string("/work/shared/real/rooms/rooms.json").unwrap()).unwrap();
    if fix { for c in &mut site.cameras { let mut l = c.lens.clone().unwrap(); l.focal_px = Some(Known::fixed(519.16)); c.lens = Some(l); } }
    let r = site.calibrate(&Options::default());
    for (i, s) in &r.cameras { if let Ok(s) = s { let g = s.sigma.as_ref(); println!("{} {} {} {:?} {:?} {}", site.cameras[*i].id, s.roll_deg.unwrap(), s.pitch_deg.unwrap(), g.and_then(|g| g.focal_px).unwrap_or(9.0), g.and_then(|g| g.pitch_deg).unwrap_or(9.0), (s.focal_px/519.16).ln()); } }
}
