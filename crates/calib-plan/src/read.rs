//! Reading of a drawing of any type.

use crate::drawing::{Drawing, DrawingKind, View};
#[cfg(feature = "raster")]
use crate::drawing::{DrawingFacts, Picture};
use crate::error::PlanError;

/// Reads the pixels, the scale and the layers of a drawing; `None` if the bytes are not a drawing.
///
/// # Errors
///
/// Fails if the drawing is damaged or too large, if the page does not exist, or if its type is not supported.
pub fn read(bytes: &[u8], view: &View) -> Option<Result<Drawing, PlanError>> {
    #[cfg(feature = "raster")]
    if let Some(large) = crate::large_tiff::read(bytes) {
        return Some(large);
    }
    Some(match DrawingKind::of(bytes)? {
        DrawingKind::LargeTiff => return None,
        DrawingKind::Dxf => crate::dxf::read(bytes, view),
        DrawingKind::Dwg => Err(PlanError::Unsupported(
            "this is a DWG drawing, which is not supported; save it as DXF or PDF".into(),
        )),
        DrawingKind::Pdf => read_pdf(bytes, view),
        DrawingKind::Svg => read_svg(bytes),
    })
}

#[cfg(feature = "pdf")]
fn read_pdf(bytes: &[u8], view: &View) -> Result<Drawing, PlanError> {
    crate::pdf::read(bytes, view.page.unwrap_or(1))
}

#[cfg(not(feature = "pdf"))]
fn read_pdf(_: &[u8], _: &View) -> Result<Drawing, PlanError> {
    Err(PlanError::Unsupported(
        "PDF plans are not supported here; use the desktop app or `calib plan`, or save the page as PNG"
            .into(),
    ))
}

#[cfg(feature = "raster")]
fn read_svg(bytes: &[u8]) -> Result<Drawing, PlanError> {
    let bytes = bytes.to_vec();
    let image = crate::guard::guarded("SVG", move || crate::svg::rasterise(&bytes, None))?;
    let facts = DrawingFacts::new(DrawingKind::Svg, image.dimensions().into());
    Ok(Drawing { picture: Picture::Pixels(image), facts })
}

#[cfg(not(feature = "raster"))]
fn read_svg(_: &[u8]) -> Result<Drawing, PlanError> {
    Err(PlanError::Unsupported("SVG plans are drawn by the browser".into()))
}

#[cfg(all(test, feature = "raster"))]
#[allow(clippy::unwrap_used, reason = "a test that fails may panic")]
mod tests {
    use std::fmt::Write as _;

    use super::*;
    use crate::drawing::ScaleSource;

    /// Returns the text of a DXF with these sections.
    fn dxf(unit: i32, tables: &str, blocks: &str, entities: &str) -> String {
        let section = |name: &str, content: &str| format!("0\nSECTION\n2\n{name}\n{content}0\nENDSEC\n");
        section("HEADER", &format!("9\n$INSUNITS\n70\n{unit}\n"))
            + &section("TABLES", tables)
            + &section("BLOCKS", blocks)
            + &section("ENTITIES", entities)
            + "0\nEOF\n"
    }

    fn pairs(kind: &str, values: &[(i32, f64)]) -> String {
        let mut text = format!("0\n{kind}\n");
        for (code, value) in values {
            let _ = writeln!(text, "{code}\n{value}");
        }
        text
    }

    fn line(layer: &str, [a, b, c, d]: [f64; 4]) -> String {
        pairs("LINE", &[(10, a), (20, b), (11, c), (21, d)]) + &format!("8\n{layer}\n")
    }

    fn layer(name: &str, colour: i32) -> String {
        format!("0\nLAYER\n2\n{name}\n62\n{colour}\n70\n0\n")
    }

    /// Outline of a hall of 20 m x 12 m in millimetres.
    fn hall() -> String {
        line("W", [0.0, 0.0, 20e3, 0.0])
            + &line("W", [20e3, 0.0, 20e3, 12e3])
            + &line("W", [20e3, 12e3, 0.0, 12e3])
            + &line("W", [0.0, 12e3, 0.0, 0.0])
    }

