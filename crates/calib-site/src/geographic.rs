//! Geographic coordinates: the georeference of a site, entered or estimated, and the world coordinates of points
//! with latitude and longitude or with grid coordinates.
//!
//! Without an entered georeference, there are three cases:
//!
//! - Two or more control points have both site and geographic coordinates. They determine the georeference.
//! - All known coordinates are geographic. They define the coordinate system of the site: world (0, 0) is the
//!   first point, +x is east and +y is north. The floor is at the altitude of this point.
//! - The site has other coordinates, such as a plan, and control points with geographic coordinates only. The
//!   solved cameras give their site coordinates, and both together determine the georeference
//!   (`georeference_step`).

use calib_core::floor::{Geographic, GeographicPair, GeoreferenceFit, TangentPlane, georeference_covariance};
use calib_core::{FloorPoint, WorldPoint};

use crate::coordinate_system::CoordinateSystem;
use crate::document::{ControlPointEntry, Georeference, GroundPoint, Link, Mark, Site};
use crate::site_solution::{GeoreferenceSigmas, GeoreferenceSolution};

/// Largest distance of a point or image on the map from the site, in metres.
pub(crate) const MAX_DISTANCE_M: f64 = 50e3;

/// Azimuth of east, in degrees.
const EAST_DEG: f64 = 90.0;

/// Reads latitude and longitude, in degrees, as people type or copy them: `48.137154, 11.576124`,
/// `48.137154 N 11.576124 E`, or degrees, minutes and seconds. Returns `None` for other texts.
#[must_use]
pub fn typed_degrees(text: &str) -> Option<[f64; 2]> {
    let text = text.trim().to_uppercase().replace(['\u{2212}', '\u{2013}'], "-");
    let letter = |c: char| matches!(c, 'N' | 'S' | 'E' | 'W');
    let halves = match (text.matches(letter).count(), text.find(letter)) {
        // A letter before each angle, or after each angle.
        (2, Some(0)) => text.split_at(1 + text[1..].find(letter)?),
        (2, Some(at)) => text.split_at(at + 1),
        (0, _) => {
            let separator = [';', ','].into_iter().find(|mark| text.matches(*mark).count() == 1);
            match separator {
                Some(mark) => text.split_once(mark)?,
                None => text.split_once(char::is_whitespace)?,
            }
        }
        _ => return None,
    };
    let [lat, lon] = [angle(halves.0, ['N', 'S'])?, angle(halves.1, ['E', 'W'])?];
    (lat.abs() <= 90.0 && lon.abs() <= 180.0).then_some([lat, lon])
}

/// Reads an angle: degrees with a sign or a letter, or degrees, minutes and seconds with their marks. `letters` are
/// the letters of positive and of negative angles.
fn angle(text: &str, letters: [char; 2]) -> Option<f64> {
    const UNITS: [(&[char], f64); 3] = [
        (&['\u{b0}'], 1.0),
        (&['\'', '\u{2032}', '\u{2019}'], 60.0),
        (&['"', '\u{2033}', '\u{201d}'], 3600.0),
    ];
    let text = text.trim_matches(|c: char| c.is_whitespace() || c == ',');
    let is_negative = text.starts_with('-') || text.contains(letters[1]);
    let bare = text.trim_matches(|c: char| letters.contains(&c) || c.is_whitespace());
    let mut rest = bare.trim_start_matches(['-', '+']);
    let signed = |angle: f64| if is_negative { -angle } else { angle };
    if let Ok(degrees) = rest.trim_end_matches('\u{b0}').trim().parse::<f64>() {
        let is_plain = rest.starts_with(|c: char| c.is_ascii_digit() || c == '.') && degrees.is_finite();
        return is_plain.then_some(signed(degrees));
    }
    let mut sum = 0.0;
    for (index, (marks, parts)) in UNITS.into_iter().enumerate() {
        let Some((number, after)) = rest.split_once(marks) else { continue };
        let value: f64 = number.trim().parse().ok().filter(|value: &f64| *value >= 0.0)?;
        // Only the last part has decimals, and minutes and seconds are below 60.
        if !after.trim().is_empty() && value.fract() != 0.0 || index > 0 && value >= 60.0 {
            return None;
        }
        (sum, rest) = (sum + value / parts, after);
    }
    (rest.trim().is_empty() && sum.is_finite()).then_some(signed(sum))
}

