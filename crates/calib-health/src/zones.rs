//! The floor in squares: how far cameras disagreed in each, and where nobody walked.

use std::collections::BTreeMap;

use crate::walk::WalkMoment;
use calib_core::camera::FloorPoint;
use calib_core::floor::Extent;

/// Most zones along a side: a reader takes in no more.
const MOST: f64 = 40.0;

/// A square of the floor.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// Column and row, from the least x and y on.
    pub cell: [usize; 2],
    /// Its corner of the least x and y, in metres.
    pub corner: FloorPoint,
    /// Moments at which the walker was in it.
    pub moments: usize,
    /// Moments at which two cameras or more saw the walker in it.
    pub together: usize,
    /// Root mean square distance, in metres, of where a camera puts the walker from where all together do; `None`
    /// where no two cameras saw them.
    pub error: Option<f64>,
    /// The standard deviation of that.
    pub error_sigma: Option<f64>,
    /// By index, the cameras whose field of view covers the middle.
    pub covered_by: Vec<usize>,
}

/// The floor in squares.
#[derive(Clone, Debug, PartialEq)]
pub struct Zones {
    /// Length of a side, in metres.
    pub side: f64,
    /// Those that a camera covers or the walker was in, row by row.
    pub list: Vec<Zone>,
}

/// What is gathered of a zone.
#[derive(Clone, Default)]
struct Sum {
    moments: usize,
    together: usize,
    squares: f64,
    count: f64,
    covered_by: Vec<usize>,
}

impl Zones {
    /// The zones of a walk before cameras that cover these polygons of the floor.
    #[must_use]
    pub fn new(moments: &[WalkMoment], efovs: &[Vec<FloorPoint>], side: f64) -> Self {
        let corners = efovs.iter().flatten().copied().filter(|point| point.is_finite());
        let places: Vec<FloorPoint> = corners.chain(moments.iter().map(|moment| moment.place)).collect();
        let fold = |pick: fn(f64, f64) -> f64, of: fn(&FloorPoint) -> f64| places.iter().map(of).reduce(pick);
        let bounds = || {
            let low = [fold(f64::min, |p| p.x)?, fold(f64::min, |p| p.y)?];
            Some((low, [fold(f64::max, |p| p.x)?, fold(f64::max, |p| p.y)?]))
        };
        let Some((low, high)) = bounds() else { return Self { side, list: Vec::new() } };
        let side = side.max((high[0] - low[0]) / MOST).max((high[1] - low[1]) / MOST);
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
            let [column, row] = cell(moment.place);
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
            self.together += 1;
            self.count += moment.seen.len() as f64;
            self.squares += moment.seen.iter().map(|(_, at)| at.distance(moment.place).powi(2)).sum::<f64>();
        }
    }

    fn zone(self, cell: [usize; 2], corner: FloorPoint) -> Zone {
        let error = (self.count > 0.0).then(|| (self.squares / self.count).sqrt());
        let Self { moments, together, covered_by, .. } = self;
        // Two coordinates a moment: the relative standard deviation of a root mean square.
        let error_sigma = error.map(|error| error / (4.0 * together as f64).sqrt());
        Zone { cell, corner, moments, together, error, error_sigma, covered_by }
    }
}