    fn read_dxf(text: &str, layers: Option<&[&str]>) -> Result<Drawing, PlanError> {
        let layers = layers.map(|names| names.iter().map(|&name| name.to_owned()).collect());
        read(text.as_bytes(), &View { layers, page: None }).unwrap()
    }

    /// Returns the darkness of the picture near a point of the drawing, 0 to 255.
    fn darkness(drawing: &Drawing, at: [f64; 2]) -> u8 {
        let (scale, origin) = (drawing.facts.units_per_px.unwrap(), drawing.facts.origin_px.unwrap());
        let pixel = [origin[0] + at[0] / scale, origin[1] - at[1] / scale];
        let image = drawing.clone().into_image().unwrap();
        let near = (0..25).map(|k| [pixel[0] as u32 + k % 5 - 2, pixel[1] as u32 + k / 5 - 2]);
        near.map(|[x, y]| 255 - *image.get_pixel(x, y).0.iter().min().unwrap()).max().unwrap()
    }

    #[test]
    fn unit_and_bounds_determine_the_pixels() {
        for (unit, metres) in
            [(4, Some(1e-3)), (6, Some(1.0)), (1, Some(0.0254)), (2, Some(0.3048)), (0, None)]
        {
            let drawing = read_dxf(&dxf(unit, "", "", &hall()), None).unwrap();
            assert_eq!(drawing.facts.units_per_px, Some(5.0));
            assert_eq!(drawing.facts.metres_per_px, metres.map(|metres| metres * 5.0));
            assert_eq!(drawing.facts.size, [4048, 2448]);
            assert_eq!(drawing.facts.scale_source == Some(ScaleSource::Unit), metres.is_some());
            assert_eq!(drawing.facts.corners_px.len(), 4);
        }
    }

    #[test]
    fn layers_are_listed_and_selected_without_moving_pixels() {
        let tables = layer("W", 7) + &layer("Furniture", 1) + &layer("Grid", -3);
        let entities = hall()
            + &line("Furniture", [5e3, 5e3, 6e3, 5e3])
            + &line("Grid", [-9e3, 4e3, 30e3, 4e3])
            + &line("FREE", [1e3, 1e3, 2e3, 1e3]);
        let text = dxf(4, &tables, "", &entities);
        let all = read_dxf(&text, None).unwrap();
        let shown: Vec<(&str, bool)> =
            all.facts.layers.iter().map(|layer| (layer.name.as_str(), layer.is_shown)).collect();
        assert_eq!(shown, [("FREE", true), ("Furniture", true), ("Grid", false), ("W", true)]);
        assert!(darkness(&all, [5.5e3, 5e3]) > 100 && darkness(&all, [1e4, 4e3]) == 0);
        let walls = read_dxf(&text, Some(&["w", "Grid"])).unwrap();
        assert_eq!((walls.facts.size, walls.facts.origin_px), (all.facts.size, all.facts.origin_px));
        assert!(darkness(&walls, [5.5e3, 5e3]) == 0 && darkness(&walls, [1e4, 4e3]) > 50);
        // Layers of an older version of the drawing are reported, and the layers that are on are shown.
        let renamed = read_dxf(&text, Some(&["Walls"])).unwrap();
        assert_eq!(renamed.facts.notes, ["Layers missing from the drawing: Walls."]);
        assert_eq!(renamed.facts.layers, all.facts.layers);
    }

    #[test]
    fn blocks_are_scaled_rotated_mirrored_and_repeated() {
        // A line of 1 m from the base point (10, 10) along x.
        let block = "0\nBLOCK\n2\nB\n10\n10\n20\n10\n".to_owned()
            + &line("0", [10.0, 10.0, 1010.0, 10.0])
            + "0\nENDBLK\n";
        let insert = |values: &[(i32, f64)]| pairs("INSERT", values) + "2\nb\n8\nW\n";
        let entities = hall()
            + &insert(&[(10, 5e3), (20, 5e3), (50, 90.0)])
            + &insert(&[(10, 10e3), (20, 5e3), (41, -2.0)])
            + &insert(&[(10, 3e3), (20, 9e3), (70, 3.0), (44, 4e3)]);
        let drawing = read_dxf(&dxf(4, &layer("W", 7), &block, &entities), None).unwrap();
        for at in [[5e3, 5.5e3], [8.5e3, 5e3], [3.5e3, 9e3], [7.5e3, 9e3], [11.5e3, 9e3]] {
            assert!(darkness(&drawing, at) > 100, "{at:?}");
        }
        for at in [[5.5e3, 5e3], [10.5e3, 5e3], [15.5e3, 9e3]] {
            assert_eq!(darkness(&drawing, at), 0, "{at:?}");
        }
    }