impl GeoreferenceSolution {
    pub(crate) fn from_fit(fit: &GeoreferenceFit) -> Self {
        let GeoreferenceFit { origin, x_axis_azimuth, covariance } = fit;
        let [east_m, north_m, azimuth] = fit.sigmas();
        let sigmas = [east_m, north_m, azimuth];
        let correlation = |a: usize, b: usize| covariance[a][b] / (sigmas[a] * sigmas[b]);
        let correlations = Some([correlation(0, 1), correlation(0, 2), correlation(1, 2)]);
        Self {
            lat_deg: origin.latitude.to_degrees(),
            lon_deg: origin.longitude.to_degrees(),
            x_axis_azimuth_deg: x_axis_azimuth.to_degrees().rem_euclid(360.0),
            alt_m: None,
            sigma: GeoreferenceSigmas { east_m, north_m, azimuth_deg: azimuth.to_degrees(), correlations },
        }
    }

    /// Returns the covariance of the geographic position of a world point, in square metres. Rows and columns are
    /// east and north. Only the errors of the georeference are included.
    #[must_use]
    pub fn covariance_at(&self, point: FloorPoint) -> [[f64; 2]; 2] {
        let GeoreferenceSigmas { east_m, north_m, azimuth_deg, correlations } = self.sigma;
        let sigmas = [east_m, north_m, azimuth_deg.to_radians()];
        let [en, ea, na] = correlations.unwrap_or_default();
        let correlations = [[1.0, en, ea], [en, 1.0, na], [ea, na, 1.0]];
        let covariance =
            std::array::from_fn(|i| std::array::from_fn(|j| sigmas[i] * sigmas[j] * correlations[i][j]));
        georeference_covariance(&covariance, self.x_axis_azimuth_deg.to_radians(), point)
    }

    /// Returns the same covariance as [`covariance_at`](Self::covariance_at), with world x and y as rows and columns.
    #[must_use]
    pub fn world_covariance_at(&self, point: FloorPoint) -> [[f64; 2]; 2] {
        let (sin, cos) = self.x_axis_azimuth_deg.to_radians().sin_cos();
        // East and north of the world axes.
        let axes = [[sin, cos], [-cos, sin]];
        let earth = self.covariance_at(point);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let terms = (0..2).flat_map(|k| (0..2).map(move |l| (k, l)));
                terms.map(|(k, l)| axes[i][k] * earth[k][l] * axes[j][l]).sum()
            })
        })
    }

    /// Returns the georeference as an operator would enter it.
    #[must_use]
    pub const fn as_entered(&self) -> Georeference {
        let Self { lat_deg, lon_deg, x_axis_azimuth_deg, alt_m, .. } = *self;
        Georeference { lat_deg, lon_deg, x_axis_azimuth_deg, alt_m }
    }
}

impl Georeference {
    /// Returns the map from the site to geographic coordinates.
    #[must_use]
    pub fn tangent_plane(&self) -> TangentPlane {
        TangentPlane::new(self.origin(), self.x_axis_azimuth_deg.to_radians())
    }

    /// Returns the geographic coordinates of world (0, 0).
    fn origin(&self) -> Geographic {
        Geographic {
            latitude: self.lat_deg.to_radians(),
            longitude: self.lon_deg.to_radians(),
            height: self.alt_m.unwrap_or(0.0),
        }
    }
}

/// Surveyed position: the geographic coordinates of a control point, ground point, link or mark, as entered.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurveyedPosition {
    pub(crate) lat_deg: Option<f64>,
    pub(crate) lon_deg: Option<f64>,
    pub(crate) crs_m: Option<[f64; 2]>,
    pub(crate) alt_m: Option<f64>,
    pub(crate) height_m: Option<f64>,
    pub(crate) sigma_m: Option<f64>,
    /// Whether the control point, link or mark is switched off.
    pub(crate) off: bool,
}

