# SPDX-License-Identifier: Apache-2.0
"""Curves: read, refused, inverted, and never evaluated where they do not hold."""
import math

from hypothesis import given, strategies
import pytest

from ballbot_ros.config.files import config_folder
from ballbot_ros.decision import HeightCurve, load_curve
from ballbot_ros.errors import ConfigurationError

SHIPPED = sorted(file.stem for file in (config_folder() / 'curves').glob('*.yaml'))
FINE = {'name': 'mine', 'robot': 'gimball', 'actuation': 'free', 'source': 'a test',
        'lowest_speed': 0.2, 'highest_speed': 1.2, 'residual': 0.0,
        'coefficients': [0.0, 0.01, 0.05, -0.01]}


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_curves_load_and_cover_the_published_speeds(name):
    curve = load_curve(name)
    assert curve.name == name
    assert curve.lowest_speed <= 0.3 and curve.highest_speed >= 1.1
    assert curve.residual < 0.001


@pytest.mark.parametrize('name, speed, millimetres', [
    # The three crossings in the text of the paper's section 7 are possible.
    ('gimball_down', 0.76, 21.0), ('gimball_horizontal', 0.78, 31.0),
    ('gimball_horizontal', 1.09, 56.0)])
def test_published_crossings_lie_below_the_curves(name, speed, millimetres):
    assert load_curve(name).height(speed) >= 1e-3 * millimetres


@pytest.mark.parametrize('name', SHIPPED)
@given(height=strategies.floats(-0.1, 0.2))
def test_required_speed_is_the_lowest_that_is_enough(name, height):
    curve = load_curve(name)
    speed = curve.required_speed(height)
    if speed is None:
        assert curve.height(curve.highest_speed) < height
        return
    assert curve.height(speed) >= height
    if speed > curve.lowest_speed:
        assert curve.height(speed - 1e-6) < height


@given(strategies.floats(allow_nan=True))
def test_the_cubic_is_never_extrapolated(speed):
    curve = HeightCurve(**FINE)
    if 0.2 <= speed <= 1.2:
        assert math.isfinite(curve.height(speed))
    else:
        with pytest.raises(ConfigurationError, match='not extrapolated'):
            curve.height(speed)


def test_not_a_number_has_no_required_speed():
    assert HeightCurve(**FINE).required_speed(math.nan) is None
    assert HeightCurve(**FINE).required_speed(math.inf) is None


@pytest.mark.parametrize('change, complaint', [
    ({'highest_speed': 0.2}, 'more than lowest_speed'),
    ({'highest_speed': 5.0}, 'must rise'),                       # turns over
    ({'coefficients': [0.0, 0.01, -0.01, 0.0033]}, 'must rise'),   # dips inside the range
    ({'coefficients': [0.0, 0.0, 0.0, 0.0]}, 'must rise'),
    ({'coefficients': [0.0, 1.0, 1.0]}, 'four finite'),
    ({'coefficients': [0.0, math.nan, 1.0, 1.0]}, 'four finite'),
    ({'coefficients': 3.0}, 'four finite'),
    ({'residual': -1.0}, 'residual'), ({'lowest_speed': math.nan}, 'lowest_speed')])
def test_unusable_curves_are_refused(change, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        HeightCurve(**{**FINE, **change})


def test_file_without_coefficients_is_refused_by_name(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('\n'.join(
        f'{key}: {value}' for key, value in FINE.items() if key != 'coefficients'))
    with pytest.raises(ConfigurationError, match='mine.yaml.*coefficients'):
        load_curve(str(path))
