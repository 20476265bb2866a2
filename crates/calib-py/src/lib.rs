//! A calibrated site in Python: pixels to the floor and back as NumPy arrays, and the solve.
//!
//! What is computed stands in `calib-core`; here are Python's types, its errors and its arrays. The folder
//! `python/` has what is better said in Python: the statuses, and entries of a site file.

#![allow(clippy::doc_markdown, reason = "what stands on a class is the documentation of Python")]

mod error;
mod array;
mod stream;
mod camera;
mod mapping;
mod boxes;
mod site;
mod table;

use pyo3::prelude::*;

/// The part of `calib` that is compiled.
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
        super::error::declare(module)
    }
}
