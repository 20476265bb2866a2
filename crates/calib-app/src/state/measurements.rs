//! Values of the measurements in the images, computed when their inputs change.

use calib_core::Camera;
use calib_core::floor::Measured;
use calib_editor::Session;
use calib_report::{measurement_text, speed_remark};
use calib_site::{Measurement, Units};

/// Values of the measurements, kept until a camera or a measurement changes.
#[derive(Debug, Default)]
pub(crate) struct ShownMeasurements {
    inputs: Option<Inputs>,
    pub(crate) values: Vec<Result<Measured, String>>,
}

/// Generation of the site, poses of its cameras, and measurements.
type Inputs = (u64, Vec<Option<Camera>>, Vec<Measurement>);

impl ShownMeasurements {
    /// Computes the values again if their inputs have changed.
    pub(crate) fn update(&mut self, session: &Session) {
        let measurements = &session.site.measurements;
        let poses: Vec<Option<Camera>> =
            (0..session.site.cameras.len()).map(|index| session.solved.pose(index).copied()).collect();
        let generation = session.revision.generation;
        let is_current = self.inputs.as_ref().is_some_and(|(of_site, of_poses, of_measurements)| {
            *of_site == generation && *of_poses == poses && of_measurements == measurements
        });
        if is_current {
            return;
        }
        let solved = session.solved.write_into(&session.site);
        let value =
            |measurement: &Measurement| solved.measure(measurement).map_err(|error| error.to_string());
        self.values = measurements.iter().map(value).collect();
        self.inputs = Some((generation, poses, measurements.clone()));
    }

    /// Returns a sentence with the smallest and largest possible speed if the times were rounded to whole seconds;
    /// `None` for all other measurements.
    pub(crate) fn remark(&self, index: usize, measurement: &Measurement, units: Units) -> Option<String> {
        let found = self.values.get(index)?.as_ref().ok()?;
        speed_remark(measurement, *found, units)
    }

    /// Returns the value of a measurement as text.
    pub(crate) fn text(&self, index: usize, measurement: &Measurement, units: Units) -> String {
        match self.values.get(index) {
            Some(Ok(found)) => measurement_text(measurement, *found, units),
            Some(Err(why)) => why.clone(),
            None => String::new(),
        }
    }
}
