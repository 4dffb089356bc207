# SPDX-License-Identifier: Apache-2.0
"""One helper reads a checked dataclass from a file, and names the file in every refusal."""
import ast
from dataclasses import dataclass
import math
from pathlib import Path
import re

import pytest
from refusals import refused

import ballbot_ros
from ballbot_ros.config.fields import Checked, Provenance, quantity, read_values
from ballbot_ros.config.files import load_config, read_config, read_yaml, SIGNATURES
from ballbot_ros.errors import ConfigurationError


@dataclass(frozen=True)
class Range(Checked):
    """Two numbers, of which `low` must be at most `high`."""

    low: float = quantity('m', 'lower end', minimum=0.0)
    high: float = quantity('m', 'upper end', default=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low > self.high:
            raise ConfigurationError(
                f'Range: low must be at most high, got {self.low:g}', 'inconsistent', 'low')


def test_a_custom_file_is_read_by_its_path(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('low: 1e-1\n')
    assert load_config(Range, 'ranges', str(path)) == Range(0.1, 1.0)


@pytest.mark.parametrize('content, reason, field', [
    ('low: 2.0', 'inconsistent', 'low'), ('low: -1', 'out_of_range', 'low'),
    ('high: 2', 'missing', 'low'), ('low: 0\nhihg: 1', 'unknown_name', 'hihg'),
    ('low: true', 'wrong_type', 'low'), ('low: .inf', 'not_finite', 'low'),
    ('low: {value: 1, unit: mm}', 'wrong_type', 'low'),
    ('low: 0\nlow: 1', 'unreadable', None), ('low: [', 'unreadable', None)])
def test_every_refusal_names_the_file_and_the_field(tmp_path, content, reason, field):
    path = tmp_path / 'mine.yaml'
    path.write_text(content)
    with refused(reason, str(path) if field is None else field) as refusal:
        load_config(Range, 'ranges', str(path))
    assert str(refusal.value).startswith(str(path))


def test_a_decimal_comma_gets_the_corrected_number(tmp_path):
    (tmp_path / 'mine.yaml').write_text('low: -0,25')
    with refused('wrong_type', 'low') as refusal:
        load_config(Range, 'ranges', str(tmp_path / 'mine.yaml'))
    assert 'write a decimal point, -0.25' in str(refusal.value)


@pytest.mark.parametrize('kind', SIGNATURES)
def test_the_article_fits_every_kind_of_file(kind, tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('scene: doorstep\nseeds: [0]\n')  # of an experiment
    for name, reason in [('', 'wrong_type'), (path, 'wrong_kind')][:1 + (kind != 'experiments')]:
        with refused(reason, kind.removesuffix('s')) as refusal:
            read_config(kind, name)
        assert not re.search(r'\ba ([aeiou]|hardware (?!file))', str(refusal.value))


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


def test_a_value_has_its_source():
    values, provenance = read_values(
        Range, {'low': {'value': 0.2, 'source': 'measured', 'range': [0.1, 0.3]}, 'high': 2}, 'x')
    assert values == {'low': 0.2, 'high': 2.0}
    assert provenance == {'low': Provenance('measured', 0.1, 0.3)}


@pytest.mark.parametrize('text, value', [
    ('010', 10), ('-5', -5), ('0o17', 15), ('0x1F', 31), ('1e-4', 1e-4), ('+.5', 0.5), ('2.', 2.0),
    ('-1.5E3', -1500.0), ('0.0', 0.0), ('.inf', math.inf), ('1:30', '1:30'), ('1_000', '1_000'),
    ('true', True), ('1.7.2', '1.7.2')])
def test_numbers_are_those_of_yaml_1_2(text, value, tmp_path):
    (tmp_path / 'file.yaml').write_text(f'key: {text}\n')
    found = read_yaml(tmp_path / 'file.yaml')['key']
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize('text', [
    '1' + 400 * '0', '9' * 5000, '5e-324', '1e400', '-1e999', '[' * 30000, '- ' * 30000 + 'a'])
def test_unrepresentable_values_are_refused(text, tmp_path):
    (tmp_path / 'file.yaml').write_text(f'key:\n  {text}\n')
    with refused('unreadable'):
        read_yaml(tmp_path / 'file.yaml')
