//! Projected coordinate systems by their EPSG code, such as UTM: conversion between grid coordinates and WGS84.
//!
//! A projected grid has a scale factor and a convergence. Therefore grid coordinates are converted to the
//! ellipsoid first, and never directly to the world coordinates of a site.
//!
//! Datums are converted by their 3- or 7-parameter transformation, without shift grids. Old national datums can
//! therefore be wrong by decimetres to metres. ETRS89, NAD83 and GDA count as equal to WGS84;
//! they differ by up to two metres.

use std::borrow::Cow;
use std::fmt;

use calib_core::floor::Geographic;
use proj4rs::Proj;
use proj4rs::transform::transform;

/// Definition of WGS84 latitude and longitude.
const WGS84: &str = "+proj=longlat +datum=WGS84 +no_defs";

/// Whether the conversion of a PROJ definition is reliable. It is not reliable for the Krovak grids of Czechia and
/// Slovakia (wrong by 16 m) and for grids with south or west axes. Old datums without a transformation to WGS84 are
/// not reliable either.
fn is_reliable(definition: &str) -> bool {
    let has = |term: &str| definition.split_whitespace().any(|own| own.starts_with(term));
    let is_modern = has("+ellps=GRS80") || has("+ellps=WGS84");
    let has_transformation = has("+datum=") || has("+towgs84=") || has("+nadgrids=");
    !has("+proj=krovak") && (!has("+axis=") || has("+axis=enu")) && (is_modern || has_transformation)
}

/// Projected coordinate system.
#[derive(Clone, Debug)]
pub struct CoordinateSystem {
    projection: Proj,
    wgs84: Proj,
}

/// Error in the name of a coordinate system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CoordinateSystemError {
    /// The name is not "EPSG:" and a number.
    NotAnEpsgCode,
    /// The code is unknown.
    Unknown,
    /// The system has latitudes and longitudes instead of a grid.
    Geographic,
    /// The projection, the axes or the datum of the system cannot be converted reliably.
    Unsupported,
}

impl fmt::Display for CoordinateSystemError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotAnEpsgCode => "\"EPSG:\" and the code of a projected grid, such as \"EPSG:25832\"",
            #[cfg(feature = "epsg")]
            Self::Unknown => "the code of a projected grid; see epsg.io",
            #[cfg(not(feature = "epsg"))]
            Self::Unknown => {
                "the EPSG code of a UTM zone or a common national grid; the app, the command line and Python support more"
            }
            Self::Geographic => {
                "a projected grid; this system uses latitude and longitude: enter \"lat_deg\" and \"lon_deg\" instead"
            }
            Self::Unsupported => "another grid, such as UTM; this one cannot be converted reliably",
        })
    }
}

impl std::error::Error for CoordinateSystemError {}

impl CoordinateSystem {
    /// Returns the system with this name: "EPSG:" and the code of a projected grid.
    ///
    /// # Errors
    /// If the name is not such a code, or if the system is unknown or not supported.
    pub fn new(name: &str) -> Result<Self, CoordinateSystemError> {
        let is_epsg = name.get(..5).is_some_and(|prefix| prefix.eq_ignore_ascii_case("EPSG:"));
        let digits = name.get(5..).filter(|_| is_epsg).ok_or(CoordinateSystemError::NotAnEpsgCode)?;
        let code = digits.trim().parse().map_err(|_| CoordinateSystemError::NotAnEpsgCode)?;
        let definition = definition(code).ok_or(CoordinateSystemError::Unknown)?;
        let read = |text: &str| Proj::from_proj_string(text).map_err(|_| CoordinateSystemError::Unsupported);
        let projection = read(&definition)?;
        if projection.is_latlong() {
            return Err(CoordinateSystemError::Geographic);
        }
        if !is_reliable(&definition) {
            return Err(CoordinateSystemError::Unsupported);
        }
        // Three-dimensional systems have no grid.
        if projection.is_geocent() || !projection.has_inverse() {
            return Err(CoordinateSystemError::Unsupported);
        }
        Ok(Self { projection, wgs84: read(WGS84)? })
    }

    /// Converts grid coordinates (east, north) in the unit of the grid to a point at the height 0 on the
    /// ellipsoid; `None` outside the domain of the projection.
    #[must_use]
    pub fn to_geographic(&self, [east, north]: [f64; 2]) -> Option<Geographic> {
        let mut point = (east, north, 0.0);
        transform(&self.projection, &self.wgs84, &mut point).ok()?;
        let (longitude, latitude, _) = point;
        let is_finite = longitude.is_finite() && latitude.is_finite();
        is_finite.then_some(Geographic { latitude, longitude, height: 0.0 })
    }

