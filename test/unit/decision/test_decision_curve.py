# SPDX-License-Identifier: Apache-2.0
"""Height curves: loading, refusals, inversion, and no extrapolation."""
import math

from hypothesis import given, strategies
import pytest
from refusals import refused
from tiers import slow

from ballbot_ros.config.files import shipped_files
from ballbot_ros.decision import HeightCurve, load_curve

SHIPPED = sorted(file.stem for file in shipped_files('curves'))
FINE = {'name': 'mine', 'robot': 'gimball', 'actuation': 'free', 'source': 'a test',
        'lowest_speed': 0.2, 'highest_speed': 1.2, 'residual': 0.0,
        'coefficients': [0.0, 0.01, 0.05, -0.01]}


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_curves_load_and_cover_the_published_speeds(name):
    curve = load_curve(name)
    assert curve.name == name
    assert curve.lowest_speed <= 0.3 and curve.highest_speed >= 1.1
    assert curve.residual < 0.001


@pytest.mark.parametrize('name', SHIPPED)
def test_the_conservative_variant_is_the_other_cubic_and_needs_no_margin(name):
    fit, conservative = load_curve(name), load_curve(name, 'conservative')
    assert conservative.coefficients == fit.conservative != fit.coefficients
    assert conservative.residual == 0.0 < fit.residual


@pytest.mark.parametrize('name, speed, millimetres', [
    # The three crossings in the text of the paper's section 7 are possible.
    ('gimball_down', 0.76, 21.0), ('gimball_horizontal', 0.78, 31.0),
    ('gimball_horizontal', 1.09, 56.0)])
def test_published_crossings_lie_below_the_curves(name, speed, millimetres):
    assert load_curve(name).height(speed) >= 1e-3 * millimetres


@pytest.mark.parametrize('name', [SHIPPED[0], *slow(*SHIPPED[1:])])
@given(height=strategies.floats(-0.1, 0.2))
def test_the_required_speed_is_the_lowest_sufficient_one(name, height):
    curve = load_curve(name)
    speed = curve.required_speed(height)
    if speed is None:
        assert curve.height(curve.highest_speed) < height
        return
    assert curve.height(speed) >= height
    if speed > curve.lowest_speed:
        assert curve.height(speed - 1e-12) < height


@given(strategies.floats(allow_nan=True))
def test_the_cubic_is_never_extrapolated(speed):
    curve = HeightCurve(**FINE)
    if 0.2 <= speed <= 1.2:
        assert math.isfinite(curve.height(speed))
    else:
        with refused('out_of_range', 'speed'):
            curve.height(speed)


def test_a_height_that_is_not_finite_has_no_required_speed():
    assert HeightCurve(**FINE).required_speed(math.nan) is None
    assert HeightCurve(**FINE).required_speed(math.inf) is None


@pytest.mark.parametrize('change, reason, field', [
    ({'highest_speed': 0.2}, 'inconsistent', 'highest_speed'),
    ({'highest_speed': 5.0}, 'inconsistent', 'coefficients'),      # has a maximum
    ({'coefficients': [0.0, 0.01, -0.01, 0.0033]}, 'inconsistent', 'coefficients'),  # a dip
    ({'coefficients': [0.0, 0.0, 0.0, 0.0]}, 'inconsistent', 'coefficients'),
    ({'coefficients': [0.0, 1.0, 1.0]}, 'wrong_type', 'coefficients'),
    ({'coefficients': [0.0, math.nan, 1.0, 1.0]}, 'wrong_type', 'coefficients'),
    ({'coefficients': 3.0}, 'wrong_type', 'coefficients'),
    ({'coefficients': [0.0, True, 0.0, 0.0]}, 'wrong_type', 'coefficients'),
    ({'coefficients': [0.0, '1', 0.0, 0.0]}, 'wrong_type', 'coefficients'),
    ({'coefficients': {0.0, 1.0, 2.0, 3.0}}, 'wrong_type', 'coefficients'),
    ({'conservative': [0.0, 1.0]}, 'wrong_type', 'conservative'),
    ({'conservative': [0.0, math.inf, 0.0, 0.0]}, 'wrong_type', 'conservative'),
    ({'covariance': [[0.0, 1.0]]}, 'wrong_type', 'covariance'),
    ({'residual': -1.0}, 'out_of_range', 'residual'), ({'rms': -1.0}, 'out_of_range', 'rms'),
    ({'lowest_speed': -0.1}, 'out_of_range', 'lowest_speed'),
    ({'highest_speed': 0.0}, 'out_of_range', 'highest_speed'),
    ({'lowest_speed': math.nan}, 'not_finite', 'lowest_speed')])
