# SPDX-License-Identifier: Apache-2.0
"""The picture of the architecture is the code's, and all its arrows go down."""
from pathlib import Path
import re
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'scripts'))

import draw_architecture  # noqa: E402, I100, I201
import house  # noqa: E402, I100, I201


@pytest.fixture(scope='module')
def imported():
    """Return {folder: the folders that it imports} of the code."""
    return house.folders(house.edges())


def test_every_folder_is_in_the_picture_and_no_other(imported):
    assert set(draw_architecture.PLACES) | set(draw_architecture.GROUND) == set(imported)


def test_every_import_goes_down_in_the_picture(imported):
    def top(folder):
        left, right, floor, height, group = draw_architecture.PLACES.get(folder, [0] * 5)
        return floor + height
    up = [(folder, other) for folder, others in imported.items() for other in others
          if folder in draw_architecture.PLACES
          and top(other) > draw_architecture.PLACES[folder][2]]
    assert not up, up


def test_no_boxes_overlap():
    places = list(draw_architecture.PLACES.items())
    overlaps = [(name, other) for number, (name, one) in enumerate(places)
                for other, two in places[number + 1:]
                if min(one[1], two[1]) > max(one[0], two[0])
                and min(one[2] + one[3], two[2] + two[3]) > max(one[2], two[2])]
    assert not overlaps, overlaps


def test_the_picture_in_the_documents_has_the_arrows_of_the_code(imported):
    text = (ROOT / 'docs' / 'figures' / 'architecture.svg').read_text(encoding='utf-8')
    folders = '|'.join(map(re.escape, draw_architecture.PLACES))
    drawn = set(re.findall(rf'<g id="({folders})-({folders})">', text))
    assert drawn == set(draw_architecture.drawn_edges(imported)), (
        'run scripts/draw_architecture.py')


def test_the_picture_can_be_drawn(imported):
    figure, arrows = draw_architecture.draw()
    assert figure.axes and arrows == draw_architecture.drawn_edges(imported)


def test_arrows_that_others_imply_are_left_out_and_no_others():
    graph = {'cli': {'nodes', 'ros', 'errors'}, 'nodes': {'ros'}, 'ros': set(), 'errors': set()}
    assert draw_architecture.drawn_edges(graph) == [('cli', 'nodes'), ('nodes', 'ros')]


def test_lines_of_code_words_and_kernels_are_told_from_prose():
    source = house.Source('''"""Stiffness of prose."""
import math  # stiffness, too


@compiled
def kernel(a: Any, b: float) -> float:
    """Return stiffness."""
    return (a[
        'stiffness'])


class Spring:
    """A class."""
''')
    assert source.lines == 13
    assert len(source.code) == 6 and source.classes == ['Spring']
    assert 'stiffness' in source.words and 'prose' not in source.words
    figures = house.kernel_figures(source.kernels)
    assert list(figures.values()) == [1, 2, 0, 1, 4]
