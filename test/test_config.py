import pytest

from ellipseg_ros.config import Config, GraphConfig, NodeConfig
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.settings import flatten, iterate_settings, with_values


def test_every_setting_is_described_and_its_default_valid():
    for config in (Config(), NodeConfig()):
        for name, value, limits in iterate_settings(config):
            assert limits.about, name
            assert with_values(config, {name: value}) == config
            if limits.low is not None:
                assert limits.low <= value <= limits.high


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"criterion": "size"}, "one of shape, density, parsimony"),
        ({"threshold": -0.5}, "0 or more, or -1"),
        ({"window_duration": 0.0}, "from 0.01 to 86400 s"),
        ({"window_duration": float("nan")}, "window_duration is nan"),
        ({"window_duration": "25"}, "of type str; it must be float"),
        ({"graph.neighbours": 2}, "neighbours is 2; it must be from 3"),
        ({"graph.neighbours": 10.0}, "must be int"),
        ({"graph.neighbours": True}, "must be int"),
    ],
)
def test_bad_value_is_refused_in_one_line(values, words):
    with pytest.raises(ConfigError, match=words) as error:
        with_values(Config(), values)
    assert "\n" not in str(error.value)


def test_integer_is_accepted_for_a_double():
    config = Config(threshold=5, window_duration=10)
    assert (config.threshold, config.window_duration) == (5.0, 10.0)
    assert isinstance(config.threshold, float)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("unset", [None, -1, -1.0])
def test_unset_threshold_is_the_default_of_the_criterion(criterion, unset):
    assert (
        Config(criterion=criterion, threshold=unset).tau == CRITERIA[criterion].default_threshold
    )


def test_nested_settings_have_dotted_names():
    assert flatten(Config())["graph.neighbours"] == 10
    changed = with_values(Config(), {"graph.neighbours": 5, "threshold": 2.0})
    assert changed == Config(threshold=2.0, graph=GraphConfig(neighbours=5))
