"""Arrays of arguments, checked, as the native part takes them."""

from numbers import Real
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from plumbline.errors import ArgumentError, ArgumentTypeError


def kind_of(value: Any) -> str:
    """Name of the type of a value, with dtype and shape of an array."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} and shape {value.shape}"
    return f"the float {value!r}" if isinstance(value, float) else type(value).__name__


def vector(value: Any, name: str) -> Tuple[float, ...]:
    """Three real numbers of a tuple, a list or an array."""
    numbers = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(numbers, (tuple, list)) or len(numbers) != 3 or not all(isinstance(number, Real) for number in numbers):
        raise ArgumentTypeError(f"{name}: expected three numbers, got {kind_of(value)}")
    return tuple(map(float, numbers))


def content(value: Any, name: str, width: Optional[int]) -> bytes:
    """Bytes of an array-like value: of integer stamps in ns without a `width`, of rows of so many real numbers with one."""
    kinds, words, dtype = ("iu", "integer nanoseconds", "i8") if width is None else ("fiu", "numbers", "f8")
    shape = "(N,)" if width is None else f"(N, {width})"
    try:
        array = np.asarray(value)
    except Exception:
        raise ArgumentTypeError(f"{name}: expected {words} of shape {shape}, got {kind_of(value)}") from None
    if array.shape != (0,):
        wrong = f"{name}: expected {words} of shape {shape}, got {kind_of(array)}"
        if array.dtype.kind not in kinds:
            raise ArgumentTypeError(wrong)
        if array.shape[1:] != (() if width is None else (width,)) or array.ndim == 0:
            raise ArgumentError(wrong)
    return array.astype(dtype).tobytes()


def rows(arguments: Sequence[Tuple[Any, str, Optional[int]]]) -> List[bytes]:
    """Content of array-like values with their names and widths, of which there must be as many rows each."""
    contents = [content(*argument) for argument in arguments]
    counts = [len(bytes_) // (8 * (width or 1)) for bytes_, (_, _, width) in zip(contents, arguments)]
    if len(set(counts)) > 1:
        named = ", ".join(f"{count} rows of {name}" for count, (_, name, _) in zip(counts, arguments))
        raise ArgumentError(f"{named}; give as many of each")
    return contents
