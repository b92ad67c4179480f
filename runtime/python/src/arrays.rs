//! Arrays of numpy, made of bytes by its own functions: no ABI of numpy is linked, so any version of it will do.
//!
//! Input is small and copied, except for [images](crate::image).

use crate::errors::ArgumentTypeError;
use bytemuck::NoUninit;
use nalgebra::Vector3;
use pyo3::call::PyCallArgs;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyByteArray, PyTuple};

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
    Ok(checked(value.py(), "vector", (value, name))?.extract::<[f64; 3]>()?.into())
}

/// Result of a function of `plumbline._arguments`, which checks arguments.
fn checked<'py>(py: Python<'py>, name: &str, arguments: impl PyCallArgs<'py>) -> PyResult<Bound<'py, PyAny>> {
    py.import("plumbline._arguments")?.call_method1(name, arguments)
}

/// Name of the type of a value, with dtype and shape of an array.
pub fn kind_of(value: &Bound<'_, PyAny>) -> String {
    let described = checked(value.py(), "kind_of", (value,)).and_then(|words| words.extract());
    described.unwrap_or_else(|_| "an object".into())
}

/// Stamps of an array-like value of the shape (N,), copied.
pub fn stamps(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<i64>> {
    Ok(stamps_of(&checked(value.py(), "content", (value, name, None::<usize>))?.extract::<Vec<u8>>()?))
}

fn stamps_of(bytes: &[u8]) -> Vec<i64> {
    bytes.as_chunks().0.iter().copied().map(i64::from_ne_bytes).collect()
}

/// A stamp and its numbers.
type Row<const A: usize, const B: usize> = (i64, [f64; A], [f64; B]);

/// Stamps and rows of `A` and `B` numbers of three array-like values with their names, as many of each.
pub fn rows<const A: usize, const B: usize>(
    [stamps, a, b]: [(&Bound<'_, PyAny>, &str); 3],
) -> PyResult<Vec<Row<A, B>>> {
    let arguments = [(stamps.0, stamps.1, None), (a.0, a.1, Some(A)), (b.0, b.1, Some(B))];
    let [stamps, a, b]: [Vec<u8>; 3] = checked(stamps.0.py(), "rows", (arguments.to_vec(),))?.extract()?;
    let rows = stamps_of(&stamps).into_iter().zip(numbers(&a)).zip(numbers(&b));
    Ok(rows.map(|((stamp, a), b)| (stamp, a, b)).collect())
}

fn numbers<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [f64; N]> {
    let numbers: Vec<f64> = bytes.as_chunks().0.iter().copied().map(f64::from_ne_bytes).collect();
    numbers.as_chunks().0.to_vec().into_iter()
}