    #[test]
    fn curves_pass_through_their_points() {
        let bulge = pairs("LWPOLYLINE", &[(70, 0.0), (10, 2e3), (20, 2e3), (42, 1.0), (10, 4e3), (20, 2e3)]);
        let arc = pairs("ARC", &[(10, 10e3), (20, 3e3), (40, 1e3), (50, 270.0), (51, 90.0)]);
        // The normal (0, 0, -1) mirrors x.
        let mirrored = pairs(
            "ARC",
            &[
                (10, -15e3),
                (20, 3e3),
                (40, 1e3),
                (50, 270.0),
                (51, 90.0),
                (210, 0.0),
                (220, 0.0),
                (230, -1.0),
            ],
        );
        let ellipse =
            pairs("ELLIPSE", &[(10, 5e3), (20, 8e3), (11, 0.0), (21, 2e3), (40, 0.5), (41, 0.0), (42, 1.6)]);
        let knots: String = [0, 0, 0, 1, 1, 1].map(|knot| format!("40\n{knot}\n")).concat();
        let controls =
            [[12e3, 7e3], [14e3, 11e3], [16e3, 7e3]].map(|[x, y]| format!("10\n{x}\n20\n{y}\n")).concat();
        let spline = format!("0\nSPLINE\n71\n2\n{knots}{controls}");
        let drawing =
            read_dxf(&dxf(4, "", "", &(hall() + &bulge + &arc + &mirrored + &ellipse + &spline)), None)
                .unwrap();
        // A bulge of 1 is a half circle to the right of the direction; the middle of a quadratic curve is half
        // of its middle control point and a quarter of both others.
        for at in [[3e3, 1e3], [11e3, 3e3], [14e3, 3e3], [5e3, 10e3], [4e3, 8e3], [14e3, 9e3]] {
            assert!(darkness(&drawing, at) > 100, "{at:?}");
        }
        for at in [[3e3, 3e3], [9e3, 3e3], [16e3, 3e3], [6e3, 8e3], [5e3, 6e3]] {
            assert_eq!(darkness(&drawing, at), 0, "{at:?}");
        }
    }

    #[test]
    fn hatches_and_solids_are_filled() {
        let ring = pairs("HATCH", &[(70, 1.0), (91, 1.0), (92, 2.0), (72, 0.0), (73, 1.0), (93, 4.0)])
            + &[[3e3, 3e3], [5e3, 3e3], [5e3, 5e3], [3e3, 5e3]]
                .map(|[x, y]| format!("10\n{x}\n20\n{y}\n"))
                .concat();
        let circle = pairs(
            "HATCH",
            &[
                (70, 1.0),
                (91, 1.0),
                (92, 0.0),
                (93, 1.0),
                (72, 2.0),
                (10, 9e3),
                (20, 4e3),
                (40, 1e3),
                (50, 0.0),
                (51, 360.0),
                (73, 1.0),
            ],
        );
        let solid = pairs(
            "SOLID",
            &[(10, 13e3), (20, 3e3), (11, 15e3), (21, 3e3), (12, 13e3), (22, 5e3), (13, 15e3), (23, 5e3)],
        );
        let drawing = read_dxf(&dxf(4, "", "", &(hall() + &ring + &circle + &solid)), None).unwrap();
        for at in [[4e3, 4e3], [9e3, 4e3], [14e3, 4e3], [14.8e3, 4e3]] {
            assert!(darkness(&drawing, at) > 100, "{at:?}");
        }
        assert_eq!(darkness(&drawing, [7e3, 4e3]), 0);
    }