/// Surveyed position with its geographic coordinates.
struct SurveyedPoint {
    entered: SurveyedPosition,
    geographic: Geographic,
    /// World coordinates, if they are entered, too.
    world: Option<WorldPoint>,
}

impl SurveyedPosition {
    /// Returns the entered position of a control point.
    pub(crate) const fn of_control_point(point: &ControlPointEntry) -> Self {
        let ControlPointEntry { lat_deg, lon_deg, crs_m, alt_m, height_m, sigma_m, off, .. } = *point;
        Self { lat_deg, lon_deg, crs_m, alt_m, height_m, sigma_m, off }
    }

    /// Returns the entered position of a ground point.
    pub(crate) const fn of_ground_point(point: &GroundPoint) -> Self {
        let GroundPoint { lat_deg, lon_deg, crs_m, alt_m, height_m, sigma_m, .. } = *point;
        Self { lat_deg, lon_deg, crs_m, alt_m, height_m, sigma_m, off: false }
    }

    /// Returns the entered position of a link.
    pub(crate) const fn of_link(link: &Link) -> Self {
        let Link { lat_deg, lon_deg, crs_m, alt_m, height_m, sigma_m, off, .. } = *link;
        Self { lat_deg, lon_deg, crs_m, alt_m, height_m, sigma_m, off }
    }

    /// Returns the entered position of a mark.
    pub(crate) const fn of_mark(mark: &Mark) -> Self {
        let Mark { lat_deg, lon_deg, crs_m, alt_m, sigma_m, off, .. } = *mark;
        Self { lat_deg, lon_deg, crs_m, alt_m, height_m: None, sigma_m, off }
    }

    /// Whether geographic coordinates are entered, even incomplete ones.
    pub(crate) const fn is_entered(&self) -> bool {
        self.lat_deg.is_some() || self.lon_deg.is_some() || self.crs_m.is_some()
    }

    /// Returns the geographic coordinates, with height 0 if no altitude is entered. Returns `None` without
    /// coordinates, and for a grid position without the coordinate system of the site.
    pub(crate) fn geographic(&self, system: Option<&CoordinateSystem>) -> Option<Geographic> {
        let at = match self.crs_m {
            Some(grid) => system?.to_geographic(grid)?,
            None => Geographic {
                latitude: self.lat_deg?.to_radians(),
                longitude: self.lon_deg?.to_radians(),
                height: 0.0,
            },
        };
        Some(Geographic { height: self.alt_m.unwrap_or(0.0), ..at })
    }
}

impl Site {
    /// Returns the georeference of the site: entered for the site or its plan, otherwise from its control points,
    /// links and marks, otherwise from its solved cameras.
    #[must_use]
    pub fn georeference(&self) -> Option<Georeference> {
        let solved = || self.solution.as_ref()?.georeference.as_ref().map(GeoreferenceSolution::as_entered);
        self.known_georeference().or_else(solved)
    }

    /// Returns the map from the site to geographic coordinates; `None` without a georeference.
    #[must_use]
    pub fn tangent_plane(&self) -> Option<TangentPlane> {
        self.georeference().as_ref().map(Georeference::tangent_plane)
    }

    /// Returns the estimated georeference of the site, with its standard deviations; `None` if it is entered.
    #[must_use]
    pub fn estimated_georeference(&self) -> Option<GeoreferenceSolution> {
        if self.entered_georeference().is_some() {
            return None;
        }
        self.georeference_of_points().or_else(|| self.solution.as_ref()?.georeference.clone())
    }

    /// Returns the projected coordinate system of the site; `None` without one.
    #[must_use]
    pub fn coordinate_system(&self) -> Option<CoordinateSystem> {
        CoordinateSystem::new(self.crs.as_ref()?).ok()
    }

    /// Returns the grid of the site and its known georeference, on which cameras with geographic points depend.
    #[must_use]
    pub fn map_inputs(&self) -> (Option<String>, Option<Georeference>) {
        (self.crs.clone(), self.known_georeference())
    }

