//! Zones of the floor: the disagreement of the cameras in each square, and squares without a walker.

use std::collections::BTreeMap;

use crate::walk::WalkMoment;
use calib_core::camera::FloorPoint;
use calib_core::floor::Extent;

/// Largest number of zones along a side of the floor, for a readable table.
const MAX_ZONES_PER_SIDE: f64 = 40.0;

/// Square of the floor.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// Column and row, counted from the smallest x and y.
    pub cell: [usize; 2],
    /// Corner with the smallest x and y, in metres.
    pub corner: FloorPoint,
    /// Number of moments with the walker in the zone.
    pub moments: usize,
    /// Number of moments when at least two cameras saw the walker in the zone.
    pub shared_moments: usize,
    /// Root mean square distance between the walker's position from one camera and from all cameras, in
    /// metres; `None` if no two cameras saw the walker in the zone at the same time.
    pub error: Option<f64>,
    /// Standard deviation of `error`, in metres.
    pub error_sigma: Option<f64>,
    /// Indices of the cameras whose field of view covers the centre of the zone.
    pub covered_by: Vec<usize>,
}

/// Floor divided into squares.
#[derive(Clone, Debug, PartialEq)]
pub struct Zones {
    /// Length of a side of a zone, in metres.
    pub side: f64,
    /// Zones that a camera covers or that the walker entered, row by row.
    pub list: Vec<Zone>,
}

/// Sums over the moments of a zone.
#[derive(Clone, Default)]
struct Sum {
    moments: usize,
    shared_moments: usize,
    /// Sum of the squared distances between the position from one camera and from all, in square metres.
    squares: f64,
    /// Number of distances in `squares`.
    count: f64,
    covered_by: Vec<usize>,
}

impl Zones {
    /// Computes the zones of a walk. `efovs` are the fields of view of the cameras as polygons on the floor.
    /// `side` is the length of a side of a zone in metres; it is enlarged for large floors.
    #[must_use]
    pub fn new(moments: &[WalkMoment], efovs: &[Vec<FloorPoint>], side: f64) -> Self {
        let corners = efovs.iter().flatten().copied().filter(|point| point.is_finite());
        let positions: Vec<FloorPoint> =
            corners.chain(moments.iter().map(|moment| moment.position)).collect();
        let fold =
            |pick: fn(f64, f64) -> f64, of: fn(&FloorPoint) -> f64| positions.iter().map(of).reduce(pick);
        let bounds = || {
            let low = [fold(f64::min, |p| p.x)?, fold(f64::min, |p| p.y)?];
            Some((low, [fold(f64::max, |p| p.x)?, fold(f64::max, |p| p.y)?]))
        };
        let Some((low, high)) = bounds() else { return Self { side, list: Vec::new() } };
        let side =
            side.max((high[0] - low[0]) / MAX_ZONES_PER_SIDE).max((high[1] - low[1]) / MAX_ZONES_PER_SIDE);
        let low = low.map(|c| (c / side).floor() * side);
        let cell = |at: FloorPoint| [((at.x - low[0]) / side) as usize, ((at.y - low[1]) / side) as usize];
        let mut sums: BTreeMap<[usize; 2], Sum> = BTreeMap::new();
        let [columns, rows] = cell(FloorPoint::new(high[0], high[1]));
        for (row, column) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column))) {
            let middle =
                FloorPoint::new(low[0] + side * (column as f64 + 0.5), low[1] + side * (row as f64 + 0.5));
            let covers = |efov: &Vec<FloorPoint>| Extent { size: [0.0; 2], efov }.contains(middle);
            let covered_by: Vec<usize> = (0..efovs.len()).filter(|&i| covers(&efovs[i])).collect();
            if !covered_by.is_empty() {
                sums.insert([row, column], Sum { covered_by, ..Sum::default() });
            }
        }
        for moment in moments {
            let [column, row] = cell(moment.position);
            sums.entry([row, column]).or_default().add(moment);
        }
        let zone = |([row, column], sum): ([usize; 2], Sum)| {
            let corner = FloorPoint::new(low[0] + side * column as f64, low[1] + side * row as f64);
            sum.zone([column, row], corner)
        };
        Self { side, list: sums.into_iter().map(zone).collect() }
    }
}

impl Sum {
    fn add(&mut self, moment: &WalkMoment) {
        self.moments += 1;
        if moment.seen.len() > 1 {
            self.shared_moments += 1;
            self.count += moment.seen.len() as f64;
            self.squares +=
                moment.seen.iter().map(|(_, at)| at.distance(moment.position).powi(2)).sum::<f64>();
        }
    }

    /// Returns the zone with these sums.
    fn zone(self, cell: [usize; 2], corner: FloorPoint) -> Zone {
        let error = (self.count > 0.0).then(|| (self.squares / self.count).sqrt());
        let Self { moments, shared_moments, covered_by, .. } = self;
        // Relative standard deviation of a root mean square, with two coordinates per moment.
        let error_sigma = error.map(|error| error / (4.0 * shared_moments as f64).sqrt());
        Zone { cell, corner, moments, shared_moments, error, error_sigma, covered_by }
    }
}
