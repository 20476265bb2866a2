//! Conversion between NumPy arrays, or array-like values, and columns of doubles.

use numpy::{
    PyArrayDyn, PyArrayMethods as _, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods as _,
};
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyInt, PyTuple};

use crate::error::value_error;

/// NumPy array of doubles, of any shape.
pub(crate) type Doubles<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Two arrays of the same shape.
pub(crate) type Pair<'py> = (Doubles<'py>, Doubles<'py>);

/// Returns the value of a plain Python number; `None` for arrays and other values.
pub(crate) fn number(value: &Bound<'_, PyAny>) -> Option<f64> {
    if value.is_instance_of::<PyFloat>() || value.is_exact_instance_of::<PyInt>() {
        return value.extract().ok();
    }
    None
}

/// Returns a number; fails if it is not finite.
pub(crate) fn finite(py: Python<'_>, name: &str, value: f64) -> PyResult<f64> {
    if value.is_finite() {
        return Ok(value);
    }
    Err(value_error(py, None, name, format_args!("found {value}, expected a finite number")))
}

/// Returns the finite number of an optional argument, or `otherwise` if the argument is absent.
pub(crate) fn real(value: Option<&Bound<'_, PyAny>>, name: &str, otherwise: f64) -> PyResult<f64> {
    let Some(value) = value else { return Ok(otherwise) };
    let number = value.extract::<f64>().map_err(|_| {
        let found = match value.getattr("shape").and_then(|shape| shape.str()) {
            Ok(shape) => format!("an array of the shape {}", shape.to_string_lossy()),
            Err(_) => {
                value.repr().map_or_else(|_| "another object".into(), |text| short(&text.to_string_lossy()))
            }
        };
        value_error(value.py(), None, name, format_args!("found {found}, expected one number"))
    })?;
    finite(value.py(), name, number)
}

/// Returns the text of a value for an error message, cut to 60 characters.
fn short(text: &str) -> String {
    const MAX_CHARS: usize = 60;
    let short: String = text.chars().take(MAX_CHARS).collect();
    if short.len() < text.len() { format!("{short}...") } else { short }
}

/// Formats a shape as NumPy does.
pub(crate) fn shape_text(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        sides => format!("({})", sides.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Converts an array-like value of numbers to an array of doubles. Any numeric type, strides and byte order
/// are accepted. A C-contiguous array of doubles is not copied.
pub(crate) fn doubles<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Doubles<'py>> {
    if let Ok(array) = value.cast_exact::<PyArrayDyn<f64>>()
        && is_plain(array)
    {
        return Ok(array.clone());
    }
    let py = value.py();
    if value.is_none() {
        return Err(value_error(py, None, name, "found None, expected an array of numbers"));
    }
    let numpy = py.import("numpy")?;
    let array = match masked(value)? {
        Some(filled) => filled,
        None => numpy.call_method1("asarray", (value,)).map_err(|why| unreadable(py, name, &why))?,
    };
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !["i", "u", "f"].contains(&kind.as_str()) && !is_empty(&array)? {
        let found = array.getattr("dtype")?;
        return Err(value_error(
            py,
            None,
            name,
            format_args!("found values of type {found}, expected numbers"),
        ));
    }
    let plain = numpy.call_method1("require", (array, "f8", ("C", "A")))?;
    Ok(plain.cast_into::<PyArrayDyn<f64>>()?)
}

fn is_plain(array: &Doubles<'_>) -> bool {
    array.is_c_contiguous() && array.is_aligned()
}

fn is_empty(array: &Bound<'_, PyAny>) -> PyResult<bool> {
    Ok(array.getattr("size")?.extract::<usize>()? == 0)
}

fn unreadable(py: Python<'_>, name: &str, why: &PyErr) -> PyErr {
    value_error(py, None, name, format_args!("expected numbers: {}", why.value(py)))
}

/// Replaces masked values by NaN; `None` for a value without a mask. NumPy's own conversion would ignore
/// the mask.
fn masked<'py>(value: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyAny>>> {
    if !(value.hasattr("filled")? && value.hasattr("mask")?) {
        return Ok(None);
    }
    Ok(Some(value.call_method1("astype", ("f8",))?.call_method1("filled", (f64::NAN,))?))
}

