# SPDX-License-Identifier: Apache-2.0
"""Curve files: a written curve loads unchanged, and its file names the source."""
from dataclasses import replace

import pytest
import yaml

from ballbot_ros.config.files import shipped_files
from ballbot_ros.decision import HeightCurve, load_curve
from ballbot_ros.studies.curve_fit import curve_text

SHIPPED = sorted(file.stem for file in shipped_files('curves'))
PLAIN = HeightCurve('mine', 'gimball', 'free', 'a test', 0.2, 1.2, 0.0,
                    coefficients=(0.0, 0.01, 0.05, -0.01))


@pytest.mark.parametrize('curve', [*map(load_curve, SHIPPED), PLAIN], ids=[*SHIPPED, 'plain'])
def test_a_written_curve_loads_unchanged(tmp_path, curve):
    path = tmp_path / 'again.yaml'
    path.write_text(curve_text(curve, 'GimBall', 'a test'))
    assert load_curve(str(path)) == curve


@pytest.mark.parametrize('curve', [*map(load_curve, SHIPPED), PLAIN], ids=[*SHIPPED, 'plain'])
def test_unknown_values_are_left_out_and_a_table_has_a_line_for_each_row(curve):
    text = curve_text(curve, 'GimBall', 'a test')
    content = yaml.safe_load(text)
    assert None not in content.values() and [] not in content.values()
    assert set(content) == {'name', 'robot', 'actuation', 'source', 'lowest_speed',
                            'highest_speed', 'residual', 'rms', 'coefficients',
                            *(name for name in ('conservative', 'covariance', 'made', 'band')
                              if getattr(curve, name))}
    # Each key of a mapping and each row of numbers has its own line.
    lines = text.splitlines()
    assert max(map(len, lines)) <= 99
    assert f'robot: {curve.robot}' in lines
    assert sum(line.startswith('coefficients: [') for line in lines) == 1
    assert sum(line.startswith('- [') for line in lines) == len(curve.covariance)
    assert ('  law: free' in lines) == (curve.made is not None and curve.made.law == 'free')
    assert sum(line.startswith('  - [') for line in lines) == len(
        curve.band.heights if curve.band else ())


def test_a_long_text_is_wrapped_and_loads_unchanged(tmp_path):
    curve = replace(PLAIN, source=' '.join(200 * ['word']))
    text = curve_text(curve, curve.source, 'a test')
    assert max(map(len, text.splitlines())) < 110
    (tmp_path / 'long.yaml').write_text(text)
    assert load_curve(str(tmp_path / 'long.yaml')) == curve


def test_the_comment_at_the_top_describes_the_curve_and_names_its_author():
    text = curve_text(PLAIN, 'GimBall', 'a test')
    comment = [line for line in text.splitlines() if line.startswith('#')]
    joined = ' '.join(line.lstrip('# ') for line in comment)
    assert 'Maximum step height of GimBall' in joined and 'a test' in joined
    assert text.splitlines()[:len(comment)] == comment, 'the comment must come first'


def test_numbers_are_rounded_to_a_nanometre_and_their_covariance_to_four_digits():
    curve = replace(PLAIN, coefficients=(0.0, 0.0123456789123, 0.05, -0.01),
                    covariance=4 * ((1.234567e-7, 0.0, 0.0, 0.0),))
    content = yaml.safe_load(curve_text(curve, 'a', 'b'))
    assert content['coefficients'][1] == 0.012345679
    assert float(content['covariance'][3][0]) == 1.235e-7