    #[test]
    fn a_distant_line_does_not_shrink_the_plan() {
        let mut entities = hall();
        for k in 0..60 {
            entities += &line("W", [f64::from(k) * 300.0, 0.0, f64::from(k) * 300.0, 12e3]);
        }
        let near = read_dxf(&dxf(4, "", "", &entities), None).unwrap();
        let far = read_dxf(&dxf(4, "", "", &(entities + &line("W", [1e9, 1e9, 1e9, 2e9]))), None).unwrap();
        assert_eq!(far.facts.size, near.facts.size);
        assert_eq!(far.facts.notes, ["Lines not shown because they are far from the plan: 1."]);
    }

    #[test]
    fn damaged_and_hostile_drawings_are_errors_or_cut() {
        let block = |name: &str, inner: &str| {
            format!("0\nBLOCK\n2\n{name}\n") + &line("0", [0.0, 0.0, 9.0, 9.0]) + inner + "0\nENDBLK\n"
        };
        let insert = |name: &str| format!("0\nINSERT\n2\n{name}\n10\n0\n20\n0\n70\n1000\n71\n1000\n44\n1\n");
        // A block that contains itself a million times.
        let own = read_dxf(&dxf(4, "", &block("A", &insert("A")), &(hall() + &insert("A"))), None);
        assert!(own.unwrap().facts.notes[0].contains("limit"));
        let empty = read_dxf(&dxf(4, "", "", ""), None).unwrap_err().to_string();
        assert!(empty.contains("no visible lines"), "{empty}");
        let hidden = dxf(4, &layer("W", -7), "", &hall());
        assert!(read_dxf(&hidden, None).unwrap_err().to_string().contains("hidden layers: W"));
        let skipped = dxf(4, "", "", &hall().replacen("0\nLINE", "oops\n0\nLINE", 2));
        assert_eq!(read_dxf(&skipped, None).unwrap().facts.notes, ["Damaged lines skipped in the file: 2."]);
        let tiny = hall() + &pairs("CIRCLE", &[(10, 0.0), (20, 0.0), (40, 1e-322)]);
        assert!(read_dxf(&dxf(4, "", "", &tiny), None).is_ok());
        let absent = hall() + &insert("NONE").repeat(1000);
        assert!(read_dxf(&dxf(4, "", "", &absent), None).unwrap().facts.notes[0].contains("limit"));
        let outside = "0\nSECTION\n0\nENDSEC\n".to_owned() + &"0\nA\n".repeat(300_000);
        assert!(read_dxf(&outside, None).is_err());
        let huge = dxf(4, "", "", &(hall() + &line("W", [f64::MAX, 0.0, 1e300, f64::NAN])));
        assert_eq!(read_dxf(&huge, None).unwrap().facts.size, [4048, 2448]);
        let dwg = read(b"AC1032\0\0\0", &View::default()).unwrap().unwrap_err().to_string();
        assert!(dwg.contains("save it as DXF"), "{dwg}");
        assert!(read(b"\x89PNG\r\n", &View::default()).is_none());
        let svg =
            b"<?xml version=\"1.0\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"9\" height=\"3\"/>";
        assert_eq!(read(svg, &View::default()).unwrap().unwrap().facts.size, [3072, 1024]);
    }

    /// Returns a PDF of one page with a rectangle and a text. Sides are in points.
    fn pdf(width: f64, height: f64, page: &str, text: &str) -> Vec<u8> {
        let content = format!("2 w 100 100 200 100 re S BT /F 12 Tf 20 20 Td ({text}) Tj ET");
        let objects = [
            "<< /Type /Catalog /Pages 2 0 R >>".to_owned(),
            "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
            format!(
                "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] {page} /Contents 4 0 R /Resources \
                 << /Font << /F << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>"
            ),
            format!("<< /Length {} >>\nstream\n{content}\nendstream", content.len()),
        ];
        let (mut file, mut offsets) = (String::from("%PDF-1.4\n"), Vec::new());
        for (index, object) in objects.iter().enumerate() {
            offsets.push(file.len());
            let _ = write!(file, "{} 0 obj\n{object}\nendobj\n", index + 1);
        }
        let start = file.len();
        file += "xref\n0 5\n0000000000 65535 f \n";
        for offset in offsets {
            let _ = writeln!(file, "{offset:010} 00000 n ");
        }
        let _ = write!(file, "trailer\n<< /Size 5 /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n");
        file.into_bytes()
    }

