# SPDX-License-Identifier: Apache-2.0
"""Columns of a table are aligned: text on the left, numbers on the right."""
from refusals import refused

from ballbot_ros.config.fields import check_choice
from ballbot_ros.table import table


def test_columns_of_numbers_end_at_the_same_place_and_text_begins_there():
    assert table([('name', 'height', 'note'), ('a', '8.5 mm', ''), ('step', '-12 mm', 'high'),
                  ('longer', '-', 'not reached')]).splitlines() == [
        'name    height  note',
        'a       8.5 mm',
        'step    -12 mm  high',
        'longer       -  not reached']


def test_a_table_without_rows_is_its_heading():
    assert table([('name', 'value')]) == 'name  value'


def test_a_name_that_is_not_in_a_list_is_refused_with_the_nearest():
    check_choice('planner', 'cubic', ('cubic', 'rollout'))
    with refused('not_a_choice', 'planner') as caught:
        check_choice('planner', 'cubik', ('cubic', 'rollout'), 'command line')
    assert str(caught.value).startswith('command line: planner must be one of cubic, rollout')
    assert "'cubik'; did you mean 'cubic'?" in str(caught.value)