def test_unusable_curves_are_refused(change, reason, field):
    with refused(reason, field):
        HeightCurve(**{**FINE, **change})


@pytest.mark.parametrize('slope, rises', [(1e-6, True), (-1e-6, False)])
@pytest.mark.parametrize('bend', [0.5, 0.7, 1.1])
def test_the_least_slope_of_a_curve_decides_whether_it_rises(slope, rises, bend):
    # d(height)/d(speed) = slope + (speed - bend)^2
    cubic = {**FINE, 'coefficients': [0.0, slope + bend**2, -bend, 1.0 / 3.0]}
    if rises:
        assert HeightCurve(**cubic).height(bend) == pytest.approx(slope * bend + bend**3 / 3.0)
    else:
        with refused('inconsistent', 'coefficients') as caught:
            HeightCurve(**cubic)
        assert f'{bend:g} m/s' in str(caught.value)


@pytest.mark.parametrize('a2, place', [(0.2, 0.2), (-0.2, 1.2)])
def test_the_slope_of_a_parabola_is_least_at_an_end_of_its_range(a2, place):
    # Its vertex is near the lowest or the highest speed.
    for more, rises in ((1e-6, True), (-1e-6, False)):
        parabola = {**FINE, 'coefficients': [0.0, more - 2.0 * a2 * place, a2, 0.0]}
        if rises:
            HeightCurve(**parabola)
        else:
            with refused('inconsistent', 'coefficients') as caught:
                HeightCurve(**parabola)
            assert f'{place:g} m/s' in str(caught.value)


def test_a_step_below_the_curve_requires_only_the_slowest_speed():
    curve = HeightCurve(**FINE)
    assert curve.required_speed(curve.height(0.2)) == 0.2
    assert curve.required_speed(-1.0) == 0.2
    assert curve.required_speed(curve.height(1.2)) == pytest.approx(1.2, abs=1e-12)


MADE = {'robot_digest': '0', 'law': 'free', 'surface_friction': 0.2, 'edge_friction': 0.2,
        'attempts': 'first', 'accuracy': 1e-6, 'points': 4, 'version': '1'}


@pytest.mark.parametrize('reason, change', [
    ('out_of_range', {'surface_friction': -0.1}), ('out_of_range', {'edge_friction': 11.0}),
    ('out_of_range', {'accuracy': 0.0}), ('out_of_range', {'points': 3}),
    ('not_a_choice', {'attempts': 'second'}), ('unknown_name', {'colour': 'red'})])
def test_the_provenance_of_a_curve_is_checked(reason, change):
    made = HeightCurve(**FINE, made={**MADE, 'surface_friction': 0.0, 'edge_friction': 0.0}).made
    assert (made.set_angle, made.voltage, made.points) == (0.0, 0.0, 4)
    with refused(reason, next(iter(change))):
        HeightCurve(**FINE, made={**MADE, **change})


def test_a_file_without_coefficients_is_refused_with_the_name_of_the_field(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('\n'.join(
        f'{key}: {value}' for key, value in FINE.items() if key != 'coefficients'))
    with refused('wrong_type', 'coefficients'):
        load_curve(str(path))


def test_a_curve_without_conservative_coefficients_has_no_such_variant(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('name: mine\nrobot: gimball\nactuation: a\nsource: b\nlowest_speed: 0.2\n'
                    'highest_speed: 1.0\nresidual: 0\ncoefficients: [0, 0.1, 0, 0]\n')
    assert load_curve(str(path)).made is None
    with refused('missing', 'conservative'):
        load_curve(str(path), 'conservative')
    with refused('not_a_choice', 'variant'):
        load_curve(str(path), 'bold')