    #[cfg(feature = "pdf")]
    #[test]
    fn pages_have_paper_size_and_scale() {
        let a3 = |text: &str| read(&pdf(1190.55, 841.89, "", text), &View::default()).unwrap().unwrap();
        let drawing = a3("Scale 1:100");
        assert_eq!((drawing.facts.size, drawing.facts.pages), ([2480, 1754], 1));
        let metres_per_px = drawing.facts.metres_per_px.unwrap();
        assert!((metres_per_px - 100.0 * 0.0254 / 150.0).abs() < 1e-9);
        assert_eq!(drawing.facts.scale_source, Some(ScaleSource::Text(100)));
        // The lower left corner of the rectangle, 100 points from the left and the bottom.
        let image = drawing.into_image().unwrap();
        let corner = image.get_pixel((100.0 * 150.0 / 72.0) as u32, ((841.89 - 150.0) * 150.0 / 72.0) as u32);
        assert!(corner.0[0] < 100, "{corner:?}");
        let two = a3("1:100, detail 1:20");
        assert_eq!((two.facts.metres_per_px, two.facts.scales_in_text), (None, vec![20, 100]));
        assert_eq!(a3("no scale").facts.metres_per_px, None);
    }

    #[cfg(feature = "pdf")]
    #[test]
    fn large_rotated_and_missing_pages() {
        let unit = read(&pdf(100.0, 50.0, "/UserUnit 10", "1:50"), &View::default()).unwrap().unwrap();
        assert_eq!(unit.facts.size, [2083, 1042]);
        let rotated = read(&pdf(400.0, 200.0, "/Rotate 90", ""), &View::default()).unwrap().unwrap();
        assert_eq!(rotated.facts.size, [417, 833]);
        let huge = read(&pdf(1e6, 5e5, "", "1:500"), &View::default()).unwrap().unwrap();
        assert_eq!(huge.facts.size, [6144, 3072]);
        let metres = huge.facts.metres_per_px.unwrap() * 6144.0;
        assert!((metres / (1e6 / 72.0 * 0.0254 * 500.0) - 1.0).abs() < 1e-6, "{metres}");
        let view = View { page: Some(2), layers: None };
        let missing = read(&pdf(100.0, 100.0, "", ""), &view).unwrap().unwrap_err().to_string();
        assert_eq!(missing, "page 2 does not exist; the last page is 1");
        let cut = &pdf(100.0, 100.0, "", "")[..60];
        assert!(read(cut, &View::default()).unwrap().is_err());
    }

    /// Every change of a few bytes gives a drawing or an error.
    #[test]
    fn mutated_drawings_cause_no_panic() {
        let mut state = 0x2545_f491_4f6c_dd1d_u64;
        let mut random = move |below: usize| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state % below as u64) as usize
        };
        let block = "0\nBLOCK\n2\nB\n".to_owned() + &line("0", [0.0, 0.0, 1e3, 0.0]) + "0\nENDBLK\n";
        let entities = hall()
            + "0\nINSERT\n2\nB\n10\n5\n20\n5\n70\n3\n44\n9\n0\nMTEXT\n10\n1\n20\n1\n40\n500\n1\nHall\\P2\n";
        let text = dxf(4, &layer("W", 7), &block, &entities).into_bytes();
        for _ in 0..300 {
            let mut bytes = text.clone();
            for _ in 0..=random(6) {
                let at = random(bytes.len());
                match random(3) {
                    0 => bytes[at] = random(256) as u8,
                    1 => bytes.truncate(at.max(40)),
                    _ => bytes.insert(at, b"0129.-\n"[random(7)]),
                }
            }
            if let Some(Ok(drawing)) = read(&bytes, &View::default()) {
                let [width, height] = drawing.facts.size;
                assert!(width.max(height) <= 4096, "{width} x {height}");
            }
        }
    }
}
