"""The settings that a command line asks for: defaults, then a file, then options."""

from argparse import Namespace
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml  # PyYAML, which ROS itself reads parameter files with

from ellipseg_ros.config import Config, NodeConfig, Value, flatten, with_values
from ellipseg_ros.errors import ConfigError


@dataclass(frozen=True)
class Settings:
    """Everything that the node's parameters say."""

    config: Config = field(default_factory=Config)
    node: NodeConfig = field(default_factory=NodeConfig)

    def flat(self) -> dict[str, Value]:
        """All of them by dotted name."""
        return flatten(self.config) | flatten(self.node)


def read_settings(args: Namespace, defaults: dict[str, Any] | None = None) -> Settings:
    """Settings from `args.params`, `.set`, `.criterion` and `.threshold`; a later one wins.

    defaults: by dotted name, where they differ from those of config.py.
    ConfigError: a name that does not exist, a value of a wrong type or out of range, a bad file.
    """
    values = dict(defaults or {})
    if args.params:
        values |= _from_file(Path(args.params))
    for pair in args.set:
        name, equals, value = pair.partition("=")
        if not equals:
            raise ConfigError(f"--set {pair} has no value; write --set name=value")
        values[name.strip()] = value.strip()
    values |= {
        name: value
        for name, value in (("criterion", args.criterion), ("threshold", args.threshold))
        if value is not None
    }
    return with_settings(Settings(), values)


def with_settings(settings: Settings, values: dict[str, Any]) -> Settings:
    """`settings` with some changed, by dotted name; texts become what the setting needs."""
    defaults = settings.flat()
    typed = {name: _typed(name, value, defaults.get(name)) for name, value in values.items()}
    of_node = {name: value for name, value in typed.items() if name in flatten(settings.node)}
    unknown = typed.keys() - defaults.keys()
    if unknown:
        raise ConfigError(f"there is no setting {min(unknown)}; there are {', '.join(defaults)}")
    of_config = {name: value for name, value in typed.items() if name not in of_node}
    return Settings(with_values(settings.config, of_config), with_values(settings.node, of_node))


def _typed(name: str, value: Any, default: Value | None) -> Any:
    """`value` as the type of `default` if it is text; YAML leaves 1e-4 as text, too."""
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


def _from_file(path: Path) -> dict[str, Any]:
    """Settings by dotted name from a ROS parameter file, with or without its two outer keys."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"{path} is no YAML: {reason}") from error
    values: dict[str, Any] = {}
    if isinstance(content, dict):
        _collect(content, "", values)
    values.pop("use_sim_time", None)  # ROS's own; results come from stamps alone
    if not values:
        raise ConfigError(f"{path} holds no settings; config/segmenter.yaml shows how it looks")
    return values


def _collect(content: Any, prefix: str, values: dict[str, Any]) -> None:
    """Nested mappings to dotted names; a node's name and `ros__parameters` are no part of them."""
    if not isinstance(content, dict):
        values[prefix.rstrip(".")] = content
        return
    if "ros__parameters" in content:
        _collect(content["ros__parameters"], "", values)
        return
    for key, inner in content.items():
        _collect(inner, f"{prefix}{key}.", values)