/// Converts values to columns of one shape, broadcast by NumPy's rules.
pub(crate) fn columns<'py, const N: usize>(
    values: [&Bound<'py, PyAny>; N],
    names: [&str; N],
) -> PyResult<[Doubles<'py>; N]> {
    let mut arrays = Vec::with_capacity(N);
    for (value, name) in values.into_iter().zip(names) {
        arrays.push(doubles(value, name)?);
    }
    if arrays.iter().any(|array| array.shape() != arrays[0].shape()) {
        arrays = repeated(&arrays, &names.join(", "))?;
    }
    arrays
        .try_into()
        .map_err(|_| pyo3::exceptions::PySystemError::new_err("the numbers of arrays and values differ"))
}

fn repeated<'py>(arrays: &[Doubles<'py>], names: &str) -> PyResult<Vec<Doubles<'py>>> {
    let py = arrays[0].py();
    let shapes = arrays.iter().map(|array| shape_text(array.shape())).collect::<Vec<_>>().join(" and ");
    let why = |_| {
        value_error(
            py,
            None,
            names,
            format_args!("arrays of the shapes {shapes} cannot be broadcast together"),
        )
    };
    let numpy = py.import("numpy")?;
    let together = numpy.call_method1("broadcast_arrays", PyTuple::new(py, arrays)?).map_err(why)?;
    let mut plain = Vec::with_capacity(arrays.len());
    for array in together.try_iter()? {
        plain.push(doubles(&array?, names)?);
    }
    Ok(plain)
}

/// Borrows an array for reading; fails if another thread is writing to it.
pub(crate) fn read<'py>(array: &Doubles<'py>, name: &str) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    array
        .try_readonly()
        .map_err(|_| value_error(array.py(), None, name, "is being written to by another thread"))
}

/// Returns a new array of zeros.
pub(crate) fn zeros<'py, T: numpy::Element>(
    py: Python<'py>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    /// Number of values up to which an allocation is assumed to succeed.
    const MAX_SAFE_VALUES: usize = 1 << 12;
    if shape.iter().product::<usize>() <= MAX_SAFE_VALUES {
        return Ok(PyArrayDyn::<T>::zeros(py, shape, false));
    }
    // NumPy's own call raises `MemoryError` if the memory is not available; the call above would panic.
    let made =
        py.import("numpy")?.call_method1("zeros", (PyTuple::new(py, shape)?, numpy::dtype::<T>(py)))?;
    Ok(made.cast_into::<PyArrayDyn<T>>()?)
}

/// Checks the type and the shape of an array that the caller passed as output.
pub(crate) fn output<'py, T: numpy::Element>(
    value: &Bound<'py, PyAny>,
    shape: &[usize],
    kind: &str,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let fits = |array: &Bound<'py, PyArrayDyn<T>>| {
        array.shape() == shape && array.is_c_contiguous() && array.is_aligned()
    };
    match value.cast::<PyArrayDyn<T>>() {
        Ok(array) if fits(array) => Ok(array.clone()),
        _ => {
            let expected =
                format!("expected contiguous arrays of {kind} with the shape {}", shape_text(shape));
            Err(value_error(value.py(), None, "out", expected))
        }
    }
}

/// Borrows an array for writing; fails if it is in use.
pub(crate) fn write<'py, T: numpy::Element>(
    array: &Bound<'py, PyArrayDyn<T>>,
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    array.try_readwrite().map_err(|why| value_error(array.py(), None, "out", why))
}

/// Applies `map` to each pair of values of two arrays, and returns the results as two arrays of the same
/// shape. `names` are the names of the arguments, for messages.
pub(crate) fn each<'py>(
    py: Python<'py>,
    values: [&Bound<'py, PyAny>; 2],
    names: [&str; 2],
    map: impl Fn(f64, f64) -> [f64; 2],
) -> PyResult<Pair<'py>> {
    let [first, second] = columns(values, names)?;
    let (a, b) = (zeros::<f64>(py, first.shape())?, zeros::<f64>(py, first.shape())?);
    {
        let (first, second) = (read(&first, names[0])?, read(&second, names[1])?);
        let (mut a, mut b) = (write(&a)?, write(&b)?);
        let given = first.as_slice()?.iter().zip(second.as_slice()?);
        for ((&x, &y), (a, b)) in given.zip(a.as_slice_mut()?.iter_mut().zip(b.as_slice_mut()?)) {
            [*a, *b] = map(x, y);
        }
    }
    Ok((a, b))
}
