"""The parameters that a command line asks for: defaults, then a file, then options."""

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml  # PyYAML, which ROS itself reads parameter files with

from ellipseg_ros.config import Config, NodeConfig, PlacementConfig
from ellipseg_ros.errors import ConfigError, reason
from ellipseg_ros.settings import Value, flatten, with_values


@dataclass(frozen=True)
class Settings:
    """All parameters of the node."""

    config: Config = field(default_factory=Config)
    node: NodeConfig = field(default_factory=NodeConfig)
    placement: PlacementConfig = field(default_factory=PlacementConfig)

    def flat(self) -> dict[str, Value]:
        """All parameters by dotted name."""
        return flatten(self.config) | flatten(self.node) | flatten(self.placement)


def read_settings(args: Namespace, defaults: dict[str, Any] | None = None) -> Settings:
    """Settings from `args.params`, `.set`, `.criterion` and `.threshold`; a later one wins.

    defaults: by dotted name, where they differ from those of config.py.
    ConfigError: an unknown name, a value of a wrong type or out of range, an invalid file.
    """
    values = (defaults or {}) | (_read_file(Path(args.params)) if args.params else {})
    for pair in args.set:
        name, equals, value = pair.partition("=")
        if not equals:
            raise ConfigError(f"--set {pair} has no value; write --set name=value")
        values[name.strip()] = value.strip()
    named = {"criterion": args.criterion, "threshold": args.threshold}
    values |= {name: value for name, value in named.items() if value is not None}
    return with_settings(Settings(), values)


def with_settings(settings: Settings, values: dict[str, Any]) -> Settings:
    """`settings` with changes by dotted name; text is converted to the type of the parameter."""
    defaults = settings.flat()
    unknown = values.keys() - defaults.keys()
    if unknown:
        name = min(unknown)
        similar = get_close_matches(name, defaults, 3, 0.0)
        raise ConfigError(
            f"there is no setting {name}; did you mean {', '.join(similar)}? "
            "config/segmenter.yaml lists all"
        )
    typed = {name: _typed(name, value, defaults[name]) for name, value in values.items()}
    return Settings(
        with_values(settings.config, typed),
        with_values(settings.node, typed),
        with_values(settings.placement, typed),
    )


def parameter_file(values: Mapping[str, Any]) -> str:
    """The text of a ROS parameter file with settings by dotted name."""
    parameters: dict[str, Any] = {}
    for name, value in values.items():
        *path, last = name.split(".")
        group = parameters
        for part in path:
            group = group.setdefault(part, {})
        group[last] = value
    return yaml.safe_dump({"/**": {"ros__parameters": parameters}}, sort_keys=False)


def _typed(name: str, value: Any, default: Value | None) -> Any:
    """Text as the type of `default`; YAML too reads 1e-4 as text. Other values are unchanged."""
    if not isinstance(value, str) or default is None or isinstance(default, str):
        return value
    if isinstance(default, bool):
        if value.lower() not in ("true", "false"):
            raise ConfigError(f"{name} is {value!r}; it must be true or false")
        return value.lower() == "true"
    try:
        return type(default)(value)
    except ValueError:
        kind = "a whole number" if isinstance(default, int) else "a number"
        raise ConfigError(f"{name} is {value!r}; it must be {kind}") from None


def _read_file(path: Path) -> dict[str, Any]:
    """Values by dotted name from a ROS parameter file, with or without its two outer keys."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is no YAML: {reason(error)}") from error
    values = _flat(content, "") if isinstance(content, dict) else {}
    values.pop("use_sim_time", None)  # of ROS itself; results depend on stamps alone
    if not values:
        raise ConfigError(f"{path} holds no settings; see config/segmenter.yaml for an example")
    return values


def _flat(content: Any, prefix: str) -> dict[str, Any]:
    """Nested mappings by dotted name, without the name of a node and `ros__parameters`."""
    if not isinstance(content, dict):
        return {prefix.rstrip("."): content}
    if "ros__parameters" in content:
        return _flat(content["ros__parameters"], "")
    inner = (_flat(value, f"{prefix}{key}.") for key, value in content.items())
    return {name: value for values in inner for name, value in values.items()}
