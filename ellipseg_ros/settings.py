"""Records of settings with meaning, unit and limits, which check themselves."""

import numbers
from collections.abc import Callable, Iterator
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from functools import partial
from typing import Any, TypeVar

from ellipseg_ros.errors import ConfigError

T = TypeVar("T")
Value = bool | int | float | str


@dataclass(frozen=True)
class Setting:
    """Meaning and limits of one setting: the metadata of a field."""

    about: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    allowed: tuple[str, ...] | Callable[[], tuple[str, ...]] = ()
    live: bool = True  # may change while the node runs

    @property
    def choices(self) -> tuple[str, ...]:
        """The values that are allowed; empty: all within the limits."""
        return self.allowed() if callable(self.allowed) else self.allowed


def setting(default: Any, *about: Any, **options: Any) -> Any:
    """A dataclass field with the metadata Setting(*about, **options)."""
    return field(default=default, metadata={"setting": Setting(*about, **options)})


fixed = partial(setting, live=False)  # a setting that can't change while the node runs


@dataclass(frozen=True)
class Checked:
    """A record of settings that refuses values of a wrong type or out of range."""

    def __post_init__(self) -> None:
        for item in fields(self):
            if "setting" in item.metadata:
                value = checked(item, getattr(self, item.name))
                object.__setattr__(self, item.name, value)
            elif not isinstance(getattr(self, item.name), Checked):
                kind = item.default_factory.__name__  # type: ignore[union-attr]  # nested records
                raise ConfigError(
                    f"{item.name} is {getattr(self, item.name)!r}; it must be a {kind}"
                )


def checked(item: Field[Any], value: Any) -> Any:
    """Return `value` as the field's type, or raise ConfigError in one line."""
    limits: Setting = item.metadata["setting"]
    kind: Any = type(item.default)
    number = converted(kind, value)
    if number is None:
        raise ConfigError(
            f"{item.name} is {value!r}, of type {type(value).__name__}; it must be {kind.__name__}"
        )
    if limits.choices and number not in limits.choices:
        raise ConfigError(
            f"{item.name} is {value!r}; it must be one of {', '.join(limits.choices)}"
        )
    low, high = limits.low, limits.high
    if low is not None and high is not None and not low <= number <= high:
        span = f"from {low:g} to {high:g} {limits.unit}".rstrip()
        raise ConfigError(f"{item.name} is {value:g}; it must be {span}")
    return number


def converted(kind: Any, value: Any) -> Any:
    """Convert a number to `kind` if that loses nothing (numpy type, integer width); else None."""
    if isinstance(value, bool) or kind not in (int, float):
        return value if type(value) is kind else None
    wider = numbers.Integral if kind is int else numbers.Real
    return kind(value) if isinstance(value, wider) else None


def flatten(config: Checked, prefix: str = "") -> dict[str, Value]:
    """Settings by dotted name: {"graph.neighbours": 10, ...}, in the order of the classes."""
    return {name: value for name, value, _ in iterate_settings(config, prefix)}


def iterate_settings(config: Checked, prefix: str = "") -> Iterator[tuple[str, Value, Setting]]:
    """Yield (dotted name, value, meaning and limits) of every setting."""
    for item in fields(config):
        value = getattr(config, item.name)
        if is_dataclass(value):
            yield from iterate_settings(value, f"{prefix}{item.name}.")  # type: ignore[arg-type]  # Checked by design
        else:
            yield prefix + item.name, value, item.metadata["setting"]


def with_values(config: T, values: dict[str, Any], prefix: str = "") -> T:
    """Copy of `config` with settings by dotted name changed; names of others are ignored."""
    changes: dict[str, Any] = {}
    for item in fields(config):  # type: ignore[arg-type]  # dataclass
        value = getattr(config, item.name)
        if is_dataclass(value):
            changes[item.name] = with_values(value, values, f"{prefix}{item.name}.")
        else:
            changes[item.name] = values.get(prefix + item.name, value)
    return replace(config, **changes)  # type: ignore[type-var]  # dataclass
