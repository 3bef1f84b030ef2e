"""ROS parameters derived from the settings in config.py."""

import math
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from ellipseg_ros.errors import ConfigError
from ellipseg_ros.settings import Checked, Setting, Value, flatten, iterate_settings, with_values

RCLPY_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


class Parameters:
    """The parameters of a node, one for each setting of one or more records.

    node: created with `automatically_declare_parameters_from_overrides`, so that all values of
        the command line and of YAML files are known, misspelt ones included.
    defaults: records with disjoint names.
    Raises ConfigError, in one line, for an invalid initial value.
    """

    def __init__(self, node: Node, *defaults: Checked) -> None:
        self._node = node
        self._records = defaults
        self._types = {
            name: type(value) for record in defaults for name, value in flatten(record).items()
        }
        self._changed: Callable[[], None] = lambda: None
        self._records = self._with(self._initial_values())
        for record in self._records:
            for name, value, about in iterate_settings(record):
                node.declare_parameter(name, value, descriptor(value, about), ignore_override=True)
        node.add_pre_set_parameters_callback(self._convert)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def records(self) -> tuple[Any, ...]:
        """The present settings, in the order of the defaults."""
        return self._records

    def on_change(self, callback: Callable[[], None]) -> None:
        """Set the callback that is called after every change."""
        self._changed = callback

    def _initial_values(self) -> dict[str, Any]:
        """Return and undeclare the values given at the start; warn of unknown names."""
        initial = {}
        for name, parameter in self._node.get_parameters_by_prefix("").items():
            if name in self._types:
                initial[name] = parameter.value
                self._node.undeclare_parameter(name)
            elif not name.startswith(RCLPY_PARAMETERS):
                names = ", ".join(self._types)
                self._node.get_logger().warning(f"there is no parameter {name}; there are {names}")
        return initial

    def _with(self, values: dict[str, Any]) -> tuple[Checked, ...]:
        """Copies of the records with changed values; raises ConfigError."""
        changed = []
        for record in self._records:
            own = flatten(record).keys() & values.keys()
            changed.append(with_values(record, {name: values[name] for name in own}))
        return tuple(changed)

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Convert integers to doubles where declared: a user may set `threshold 4`."""
        return [
            Parameter(p.name, Parameter.Type.DOUBLE, float(p.value))
            if self._types.get(p.name) is float and p.type_ == Parameter.Type.INTEGER
            else p
            for p in parameters
        ]

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._with({p.name: p.value for p in parameters})
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        self._records = self._with({p.name: p.value for p in parameters})
        self._changed()


def descriptor(value: Value, about: Setting) -> ParameterDescriptor:
    """Meaning, unit and limits of a setting, as ROS tools show them."""
    result = ParameterDescriptor(description=description(about), read_only=not about.live)
    if about.choices:
        result.additional_constraints = f"one of {', '.join(about.choices)}"
    if about.low is not None and isinstance(value, float):
        high = math.inf if about.high is None else float(about.high)
        result.floating_point_range = [
            FloatingPointRange(from_value=float(about.low), to_value=high)
        ]
    elif about.low is not None:
        top = 2**63 - 1 if about.high is None else int(about.high)
        result.integer_range = [IntegerRange(from_value=int(about.low), to_value=top, step=1)]
    return result


def description(about: Setting) -> str:
    """Meaning and unit of a setting in one line."""
    return f"{about.about} [{about.unit}]" if about.unit else about.about


def as_yaml(*records: Checked, node: str = "segmenter") -> str:
    """Parameter file with every setting, its meaning and limits, as in config/."""
    lines = [
        f"# Every parameter of the {node} and its default; written from ellipseg_ros/config.py.",
        "/**:",
        "  ros__parameters:",
    ]
    section: list[str] = []
    for record in records:
        for name, value, about in iterate_settings(record):
            *path, last = name.split(".")
            if path != section:
                lines += [f"    {'  ' * k}{part}:" for k, part in enumerate(path)]
                section = path
            indent = "    " + "  " * len(path)
            lines += [f"{indent}# {line}" for line in _comment(about)]
            shown = str(value).lower() if isinstance(value, bool) else value
            if value == "":
                shown = '""'
            lines.append(f"{indent}{last}: {shown}")
    return "\n".join(lines) + "\n"


def _comment(about: Setting) -> list[str]:
    limits = []
    if about.choices:
        limits.append("one of " + ", ".join(about.choices))
    if about.low is not None:
        top = "" if about.high is None else f" to {about.high:g}"
        limits.append(f"from {about.low:g}{top}")
    if not about.live:
        limits.append("fixed while the node runs")
    return [description(about), *(["; ".join(limits)] if limits else [])]