    /// Converts a point to grid coordinates (east, north) in the unit of the grid; `None` outside the domain of
    /// the projection.
    #[must_use]
    pub fn from_geographic(&self, point: Geographic) -> Option<[f64; 2]> {
        let mut point = (point.longitude, point.latitude, 0.0);
        transform(&self.wgs84, &self.projection, &mut point).ok()?;
        let (east, north, _) = point;
        (east.is_finite() && north.is_finite()).then_some([east, north])
    }

    /// Returns the length of the unit of the grid, in metres.
    #[must_use]
    pub fn metres_per_unit(&self) -> f64 {
        self.projection.to_meter()
    }
}

/// Returns the PROJ definition of an EPSG code.
#[cfg(feature = "epsg")]
fn definition(code: u16) -> Option<Cow<'static, str>> {
    crs_definitions::from_code(code).map(|found| Cow::Borrowed(found.proj4))
}

/// Returns the PROJ definition of a common EPSG code. The table of all codes would make the page of the web app
/// larger by 3 %.
#[cfg(not(feature = "epsg"))]
fn definition(code: u16) -> Option<Cow<'static, str>> {
    common_definition(code)
}

/// Zones of UTM: first and last code, the zone of the first code, and the datum.
#[cfg(any(test, not(feature = "epsg")))]
const UTM: [(u16, u16, u16, &str); 8] = [
    (32601, 32660, 1, "+datum=WGS84"),
    (32701, 32760, 1, "+south +datum=WGS84"),
    (25828, 25838, 28, "+ellps=GRS80 +towgs84=0,0,0,0,0,0,0"),
    (26901, 26923, 1, "+datum=NAD83"),
    (28348, 28358, 48, "+south +ellps=GRS80 +towgs84=0,0,0,0,0,0,0"),
    (7846, 7859, 46, "+south +ellps=GRS80 +towgs84=0,0,0,0,0,0,0"),
    (31978, 31985, 18, "+south +ellps=GRS80 +towgs84=0,0,0,0,0,0,0"),
    (3154, 3156, 7, "+ellps=GRS80 +towgs84=0,0,0,0,0,0,0"),
];