    /// Returns the georeference that does not depend on solved cameras.
    pub(crate) fn known_georeference(&self) -> Option<Georeference> {
        let of_points = || self.georeference_of_points().as_ref().map(GeoreferenceSolution::as_entered);
        self.entered_georeference().cloned().or_else(of_points)
    }

    /// Returns the georeference of the site or of its plan, as entered.
    pub(crate) fn entered_georeference(&self) -> Option<&Georeference> {
        self.georeference.as_ref().or_else(|| self.plan.as_ref()?.georeference.as_ref())
    }

    /// Returns the world coordinates of a surveyed position; `None` without a known georeference.
    ///
    /// The floor is flat: without an altitude, the height of the point is `height_m` above it.
    pub(crate) fn world_of_survey(&self, position: &SurveyedPosition) -> Option<WorldPoint> {
        if position.is_entered() { self.world_on_map(position, &self.known_georeference()?) } else { None }
    }

    /// Returns the world coordinates of a surveyed position under a georeference.
    pub(crate) fn world_on_map(
        &self,
        position: &SurveyedPosition,
        georeference: &Georeference,
    ) -> Option<WorldPoint> {
        let at = position.geographic(self.coordinate_system().as_ref())?;
        let floor = georeference.alt_m.unwrap_or(0.0);
        let height = position.height_m.unwrap_or(0.0);
        let world = georeference.tangent_plane().to_world(match position.alt_m {
            Some(_) => at,
            None => Geographic { height: floor + height, ..at },
        });
        Some(WorldPoint { z: if position.alt_m.is_some() { world.z } else { height }, ..world })
    }

    /// Returns the number of control points, links and marks with geographic coordinates.
    pub(crate) fn surveyed_count(&self) -> usize {
        self.surveyed_positions().count()
    }

    /// Returns the geographic coordinates of control points, links and marks, as entered. For a control point, the
    /// entry is included.
    fn surveyed_positions(&self) -> impl Iterator<Item = (SurveyedPosition, Option<&ControlPointEntry>)> {
        let points = self.cameras.iter().flat_map(|camera| &camera.control_points);
        let points = points.map(|point| (SurveyedPosition::of_control_point(point), Some(point)));
        let links = self.links.iter().map(|link| (SurveyedPosition::of_link(link), None));
        let marks = self.marks.iter().map(|mark| (SurveyedPosition::of_mark(mark), None));
        points.chain(links).chain(marks).filter(|(entered, _)| entered.is_entered())
    }

    /// Returns the control points, links and marks with geographic coordinates. Points that are switched off are
    /// included, so that switching a point off does not move the coordinate system.
    fn surveyed_points(&self) -> impl Iterator<Item = SurveyedPoint> {
        let system = self.coordinate_system();
        // Every gesture calls this function, and most sites have no such points. Therefore the cheap filter comes
        // first.
        self.surveyed_positions().filter_map(move |(entered, point)| {
            let world = point.and_then(|point| point.site_coordinates(self));
            Some(SurveyedPoint { entered, geographic: entered.geographic(system.as_ref())?, world })
        })
    }

    /// Moves every mark with map coordinates to its position in the site, which depends on the georeference.
    pub fn place_surveyed_marks(&mut self) {
        for index in 0..self.marks.len() {
            let position = SurveyedPosition::of_mark(&self.marks[index]);
            if let Some(at) = self.world_of_survey(&position) {
                self.marks[index].at_m = at;
            }
        }
    }

