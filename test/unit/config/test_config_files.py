# SPDX-License-Identifier: Apache-2.0
"""One helper reads a checked dataclass from a file, and names the file in every refusal."""
import ast
from dataclasses import dataclass
from pathlib import Path

import pytest
from refusals import refused

import ballbot_ros
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
            raise ConfigurationError(
                f'Range: low must be at most high, got {self.low:g}', 'inconsistent', 'low')


def test_a_file_of_ones_own_is_read_by_its_path(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('low: 1e-1\n')
    assert load_config(Range, 'ranges', str(path)) == Range(0.1, 1.0)


@pytest.mark.parametrize('content, reason, field', [
    ('low: 2.0', 'inconsistent', 'low'), ('low: -1', 'out_of_range', 'low'),
    ('high: 2', 'missing', 'low'), ('low: 0\nhihg: 1', 'unknown_name', 'hihg'),
    ('low: true', 'wrong_type', 'low'), ('low: .inf', 'not_finite', 'low'),
    ('low: {value: 1, unit: mm}', 'wrong_type', 'low'),
    ('low: 0\nlow: 1', 'unreadable', None), ('low: [', 'unreadable', None)])
def test_every_refusal_names_the_file_and_what_is_wrong(tmp_path, content, reason, field):
    path = tmp_path / 'mine.yaml'
    path.write_text(content)
    with refused(reason, str(path) if field is None else field) as refusal:
        load_config(Range, 'ranges', str(path))
    assert str(refusal.value).startswith(str(path))


def test_every_refusal_of_these_folders_has_a_reason_and_a_field():
    package = Path(ballbot_ros.__file__).parent
    lacking = [
        f'{path.relative_to(package)}:{call.lineno}'
        for folder in ('config', 'results', 'experiments')
        for path in (package / folder).rglob('*.py')
        for call in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(call, ast.Call) and getattr(call.func, 'id', '') == 'ConfigurationError'
        and len(call.args) < 3]
    assert not lacking


def test_a_value_carries_where_it_comes_from():
    values, provenance = read_values(
        Range, {'low': {'value': 0.2, 'source': 'measured', 'range': [0.1, 0.3]}, 'high': 2}, 'x')
    assert values == {'low': 0.2, 'high': 2.0}
    assert provenance == {'low': Provenance('measured', 0.1, 0.3)}
