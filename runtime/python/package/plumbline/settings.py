"""Keys of a configuration that a call changes."""

import json
from typing import Any, List, Mapping, Sequence, Union

from plumbline.errors import ArgumentTypeError

Scalar = Union[bool, int, float, str]
Setting = Union[Scalar, Sequence[Any]]


def changes(settings: Mapping[str, Setting]) -> List[str]:
    """``section.key=value`` for each setting, as ``--set`` of the command line takes it."""
    return [f"{name.replace('__', '.')}={_toml(name, value)}" for name, value in settings.items()]


def _toml(name: str, value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if hasattr(value, "tolist"):
        return _toml(name, value.tolist())
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(name, entry) for entry in value) + "]"
    raise ArgumentTypeError(f"{name}: expected a number, a string, a truth value or a list of them, got {type(value).__name__}")