    /// Returns the georeference that follows from control points, links and marks with geographic coordinates; `None`
    /// if it is entered, or undetermined.
    pub(crate) fn georeference_of_points(&self) -> Option<GeoreferenceSolution> {
        if self.entered_georeference().is_some() {
            return None;
        }
        let first = self.surveyed_points().next()?;
        let pair = |point: SurveyedPoint| {
            let world = point.world?.on_floor();
            Some(GeographicPair { world, geographic: point.geographic, sigma: point.entered.sigma_m? })
        };
        let used: Vec<GeographicPair> =
            self.surveyed_points().filter(|point| !point.entered.off).filter_map(pair).collect();
        let pairs = if used.len() > 1 { used } else { self.surveyed_points().filter_map(pair).collect() };
        if pairs.len() > 1 {
            return Some(GeoreferenceSolution::from_fit(&GeoreferenceFit::new(&pairs)?));
        }
        let Geographic { latitude, longitude, .. } = first.geographic;
        (!self.has_site_coordinates()).then(|| GeoreferenceSolution {
            lat_deg: latitude.to_degrees(),
            lon_deg: longitude.to_degrees(),
            x_axis_azimuth_deg: EAST_DEG,
            alt_m: first.entered.alt_m,
            sigma: GeoreferenceSigmas { east_m: 0.0, north_m: 0.0, azimuth_deg: 0.0, correlations: None },
        })
    }

    /// Whether anything other than geographic points defines the coordinate system of the site: a plan, other control
    /// points, a fixed placement, or a fixed mark.
    pub(crate) fn has_site_coordinates(&self) -> bool {
        let has_coordinates = |point: &ControlPointEntry| point.world_m.is_some() || point.plan_px.is_some();
        self.plan.is_some()
            || self
                .marks
                .iter()
                .any(|mark| mark.fixed && !mark.off && !SurveyedPosition::of_mark(mark).is_entered())
            || self.cameras.iter().any(|camera| {
                camera.placement.as_ref().is_some_and(|placement| placement.fixed)
                    || camera.control_points.iter().any(has_coordinates)
            })
    }

    /// Returns the reference point that all geographic points must be near: the origin of the entered georeference,
    /// otherwise the first point. Returns `None` if the site has neither.
    pub(crate) fn geographic_reference(&self) -> Option<Geographic> {
        match self.entered_georeference() {
            Some(georeference) => Some(georeference.origin()),
            None => self.surveyed_points().next().map(|point| point.geographic),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_toward_east_and_north_are_rotated_into_world_axes() {
        // World +x is north, and world +y is west.
        let solution = GeoreferenceSolution {
            lat_deg: 48.0,
            lon_deg: 11.0,
            x_axis_azimuth_deg: 0.0,
            alt_m: None,
            sigma: GeoreferenceSigmas {
                east_m: 3.0,
                north_m: 2.0,
                azimuth_deg: 0.0,
                correlations: Some([0.5, 0.0, 0.0]),
            },
        };
        let expected = [[4.0, -3.0], [-3.0, 9.0]];
        let found = solution.world_covariance_at(FloorPoint { x: 5.0, y: -3.0 });
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            assert!((found[i][j] - expected[i][j]).abs() < 1e-12, "{found:?}");
        }
    }

    #[test]
    fn typed_coordinates_are_read() {
        for (text, expected) in [
            ("48.137154, 11.576124", [48.137_154, 11.576_124]),
            ("48.137154 11.576124", [48.137_154, 11.576_124]),
            ("-33.5;151.25", [-33.5, 151.25]),
            ("33.5\u{b0} S, 151.25\u{b0} E", [-33.5, 151.25]),
            ("40 n 74.5 w", [40.0, -74.5]),
            ("N 48.5, E 11.25", [48.5, 11.25]),
            ("48\u{b0}30'36\"N 11\u{b0}15'00.0\"E", [48.51, 11.25]),
        ] {
            let found = typed_degrees(text).unwrap_or_else(|| panic!("{text}"));
            assert!(
                (found[0] - expected[0]).abs() < 1e-9 && (found[1] - expected[1]).abs() < 1e-9,
                "{text}: {found:?}"
            );
        }
        for text in [
            "",
            "48.1",
            "north",
            "95, 10",
            "48.1, 11.5, 519",
            "48.1 N",
            "a, b",
            "1 2 3 4 5",
            "E 11.5, N 48.1",
            "48,13 11,57",
            "48 8 11 34",
            "48.1, 11.5, 35",
            "48.5\u{b0}30' N 11\u{b0}E",
            "48 S 11 S",
        ] {
            assert_eq!(typed_degrees(text), None, "{text}");
        }
    }
}
