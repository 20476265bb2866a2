//! Example: draws the floor grid as polylines of an image, as an SVG overlay.
//!
//! ```text
//! cargo run --release -p calib-site --example draw_grid -- calib-demo/solved.json shop-1 > grid.svg
//! ```

use calib_core::{floor_grid, horizon, on_image};

use calib_site::Site;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, id] = arguments.as_slice() else { return Err("usage: draw_grid SITE CAMERA".into()) };
    let site = Site::from_json(&std::fs::read_to_string(path)?)?;
    let entry = site.camera(id).ok_or("no such camera")?;
    let camera = entry.camera().ok_or("the camera is not calibrated")?;

    // Grid lines on the floor inside the field of view, clipped behind the camera and distorted by its lens.
    let grid = floor_grid(&entry.floor_polygon(), 1.0);
    let lines = grid.iter().flat_map(|line| on_image(&camera, line)).chain(horizon(&camera, entry.size()));
    let [width, height] = entry.size();
    println!(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' fill='none' stroke='#0a7'>"
    );
    for line in lines {
        let points: Vec<String> = line.iter().map(|pixel| format!("{:.1},{:.1}", pixel.u, pixel.v)).collect();
        println!("<polyline points='{}'/>", points.join(" "));
    }
    println!("</svg>");
    Ok(())
}
