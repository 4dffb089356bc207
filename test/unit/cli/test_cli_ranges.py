# SPDX-License-Identifier: Apache-2.0
"""All verbs share a syntax for ranges; names of options and columns are consistent."""
import re

import pytest
from refusals import refused

from ballbot_ros.cli import main
from ballbot_ros.cli.max_step_height import COLUMNS
from ballbot_ros.cli.options import read_numbers, read_values
from ballbot_ros.cli.sweep import read_varied
from ballbot_ros.studies.sweep import SEARCHED_COLUMNS


def test_a_range_includes_both_ends_and_the_given_number_of_values():
    assert read_numbers(['0.2:0.4:5'], '--speed') == [0.2, 0.25, 0.3, 0.35, 0.4]
    assert read_numbers(['0.2:0.3:2', '7', '8,9'], '--speed') == [0.2, 0.3, 7.0, 8.0, 9.0]
    assert read_values('0.2:0.7', '--vary') == (0.2, 0.7)
    assert read_varied('speed=0.2,0.7', '--vary') == ('speed', [0.2, 0.7])
    assert read_numbers(['-5:5:3'], '--slopes-deg') == [-5.0, 0.0, 5.0]


@pytest.mark.parametrize('word, reason', [
    ('0.2:1.2:0.05', 'out_of_range'), ('1:10:1', 'out_of_range'), ('0:1:0.3', 'out_of_range'),
    ('1:2:-1', 'out_of_range'), ('0:1:1e9', 'out_of_range'), ('0:1:999999999', 'out_of_range'),
    ('1:2:3:4', 'wrong_type'), ('', 'wrong_type'), ('1,', 'wrong_type'), ('inf', 'wrong_type'),
    ('1:2:inf', 'wrong_type'), ('1:1:2', 'inconsistent')])
def test_a_stride_and_a_malformed_range_are_refused(word, reason):
    with refused(reason, '--speed'):
        read_values(word, '--speed')


@pytest.mark.parametrize('word, written', [
    ('0.2:1.2:0.05', ['0.2:1.2:21']), ('1:10:1', ['1:10:10']), ('0:1:0.3', [])])
def test_a_stride_is_answered_with_the_equivalent_count_if_any(word, written):
    with refused('out_of_range') as caught:
        read_values(word, '--speed')
    assert re.findall(r'[\d.]+:[\d.]+:[\d.]+', str(caught.value)) == [word, *written]


@pytest.mark.parametrize('word', ['speed', '=1', 'speed='])
def test_a_number_without_name_or_value_is_refused(word):
    with refused('wrong_type') as caught:
        read_varied(word, '--vary')
    assert caught.value.field.startswith('--vary')


def test_the_maximum_step_height_has_one_name_in_all_results():
    assert COLUMNS['height'] in SEARCHED_COLUMNS and 'height' not in SEARCHED_COLUMNS


def test_help_before_the_verb_also_prints_the_help_of_the_verb(capsys):
    assert main(['help', 'simulate']) == 0
    text = capsys.readouterr().out
    assert main(['simulate', '--help']) == 0
    assert capsys.readouterr().out == text and 'usage: ballbot simulate' in text
    assert main(['help']) == 0
    assert 'usage: ballbot ' in capsys.readouterr().out
