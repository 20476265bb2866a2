//! Python bindings: calibrated cameras with NumPy arrays, and the calibration itself.
//!
//! All computation is in `calib-core` and `calib-site`; this crate contains only types, errors and array
//! conversion.
//!
//! - `error`: the exception, and findings.
//! - `array`: NumPy arrays as columns of doubles.
//! - `stream`: the keywords that select a kind of pixels.
//! - `camera`, `mapping`, `boxes`: the class `Camera`.
//! - `site`, `survey`, `table`: the class `Site`, with coverage, measurements, and the mapping of whole tables.
//!
//! The folder `python/` contains pure Python: statuses, and entries of a site file.

#![allow(clippy::doc_markdown, reason = "doc comments of classes become Python docstrings")]

mod error;
mod array;
mod stream;
mod camera;
mod mapping;
mod boxes;
mod site;
mod survey;
mod table;

use pyo3::prelude::*;

/// The compiled part of `calib`.
#[pymodule]
mod _calib {
    use super::{Bound, PyModule, PyModuleMethods as _, PyResult};

    #[pymodule_export]
    use super::camera::Camera;
    #[pymodule_export]
    use super::camera::Undistorter;
    #[pymodule_export]
    use super::error::CalibError;
    #[pymodule_export]
    use super::error::Finding;
    #[pymodule_export]
    use super::site::Site;
    #[pymodule_export]
    use super::stream::to_still;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("STATUS_NAMES", calib_core::Status::ALL.map(calib_core::Status::name))?;
        super::error::add_default_attributes(module)
    }
}
