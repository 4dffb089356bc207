# SPDX-License-Identifier: Apache-2.0
"""One helper reads a checked dataclass from a file, and names the file in every refusal."""
from dataclasses import dataclass

import pytest

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.config.files import load_config
from ballbot_ros.config.provenance import Provenance, read_values
from ballbot_ros.errors import ConfigurationError


@dataclass(frozen=True)
class Range(Checked):
    """Two numbers of which one must be above the other."""

    low: float = quantity('m', 'lower end', minimum=0.0)
    high: float = quantity('m', 'upper end', default=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low > self.high:
            raise ConfigurationError(f'Range: low must be at most high, got {self.low:g}')


def test_a_file_of_ones_own_is_read_by_its_path(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('low: 1e-1\n')
    assert load_config(Range, 'ranges', str(path)) == Range(0.1, 1.0)


@pytest.mark.parametrize('content, complaint', [
    ('low: 2.0', 'low must be at most high, got 2'), ('low: -1', 'low must be at least 0 m'),
    ('high: 2', 'low is missing'), ('low: 0\nhihg: 1', "did you mean 'high'"),
    ('low: 0\nlow: 1', "'low' is given twice"), ('low: [', 'not valid YAML')])
def test_every_refusal_names_the_file_and_what_is_wrong(tmp_path, content, complaint):
    path = tmp_path / 'mine.yaml'
    path.write_text(content)
    with pytest.raises(ConfigurationError, match=complaint) as refusal:
        load_config(Range, 'ranges', str(path))
    assert str(refusal.value).startswith(str(path))


def test_a_value_carries_where_it_comes_from():
    values, provenance = read_values(
        Range, {'low': {'value': 0.2, 'source': 'measured', 'range': [0.1, 0.3]}, 'high': 2}, 'x')
    assert values == {'low': 0.2, 'high': 2.0}
    assert provenance == {'low': Provenance('measured', 0.1, 0.3)}
