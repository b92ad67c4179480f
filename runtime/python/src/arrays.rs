//! Arrays of numpy, made of bytes by its own functions: no ABI of numpy is linked, so any version of it will do.
//!
//! Input is small and copied, except for [images](crate::image).

use crate::errors::{ArgumentError, ArgumentTypeError};
use bytemuck::NoUninit;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyByteArray, PyBytes, PyFloat, PyList, PyTuple};

/// Function of the module `numpy`.
fn numpy<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    static NUMPY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let module = NUMPY.get_or_try_init(py, || py.import("numpy").map(|module| module.into_any().unbind()))?;
    module.bind(py).getattr(name)
}

/// The class `numpy.ndarray`.
pub fn ndarray<'py>(py: Python<'py>) -> PyResult<&'py Bound<'py, PyAny>> {
    static NDARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    Ok(NDARRAY.get_or_try_init(py, || numpy(py, "ndarray").map(Bound::unbind))?.bind(py))
}

/// A number that arrays hold.
pub trait Number: NoUninit {
    /// Its dtype.
    const DTYPE: &'static str;
}

macro_rules! numbers {
    ($($number:ty, $dtype:literal;)*) => {$(
        impl Number for $number {
            const DTYPE: &'static str = $dtype;
        }
    )*};
}

numbers! { f64, "f8"; i64, "i8"; u64, "u8"; u32, "u4"; i8, "i1"; u8, "u1"; bool, "?"; }

/// Array of `numbers` in rows of the shape `row` (empty: one number each). It may be written.
pub fn column<'py, T: Number>(py: Python<'py>, numbers: &[T], row: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    let rows = numbers.len() / row.iter().product::<usize>().max(1);
    let shape: Vec<usize> = std::iter::once(rows).chain(row.iter().copied()).collect();
    block(py, numbers, &shape)
}

/// Array of `numbers` of exactly this shape. It may be written.
pub fn block<'py, T: Number>(py: Python<'py>, numbers: &[T], shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    let bytes = PyByteArray::new(py, bytemuck::cast_slice(numbers));
    numpy(py, "frombuffer")?.call1((bytes, T::DTYPE))?.call_method1("reshape", (PyTuple::new(py, shape)?,))
}

/// An integer number of nanoseconds.
pub fn nanoseconds(value: &Bound<'_, PyAny>, name: &str) -> PyResult<i64> {
    value.extract().map_err(|_| {
        let message = format!("{name}: expected an integer number of nanoseconds, got {}", kind_of(value));
        ArgumentTypeError::new_err(message)
    })
}

/// Three numbers: a sequence, or an array of shape (3,).
pub fn vector(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vector3<f64>> {
    let py = value.py();
    let wrong = || {
        let message = format!("{name}: expected three numbers, got {}", kind_of(value));
        ArgumentTypeError::new_err(message)
    };
    let list;
    let sequence = if value.is_instance_of::<PyTuple>() || value.is_instance_of::<PyList>() {
        value
    } else if value.is_instance(ndarray(py)?)? {
        list = value.call_method0("tolist")?;
        &list
    } else {
        return Err(wrong());
    };
    let numbers: [f64; 3] = sequence.extract().map_err(|_| wrong())?;
    Ok(Vector3::from(numbers))
}

/// Name of the type of a value, with dtype and shape of an array.
pub fn kind_of(value: &Bound<'_, PyAny>) -> String {
    let described = || -> PyResult<String> {
        let py = value.py();
        if value.is_instance(ndarray(py)?)? {
            return Ok(format!(
                "an array of {} and shape {}",
                value.getattr("dtype")?,
                value.getattr("shape")?
            ));
        }
        if value.is_instance_of::<PyFloat>() {
            return Ok(format!("the float {}", value.repr()?));
        }
        Ok(value.get_type().name()?.to_string())
    };
    described().unwrap_or_else(|_| "an object".into())
}

/// Real numbers of an array-like value of the shape (N, `width`), or (N,) for a width of 1, copied.
pub fn numbers(value: &Bound<'_, PyAny>, name: &str, width: usize) -> PyResult<Vec<f64>> {
    let shape = if width == 1 { "(N,)".to_owned() } else { format!("(N, {width})") };
    let bytes = bytes(value, (name, "fiu", "numbers", &shape), "float64", width)?;
    Ok(bytes.as_bytes().as_chunks().0.iter().copied().map(f64::from_ne_bytes).collect())
}

/// Stamps of an array-like value of the shape (N,), copied.
pub fn stamps(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<i64>> {
    let bytes = bytes(value, (name, "iu", "integer nanoseconds", "(N,)"), "int64", 1)?;
    Ok(bytes.as_bytes().as_chunks().0.iter().copied().map(i64::from_ne_bytes).collect())
}

/// Content of an array-like value, after a check of the kind of its numbers and of its shape.
fn bytes<'py>(
    value: &Bound<'py, PyAny>,
    (name, kinds, words, shape): (&str, &str, &str, &str),
    dtype: &str,
    width: usize,
) -> PyResult<Bound<'py, PyBytes>> {
    let py = value.py();
    let wrong = |class: fn(String) -> PyErr, got: &Bound<'_, PyAny>| {
        class(format!("{name}: expected {words} of shape {shape}, got {}", kind_of(got)))
    };
    let array = numpy(py, "asarray")?
        .call1((value,))
        .map_err(|_| wrong(ArgumentTypeError::new_err::<String>, value))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let sizes: Vec<usize> = array.getattr("shape")?.extract()?;
    let is_empty = sizes == [0];
    if !kinds.contains(&kind) && !is_empty {
        return Err(wrong(ArgumentTypeError::new_err::<String>, &array));
    }
    let fits = match sizes[..] {
        [_] => width == 1 || is_empty,
        [_, columns] => width > 1 && columns == width,
        _ => false,
    };
    if !fits {
        return Err(wrong(ArgumentError::new_err::<String>, &array));
    }
    let copied = array.call_method1("astype", (dtype,))?.call_method0("tobytes")?;
    Ok(copied.cast_into::<PyBytes>()?)
}
