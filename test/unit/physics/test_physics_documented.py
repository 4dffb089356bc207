# SPDX-License-Identifier: Apache-2.0
"""The numbers in docs/model.md match the code; references in docs/equations.md exist."""
from importlib import import_module
import math
from pathlib import Path
import re

import pytest
from reference_search import CASES, highest_step

from ballbot_ros.physics import ContactOptions, load_robot, Model

ROOT = Path(__file__).resolve().parents[3]
TEXT = (ROOT / 'docs' / 'model.md').read_text(encoding='utf-8')
EQUATIONS = (ROOT / 'docs' / 'equations.md').read_text(encoding='utf-8')
OPTIONS = [ContactOptions(pulling=True), ContactOptions(slip_lever='radius'),
           ContactOptions(pulling=True, slip_lever='radius'),
           ContactOptions(friction_ramp='smooth')]


def table(name):
    """Return the rows of the table after a marker, without its header."""
    lines = TEXT.split(f'<!-- {name} -->\n')[1].split('\n\n')[0].split('\n')
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in lines[2:]]


@pytest.mark.slow
@pytest.mark.parametrize('row', table('effects'), ids=lambda row: ' '.join(row[:2]))
def test_effect_of_the_contact_options_on_the_height(row):
    name, speed, *values = row[0], *map(float, row[1:])
    robot, actuation = CASES[name]

    def millimetres(options=ContactOptions()):
        return 1e3 * highest_step(robot, speed, actuation, 2e-6, options=options)

    own = millimetres()
    assert values[0] == pytest.approx(own, abs=0.02)
    assert values[1:] == pytest.approx([millimetres(item) - own for item in OPTIONS], abs=0.012)


def test_the_documented_contact_values_follow_from_the_parameters():
    for column, name in ((1, 'gimball'), (2, 'shellball')):
        robot = load_robot(name)
        zeta = robot.damping_ratio
        phase = math.pi - 2.0 * math.asin(zeta)
        root = math.sqrt(1.0 - zeta**2)
        natural = math.sqrt(robot.contact_stiffness / robot.total_mass)
        expected = [1e3 * robot.static_penetration, zeta, math.exp(-zeta / root * phase),
                    robot.restitution, 1e3 * phase / (natural * root),
                    math.degrees(robot.slope_limit)]
        shown = [row[column].split()[0] for row in table('contact')]
        for text, value in zip(shown, expected):
            places = len(text.partition('.')[2])
            assert float(text) == pytest.approx(value, abs=0.5001 * 10.0**-places)
        assert len(shown) == len(expected)


def test_each_section_with_formulas_names_its_code():
    sections = [text for text in EQUATIONS.split('\n## ') if '$$' in text]
    assert len(sections) == 6 and all('Code:' in text for text in sections)


@pytest.mark.parametrize('path', sorted(set(re.findall(
    r'`((?:physics|studies|decision)/[\w/]+(?:\.py)?)`', EQUATIONS))))
def test_each_file_named_in_the_equations_exists(path):
    assert (ROOT / 'ballbot_ros' / path).exists()


@pytest.mark.parametrize('module, name', sorted(set(re.findall(
    r'`(equations|contact|modes|actuation|Model)\.(\w+)`', EQUATIONS))))
def test_each_function_named_in_the_equations_exists(module, name):
    folder = 'model' if module == 'actuation' else 'mechanics'
    place = Model if module == 'Model' else import_module(
        f'ballbot_ros.physics.{folder}.{module}')
    assert callable(getattr(place, name))
