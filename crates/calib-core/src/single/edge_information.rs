//! Which straight edges carry information about the lens: by how many pixels a distortion would bend each of
//! them. A line through the principal point stays straight under radial distortion and carries none.

use crate::camera::{BrownConrady, Distortion, Lens};
use crate::single::constraints::Source;
use crate::single::straightness::{BestLine, Edge, sagitta};

/// Edges that a distortion of 10 px in the corner would bend by less than one sigma, and by less than a third
/// of what it bends the most informative edge by; with their sagitta under it, in pixels.
pub(crate) fn uninformative(edges: &[&Edge], lens: &Lens, size: [f64; 2], sigma: f64) -> Vec<(Source, f64)> {
    /// Movement of the corner, in pixels.
    const CORNER: f64 = 10.0;
    let half_diagonal = 0.5 * size[0].hypot(size[1]);
    let k1 = CORNER / half_diagonal;
    let brown = |k1: f64| Distortion::BrownConrady(BrownConrady { k1, ..BrownConrady::default() });
    let extra = Lens { focal: half_diagonal, distortion: brown(-k1), ..*lens };
    let bend = |edge: &Edge| {
        // The largest sagitta that the extra distortion gives to the edge.
        let points: Vec<[f64; 2]> =
            edge.points.iter().filter_map(|&p| extra.undistort(p)).map(|p| [p.u, p.v]).collect();
        let plain: Vec<[f64; 2]> = edge.points.iter().map(|p| [p.u, p.v]).collect();
        if points.len() < plain.len() {
            return f64::INFINITY;
        }
        let moved: Vec<f64> = {
            let BestLine { normal, .. } = BestLine::through(&plain, &vec![1.0; plain.len()]);
            points
                .iter()
                .zip(&plain)
                .map(|(a, b)| normal[0] * (a[0] - b[0]) + normal[1] * (a[1] - b[1]))
                .collect()
        };
        sagitta(&plain, &moved)
    };
    let bent: Vec<(Source, f64)> = edges.iter().map(|edge| (edge.source, bend(edge))).collect();
    let best = bent.iter().map(|(_, sagitta)| *sagitta).filter(|s| s.is_finite()).fold(0.0, f64::max);
    // If even the most informative edge bends by less than one sigma, none of them is informative.
    let most = if best < sigma { f64::INFINITY } else { best / 3.0 };
    bent.into_iter().filter(|(_, sagitta)| *sagitta < sigma && *sagitta <= most).collect()
}