/// National grids and the grid of web maps, with their PROJ definitions.
#[cfg(any(test, not(feature = "epsg")))]
#[rustfmt::skip]
const NATIONAL: [(u16, &str); 30] = [
    (2056, "+proj=somerc +lat_0=46.95240555555556 +lon_0=7.439583333333333 +k_0=1 +x_0=2600000 +y_0=1200000 \
        +ellps=bessel +towgs84=674.374,15.056,405.346,0,0,0,0 +units=m"),
    (2100, "+proj=tmerc +lat_0=0 +lon_0=24 +k=0.9996 +x_0=500000 +y_0=0 +datum=GGRS87 +units=m"),
    (2154, "+proj=lcc +lat_1=49 +lat_2=44 +lat_0=46.5 +lon_0=3 +x_0=700000 +y_0=6600000 +ellps=GRS80 \
        +towgs84=0,0,0,0,0,0,0 +units=m"),
    (2180, "+proj=tmerc +lat_0=0 +lon_0=19 +k=0.9993 +x_0=500000 +y_0=-5300000 +ellps=GRS80 \
        +towgs84=0,0,0,0,0,0,0 +units=m"),
    (2193, "+proj=tmerc +lat_0=0 +lon_0=173 +k=0.9996 +x_0=1600000 +y_0=10000000 +ellps=GRS80 \
        +towgs84=0,0,0,0,0,0,0 +units=m"),
    (2263, "+proj=lcc +lat_1=41.03333333333333 +lat_2=40.66666666666666 +lat_0=40.16666666666666 +lon_0=-74 \
        +x_0=300000.0000000001 +y_0=0 +datum=NAD83 +units=us-ft"),
    (2326, "+proj=tmerc +lat_0=22.31213333333334 +lon_0=114.1785555555556 +k=1 +x_0=836694.05 +y_0=819069.8 \
        +ellps=intl +towgs84=-162.619,-276.959,-161.764,0.067753,-2.243649,-1.158827,-1.094246 +units=m"),
    (3006, "+proj=utm +zone=33 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m"),
    (3067, "+proj=utm +zone=35 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m"),
    (3414, "+proj=tmerc +lat_0=1.366666666666667 +lon_0=103.8333333333333 +k=1 +x_0=28001.642 +y_0=38744.572 \
        +ellps=WGS84 +units=m"),
    (3763, "+proj=tmerc +lat_0=39.66825833333333 +lon_0=-8.133108333333334 +k=1 +x_0=0 +y_0=0 +ellps=GRS80 \
        +towgs84=0,0,0,0,0,0,0 +units=m"),
    (3765, "+proj=tmerc +lat_0=0 +lon_0=16.5 +k=0.9999 +x_0=500000 +y_0=0 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 \
        +units=m"),
    (3794, "+proj=tmerc +lat_0=0 +lon_0=15 +k=0.9999 +x_0=500000 +y_0=-5000000 +ellps=GRS80 \
        +towgs84=0,0,0,0,0,0,0 +units=m"),
    (3812, "+proj=lcc +lat_1=49.83333333333334 +lat_2=51.16666666666666 +lat_0=50.797815 \
        +lon_0=4.359215833333333 +x_0=649328 +y_0=665262 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m"),
    (3826, "+proj=tmerc +lat_0=0 +lon_0=121 +k=0.9999 +x_0=250000 +y_0=0 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 \
        +units=m"),
    (3857, "+proj=merc +a=6378137 +b=6378137 +lat_ts=0.0 +lon_0=0.0 +x_0=0.0 +y_0=0 +k=1.0 +units=m \
        +nadgrids=@null +wktext"),
    (5179, "+proj=tmerc +lat_0=38 +lon_0=127.5 +k=0.9996 +x_0=1000000 +y_0=2000000 +ellps=GRS80 \
        +towgs84=0,0,0,0,0,0,0 +units=m"),
    (5186, "+proj=tmerc +lat_0=38 +lon_0=127 +k=1 +x_0=200000 +y_0=600000 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 \
        +units=m"),
    (21781, "+proj=somerc +lat_0=46.95240555555556 +lon_0=7.439583333333333 +k_0=1 +x_0=600000 +y_0=200000 \
        +ellps=bessel +towgs84=674.374,15.056,405.346,0,0,0,0 +units=m"),
    (23700, "+proj=somerc +lat_0=47.14439372222222 +lon_0=19.04857177777778 +k_0=0.99993 +x_0=650000 \
        +y_0=200000 +ellps=GRS67 +towgs84=52.17,-71.82,-14.9,0,0,0,0 +units=m"),
    (27700, "+proj=tmerc +lat_0=49 +lon_0=-2 +k=0.9996012717 +x_0=400000 +y_0=-100000 +datum=OSGB36 +units=m"),
    (28992, "+proj=sterea +lat_0=52.15616055555555 +lon_0=5.38763888888889 +k=0.9999079 +x_0=155000 \
        +y_0=463000 +ellps=bessel +towgs84=565.2369,50.0087,465.658,-0.406857,0.350733,-1.87035,4.0812 \
        +units=m"),
    (31254, "+proj=tmerc +lat_0=0 +lon_0=10.33333333333333 +k=1 +x_0=0 +y_0=-5000000 +datum=hermannskogel \
        +units=m"),
    (31255, "+proj=tmerc +lat_0=0 +lon_0=13.33333333333333 +k=1 +x_0=0 +y_0=-5000000 +datum=hermannskogel \
        +units=m"),
    (31256, "+proj=tmerc +lat_0=0 +lon_0=16.33333333333333 +k=1 +x_0=0 +y_0=-5000000 +datum=hermannskogel \
        +units=m"),
    (31370, "+proj=lcc +lat_1=51.16666723333333 +lat_2=49.8333339 +lat_0=90 +lon_0=4.367486666666666 \
        +x_0=150000.013 +y_0=5400088.438 +ellps=intl \
        +towgs84=-106.8686,52.2978,-103.7239,0.3366,-0.457,1.8422,-1.2747 +units=m"),
    (31466, "+proj=tmerc +lat_0=0 +lon_0=6 +k=1 +x_0=2500000 +y_0=0 +datum=potsdam +units=m"),
    (31467, "+proj=tmerc +lat_0=0 +lon_0=9 +k=1 +x_0=3500000 +y_0=0 +datum=potsdam +units=m"),
    (31468, "+proj=tmerc +lat_0=0 +lon_0=12 +k=1 +x_0=4500000 +y_0=0 +datum=potsdam +units=m"),
    (31469, "+proj=tmerc +lat_0=0 +lon_0=15 +k=1 +x_0=5500000 +y_0=0 +datum=potsdam +units=m"),
];

