//! Arrays of numpy, by its array interface: no ABI of numpy is linked, so any version of it will do.
//!
//! Arrays without copies: a [`Column`] owns numbers that an array views and keeps alive, and the arrays of an
//! estimate view the estimate itself. Input is small and copied, except for [images](crate::image).

use crate::errors::Class;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyDict, PyFloat, PyList, PyTuple};

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

/// A number that arrays hold, by its name in the array interface.
pub trait Number: Copy + Send + Sync + 'static {
    /// Kind and size.
    const TYPE: &'static str;
}

impl Number for f64 {
    const TYPE: &'static str = "<f8";
}
impl Number for i64 {
    const TYPE: &'static str = "<i8";
}
impl Number for u64 {
    const TYPE: &'static str = "<u8";
}
impl Number for u32 {
    const TYPE: &'static str = "<u4";
}
impl Number for i8 {
    const TYPE: &'static str = "|i1";
}
impl Number for u8 {
    const TYPE: &'static str = "|u1";
}
impl Number for bool {
    const TYPE: &'static str = "|b1";
}

/// Memory as numpy is told of it.
struct Interface {
    address: usize,
    is_read_only: bool,
    shape: Vec<usize>,
    /// Bytes from element to element along each axis; `None` for rows without padding.
    strides: Option<Vec<usize>>,
    kind: &'static str,
}

impl Interface {
    fn dictionary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dictionary = PyDict::new(py);
        dictionary.set_item("version", 3)?;
        dictionary.set_item("data", (self.address, self.is_read_only))?;
        dictionary.set_item("shape", PyTuple::new(py, &self.shape)?)?;
        dictionary.set_item("typestr", self.kind)?;
        match &self.strides {
            Some(strides) => dictionary.set_item("strides", PyTuple::new(py, strides)?)?,
            None => dictionary.set_item("strides", py.None())?,
        }
        Ok(dictionary)
    }
}

/// Memory that an array views: numbers of its own, or those of an object that is kept alive and never changed or moved.
#[pyclass(frozen, module = "plumbline._native")]
pub struct Column {
    interface: Interface,
    /// Keeps the memory.
    _owner: Owner,
}

/// Owner of the memory of a [`Column`].
enum Owner {
    Object(#[allow(dead_code)] Py<PyAny>),
    Numbers(#[allow(dead_code)] Box<dyn std::any::Any + Send + Sync>),
}

#[pymethods]
impl Column {
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.interface.dictionary(py)
    }
}

fn array(py: Python<'_>, column: Column) -> PyResult<Bound<'_, PyAny>> {
    static ASARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let asarray = ASARRAY.get_or_try_init(py, || numpy(py, "asarray").map(Bound::unbind))?;
    asarray.bind(py).call1((column,))
}

/// Array of `numbers` in rows of the shape `row` (empty: one number each). It may be written.
pub fn column<'py, T: Number>(
    py: Python<'py>,
    mut numbers: Vec<T>,
    row: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    let rows = numbers.len() / row.iter().product::<usize>().max(1);
    let shape = std::iter::once(rows).chain(row.iter().copied()).collect();
    shaped(py, &mut numbers, shape)
        .and_then(|interface| array(py, Column { interface, _owner: Owner::Numbers(Box::new(numbers)) }))
}

/// Array of `numbers` of exactly this shape. It may be written.
pub fn block<'py, T: Number>(
    py: Python<'py>,
    mut numbers: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    shaped(py, &mut numbers, shape.to_vec())
        .and_then(|interface| array(py, Column { interface, _owner: Owner::Numbers(Box::new(numbers)) }))
}

fn shaped<T: Number>(py: Python<'_>, numbers: &mut [T], shape: Vec<usize>) -> PyResult<Interface> {
    if shape.iter().product::<usize>() != numbers.len() {
        return Err(Class::Run.error(py, "an array does not fill its shape"));
    }
    // The numbers stay where they are when their vector is moved, and nothing but the array looks at them.
    let address = numbers.as_mut_ptr().expose_provenance();
    Ok(Interface { address, is_read_only: false, shape, strides: None, kind: T::TYPE })
}

/// Read-only array that views `numbers` inside `owner`, an object whose class is frozen: its content is neither changed nor
/// moved as long as it lives. `strides` are in numbers.
pub fn view<'py>(
    owner: &Bound<'py, PyAny>,
    numbers: &[f64],
    shape: &[usize],
    strides: Option<&[usize]>,
) -> PyResult<Bound<'py, PyAny>> {
    let strides = strides.map(|strides| strides.iter().map(|stride| stride * size_of::<f64>()).collect());
    let address = numbers.as_ptr().expose_provenance();
    let interface = Interface {
        address,
        is_read_only: true,
        shape: shape.to_vec(),
        strides,
        kind: <f64 as Number>::TYPE,
    };
    array(owner.py(), Column { interface, _owner: Owner::Object(owner.clone().unbind()) })
}

/// An integer number of nanoseconds.
pub fn nanoseconds(value: &Bound<'_, PyAny>, name: &str) -> PyResult<i64> {
    value.extract().map_err(|_| {
        let message = format!("{name}: expected an integer number of nanoseconds, got {}", kind_of(value));
        Class::ArgumentType.error(value.py(), message)
    })
}

/// Three numbers: a sequence, or an array of shape (3,).
pub fn vector(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vector3<f64>> {
    let py = value.py();
    let wrong = || {
        let message = format!("{name}: expected three numbers, got {}", kind_of(value));
        Class::ArgumentType.error(py, message)
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
    let wrong = |class: Class, got: &Bound<'_, PyAny>| {
        class.error(py, format!("{name}: expected {words} of shape {shape}, got {}", kind_of(got)))
    };
    let array = numpy(py, "asarray")?.call1((value,)).map_err(|_| wrong(Class::ArgumentType, value))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let sizes: Vec<usize> = array.getattr("shape")?.extract()?;
    let is_empty = sizes == [0];
    if !kinds.contains(&kind) && !is_empty {
        return Err(wrong(Class::ArgumentType, &array));
    }
    let fits = match sizes[..] {
        [_] => width == 1 || is_empty,
        [_, columns] => width > 1 && columns == width,
        _ => false,
    };
    if !fits {
        return Err(wrong(Class::Argument, &array));
    }
    let copied = array.call_method1("astype", (dtype,))?.call_method0("tobytes")?;
    Ok(copied.cast_into::<PyBytes>()?)
}
