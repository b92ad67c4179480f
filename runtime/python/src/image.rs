//! Images lent by Python: a view of the pixels of a numpy array, without a copy.

use crate::arrays::{kind_of, ndarray};
use crate::errors::{ArgumentError, ArgumentTypeError};
use plumbline_config::ImageView;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;

/// Pixels of a numpy array that is kept alive.
#[derive(Debug)]
pub struct LentImage {
    address: usize,
    stride: usize,
    size_px: (usize, usize),
    _array: Py<PyAny>,
}

impl LentImage {
    /// Checks that `value` is an image of `size_px` (width, height): an array of uint8 of the shape (height, width), with
    /// pixels side by side. `name` names it in messages.
    ///
    /// # Errors
    /// When it is none.
    pub fn of(value: &Bound<'_, PyAny>, name: &str, size_px: (usize, usize)) -> PyResult<Self> {
        let py = value.py();
        let (width, height) = size_px;
        let refuse = |class: fn(String) -> PyErr, cure: &str| {
            let message = format!(
                "{name}: expected a numpy array of uint8 and shape ({height}, {width}), got {}; {cure}",
                kind_of(value)
            );
            Err(class(message))
        };
        if !value.is_instance(ndarray(py)?)? {
            return refuse(
                ArgumentTypeError::new_err::<String>,
                "pass the image itself, or None for one that did not arrive",
            );
        }
        let interface = interface(value)?;
        let part =
            |key: &str| interface.get_item(key).map(|part| part.unwrap_or_else(|| py.None().into_bound(py)));
        let kind: String = part("typestr")?.extract()?;
        if kind != "|u1" {
            return refuse(ArgumentTypeError::new_err::<String>, "convert it to 8-bit grey");
        }
        let shape: Vec<usize> = part("shape")?.extract()?;
        if shape != [height, width] {
            return refuse(
                ArgumentError::new_err::<String>,
                "give the grey image of the size that the configuration says",
            );
        }
        let stride = match part("strides")?.extract::<Option<[isize; 2]>>()? {
            None => width,
            Some([row, 1]) if row >= width as isize => row as usize,
            // Of a single column or row numpy may say anything.
            Some(_) => {
                return refuse(
                    ArgumentError::new_err::<String>,
                    "its pixels do not lie side by side; pass numpy.ascontiguousarray(image)",
                );
            }
        };
        let (address, _): (usize, bool) = part("data")?.extract()?;
        Ok(Self { address, stride, size_px, _array: value.clone().unbind() })
    }

    /// The image.
    pub fn view(&self) -> Option<ImageView<'_>> {
        let (width, height) = self.size_px;
        let bytes = self.stride * height.checked_sub(1)? + width;
        let pixels = std::ptr::with_exposed_provenance::<u8>(self.address);
        // SAFETY: `of` has made sure that this is an array of uint8 of `height` rows of `width` bytes each, `stride` >= `width`
        // apart; numpy vouches for the addresses, since the interface was read by its own class, not by an attribute that a
        // derived class may replace. All rows lie in one buffer, so the `bytes` from the first pixel to the last are in it.
        // The array is kept alive by `_array`, and numpy does not give its memory back, nor resize it in place, while there is
        // that reference. That nobody writes to the pixels while they are lent, which another thread could do, is what the
        // documentation of `Estimator.add_frame` asks of its caller, as numpy does for its own calls without the GIL.
        #[allow(unsafe_code)]
        let pixels = unsafe { std::slice::from_raw_parts(pixels, bytes) };
        ImageView::new(width, height, self.stride, pixels).ok()
    }
}

/// Array interface of `array` as `numpy.ndarray` itself gives it.
fn interface<'py>(array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    static GET: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = array.py();
    let get = GET.get_or_try_init(py, || {
        ndarray(py)?.getattr("__array_interface__")?.getattr("__get__").map(Bound::unbind)
    })?;
    Ok(get.bind(py).call1((array,))?.cast_into::<PyDict>()?)
}