/// Returns the PROJ definition of a zone of UTM, of a common national grid, or of the grid of web maps.
#[cfg(any(test, not(feature = "epsg")))]
fn common_definition(code: u16) -> Option<Cow<'static, str>> {
    if let Some((_, definition)) = NATIONAL.iter().find(|(national, _)| *national == code) {
        return Some(Cow::Borrowed(definition));
    }
    let (first, _, zone, datum) = UTM.iter().find(|(first, last, ..)| (*first..=*last).contains(&code))?;
    Some(Cow::Owned(format!("+proj=utm +zone={} {datum} +units=m", zone + code - first)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(lat_deg: f64, lon_deg: f64) -> Geographic {
        Geographic { latitude: lat_deg.to_radians(), longitude: lon_deg.to_radians(), height: 0.0 }
    }

    proptest! {
        #[test]
        fn conversion_to_the_grid_and_back_is_exact(
            // 1e-11 radians are 0.06 mm. Between datums, the height above the other ellipsoid is lost.
            (code, lat, lon, tolerance) in prop_oneof![
                Just((25832, 52.0, 9.0, 1e-11)), Just((32733, -33.0, 15.0, 1e-11)), Just((2154, 46.0, 3.0, 1e-11)),
                Just((2056, 46.9, 7.4, 1e-9)), Just((27700, 53.0, -2.0, 1e-9)), Just((28992, 52.2, 5.4, 1e-9)),
                Just((2263, 40.7, -74.0, 1e-11)), Just((3857, 10.0, 20.0, 1e-11)),
            ],
            north in -0.5..0.5_f64, east in -0.5..0.5_f64,
        ) {
            let system = CoordinateSystem::new(&format!("EPSG:{code}")).unwrap();
            let point = at(lat + north, lon + east);
            let back = system.to_geographic(system.from_geographic(point).unwrap()).unwrap();
            prop_assert!((back.latitude - point.latitude).abs() < tolerance, "{back:?} {point:?}");
            prop_assert!((back.longitude - point.longitude).abs() < tolerance, "{back:?} {point:?}");
        }
    }

    #[test]
    fn central_meridian_of_utm_is_at_half_a_million_metres() {
        let system = CoordinateSystem::new("epsg:32632").unwrap();
        let [east, north] = system.from_geographic(at(0.0, 9.0)).unwrap();
        assert!((east - 5e5).abs() < 1e-6 && north.abs() < 1e-6, "{east} {north}");
        assert!((system.metres_per_unit() - 1.0).abs() < 1e-12);
        let feet = CoordinateSystem::new("EPSG:2263").unwrap().metres_per_unit();
        assert!((feet - 1200.0 / 3937.0).abs() < 1e-12, "{feet}");
    }

    #[test]
    fn other_names_are_refused() {
        for name in ["25832", "EPSG:x", "EPSG:\u{e4}"] {
            let refused = CoordinateSystem::new(name).map(|_| ());
            assert_eq!(refused, Err(CoordinateSystemError::NotAnEpsgCode), "{name}");
        }
    }

    #[cfg(feature = "epsg")]
    #[test]
    fn unsupported_systems_are_refused() {
        for (name, expected) in [
            ("EPSG:1", CoordinateSystemError::Unknown),
            ("EPSG:4326", CoordinateSystemError::Geographic),
            ("EPSG:5514", CoordinateSystemError::Unsupported),
            ("EPSG:2048", CoordinateSystemError::Unsupported),
            ("EPSG:2008", CoordinateSystemError::Unsupported),
        ] {
            assert_eq!(CoordinateSystem::new(name).map(|_| ()), Err(expected), "{name}");
        }
    }

    #[cfg(feature = "epsg")]
    #[test]
    fn common_definitions_agree_with_the_table_of_all_codes() {
        let zones = UTM.iter().flat_map(|(first, last, ..)| *first..=*last);
        for code in zones.chain(NATIONAL.iter().map(|(code, _)| *code)) {
            let [own, full] = [common_definition(code), definition(code)].map(|text| {
                let text = text.unwrap();
                let mut terms: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
                // GRS80 without a transformation is the ellipsoid of WGS84, to 0.1 mm.
                terms.retain(|term| term != "+no_defs" && term != "+towgs84=0,0,0,0,0,0,0");
                terms.sort_unstable();
                terms.join(" ")
            });
            assert_eq!(own, full, "EPSG:{code}");
        }
    }
}
