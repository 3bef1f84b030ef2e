"""ROS parameters derived from the settings in config.py."""

import math
from collections.abc import Callable
from typing import Any

from rcl_interfaces import msg
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
    changed: attribute, called after every change.
    Raises ConfigError, in one line, for an invalid initial value.
    """

    def __init__(self, node: Node, *defaults: Checked) -> None:
        self._node = node
        self._records = defaults
        self._types = {
            name: type(value) for record in defaults for name, value in flatten(record).items()
        }
        self.changed: Callable[[], None] = lambda: None
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

    def __str__(self) -> str:
        values = (item for record in self._records for item in flatten(record).items())
        return ", ".join(f"{name} {value}" for name, value in values)

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
        return tuple(with_values(record, values) for record in self._records)

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Convert integers to doubles where declared: a user may set `threshold 4`."""
        return [
            Parameter(p.name, Parameter.Type.DOUBLE, float(p.value))
            if self._types.get(p.name) is float and p.type_ == Parameter.Type.INTEGER
            else p
            for p in parameters
        ]

    def _check(self, parameters: list[Parameter]) -> msg.SetParametersResult:
        try:
            self._with({p.name: p.value for p in parameters})
        except ConfigError as error:
            return msg.SetParametersResult(successful=False, reason=str(error))
        return msg.SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        self._records = self._with({p.name: p.value for p in parameters})
        self.changed()


def descriptor(value: Value, about: Setting) -> msg.ParameterDescriptor:
    """Meaning, unit and limits of a setting, as ROS tools show them."""
    text = f"{about.about} [{about.unit}]" if about.unit else about.about
    result = msg.ParameterDescriptor(description=text, read_only=not about.live)
    if about.choices:
        result.additional_constraints = f"one of {', '.join(about.choices)}"
    if about.low is not None and isinstance(value, float):
        high = math.inf if about.high is None else float(about.high)
        result.floating_point_range = [
            msg.FloatingPointRange(from_value=float(about.low), to_value=high)
        ]
    elif about.low is not None:
        top = 2**63 - 1 if about.high is None else int(about.high)
        result.integer_range = [msg.IntegerRange(from_value=int(about.low), to_value=top, step=1)]
    return result
