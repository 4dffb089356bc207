# SPDX-License-Identifier: Apache-2.0
"""Profiles cut from a floor, compared with analytical geometry."""
from dataclasses import replace
import math

from hypothesis import assume, given, strategies
import numpy as np
import pytest

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.floors import Feature, Floor
from ballbot_ros.floors.floor import Heights, inside, OCCUPIED
from ballbot_ros.floors.levels import level
from ballbot_ros.floors.profile import area_height, cut, passed, ranges, WALL_HEIGHT

SIZE, RESOLUTION = 10.0, 0.05
angles = strategies.floats(-math.pi, math.pi)
places = strategies.tuples(*[strategies.floats(1.0, 9.0)] * 2)


def floor_of(*features, walls=()):
    cells = np.zeros((round(SIZE / RESOLUTION),) * 2, np.uint8)
    for rows, columns in walls:
        cells[rows, columns] = OCCUPIED
    return Floor('test', cells, RESOLUTION, (0.0, 0.0),
                 tuple(Feature(**feature) for feature in features))


def heights(found, distances):
    return np.interp(distances, *found.vertices.T)


@given(places, angles, strategies.floats(0.01, 0.2))
def test_a_step_is_at_the_intersection_of_profile_and_step_line(place, heading, height):
    floor = floor_of({'kind': 'step', 'line': [[5.0, 10.0], [5.0, 0.0]], 'height': height})
    assume(abs(math.cos(heading)) > 0.2 and abs(place[0] - 5.0) > 0.01)
    distance = (5.0 - place[0]) / math.cos(heading)
    assume(0.0 < place[1] + distance * math.sin(heading) < 10.0)
    found = cut(floor, place, heading)
    edge, = found.edges
    assert edge.distance == pytest.approx(distance, abs=1e-12)
    # Seen from the first point of the line, +x is on its left: the step rises towards +x.
    assert edge.height == pytest.approx(math.copysign(height, math.cos(heading)))
    normal = 0.0 if math.cos(heading) > 0.0 else math.pi
    assert math.remainder(normal + edge.angle - heading, math.tau) == pytest.approx(0.0, abs=1e-9)
    away = 0.5 * math.copysign(1.0, distance)
    assert heights(found, distance + away) == pytest.approx(
        math.copysign(height, math.cos(heading)) * math.copysign(1.0, distance))
    assert heights(found, 0.0) == 0.0


@given(places, angles)
def test_an_area_has_its_height_exactly_inside_its_outline(place, heading):
    outline = [(2.0, 3.0), (6.0, 2.0), (7.5, 6.0), (4.0, 8.0)]
    floor = floor_of({'kind': 'level', 'polygon': outline, 'height': -0.3})
    found = cut(floor, place, heading)
    along = np.linspace(-4.0, 4.0, 81)
    near = np.min(np.abs(along[:, None] - found.vertices[:, 0]), axis=1) < 1e-6
    x, y = place[0] + along * math.cos(heading), place[1] + along * math.sin(heading)
    expected = np.where(inside(x, y, outline), -0.3, 0.0)
    assert heights(found, along)[~near] == pytest.approx(expected[~near])


@given(places, angles)
def test_a_ramp_rises_along_its_line(place, heading):
    outline = [(2.0, 2.0), (8.0, 2.0), (8.0, 8.0), (2.0, 8.0)]
    floor = floor_of({'kind': 'ramp', 'polygon': outline, 'line': [[2.0, 5.0], [8.0, 5.0]],
                      'height': 0.6})
    # A profile along the outline may be inside or outside.
    assume(min(abs(math.cos(heading)), abs(math.sin(heading))) > 1e-6)
    found = cut(floor, place, heading)
    along = np.linspace(-3.0, 3.0, 61)
    near = np.min(np.abs(along[:, None] - found.vertices[:, 0]), axis=1) < 1e-6
    x, y = place[0] + along * math.cos(heading), place[1] + along * math.sin(heading)
    expected = np.where(inside(x, y, outline), 0.1 * (x - 2.0), 0.0)
    assert heights(found, along)[~near] == pytest.approx(expected[~near], abs=1e-9)
    assert area_height(floor, place) == pytest.approx(float(
        0.1 * (place[0] - 2.0) if inside(*place, outline) else 0.0))


@pytest.mark.parametrize('behind', [
    {'kind': 'level', 'polygon': [[5, 0], [9, 0], [9, 9], [5, 9]], 'height': 0.1},
    {'kind': 'step', 'line': [[5, 9], [5, 0]], 'height': 0.1}])
@pytest.mark.parametrize('angle', [-0.5, 0.0, 0.5])
def test_a_ramp_that_ends_at_the_level_behind_it_has_no_face_there(behind, angle):
    floor = floor_of({'kind': 'ramp', 'polygon': [[3, 2], [5, 2], [5, 7], [3, 7]],
                      'line': [[3, 4], [5, 4]], 'height': 0.1}, behind)
    found = cut(floor, (4.0, 4.5), angle, factor=lambda angle: 0.5)
    assert not [edge for edge in found.edges if edge.distance < 3.0]
    assert heights(found, np.array([-2.0, 0.0, 0.9, 1.3])) == pytest.approx(
        [0.0, 0.05, 0.05 + 0.045 * math.cos(angle), 0.1])


@given(strategies.floats(-1.3, 1.3))
def test_a_threshold_is_wider_along_an_oblique_line(angle):
    floor = floor_of({'kind': 'threshold', 'line': [[5.0, 0.0], [5.0, 10.0]], 'height': 0.02,
                      'width': 0.06})
    place = (5.0 - math.cos(angle), 5.0 - math.sin(angle))
    found = cut(floor, place, angle)
    half = 0.03 / math.cos(angle)
    assert [edge.distance for edge in found.edges] == pytest.approx([1.0 - half, 1.0 + half])
    assert [edge.height for edge in found.edges] == pytest.approx([0.02, -0.02])


def test_the_bars_of_a_polyline_have_a_single_height_at_their_joints():
    floor = floor_of({'kind': 'cord', 'line': [[3.0, 5.0], [5.0, 5.0], [7.0, 5.0]],
                      'height': 0.006, 'width': 0.01})
    found = cut(floor, (4.0, 5.0), 0.0)
    assert found.vertices[:, 1].max() == 0.006
    assert [edge.distance for edge in found.edges] == [-1.0, 3.0]


def test_friction_applies_to_the_ground_inside_an_area():
    floor = floor_of({'kind': 'friction', 'friction': 0.05,
                      'polygon': [[4.0, 0.0], [6.0, 0.0], [6.0, 10.0], [4.0, 10.0]]})
    found = cut(floor, (2.0, 5.0), 0.0)
    assert found.vertices[1:-1].tolist() == [[2.0, 0.0], [4.0, 0.0]]
    assert np.array_equal(found.friction, [np.nan, 0.05, np.nan], equal_nan=True)


@given(angles)
def test_a_wall_is_a_face_where_the_ball_touches_it(heading):
    # The wall is one cell; the ball touches its nearest point at a distance of its radius.
    floor = floor_of(walls=[(100, 100)])
    radius, middle, half = 0.226, 5.025, 0.025
    offset = 0.15 * math.sin(3.0 * heading)
    place = (middle - 2.0 * math.cos(heading) - offset * math.sin(heading),
             middle - 2.0 * math.sin(heading) + offset * math.cos(heading))
    found = cut(floor, place, heading, radius=radius)
    face = found.vertices[1, 0]
    assert found.vertices[-1, 1] - found.vertices[0, 1] == WALL_HEIGHT
    at = np.array(place) + (face - radius) * np.array([math.cos(heading), math.sin(heading)])
    nearest = np.maximum(np.abs(at - middle) - half, 0.0)
    assert np.hypot(*nearest) == pytest.approx(radius, abs=1e-9)


def test_rectangles_of_walls_cover_the_occupied_cells_once():
    random = np.random.default_rng(0)
    cells = np.where(random.random((40, 30)) < 0.4, OCCUPIED, 0).astype(np.uint8)
    floor = Floor('test', cells, 0.5, (-3.0, 2.0), ())
    count = np.zeros(cells.shape, int)
    for x, y, wide, high in floor.walls:
        first, last = floor.cell_of((x - wide + 0.1, y - high + 0.1)), floor.cell_of(
            (x + wide - 0.1, y + high - 0.1))
        count[first[0]:last[0] + 1, first[1]:last[1] + 1] += 1
    assert np.array_equal(count, cells == OCCUPIED)


def test_ranges_are_distances_to_the_walls_of_a_room():
    edge = slice(0, 20)
    floor = floor_of(walls=[(edge, slice(None)), (slice(-20, None), slice(None)),
                            (slice(None), edge), (slice(None), slice(-20, None))])
    headings = np.linspace(-math.pi, math.pi, 73)
    # The room extends from 1 m to 9 m in x and y.
    with np.errstate(divide='ignore'):
        expected = np.minimum(
            np.where(np.cos(headings) > 0.0, 6.0, 2.0) / np.abs(np.cos(headings)),
            np.where(np.sin(headings) > 0.0, 4.0, 4.0) / np.abs(np.sin(headings)))
    found = ranges(floor, (3.0, 5.0), headings, limit=6.5)
    assert found[expected <= 6.5] == pytest.approx(expected[expected <= 6.5])
    assert np.isinf(found[expected > 6.5]).all()


@given(places, places)
def test_levels_of_rooms_agree_with_the_steps_between_them(start, end):
    # A raised room of 4 m with a pedestal.
    floor = floor_of(
        {'kind': 'step', 'line': [[7.0, 3.0], [7.0, 7.0], [3.0, 7.0], [3.0, 3.0], [7.0, 3.0]],
         'height': 0.04},
        {'kind': 'drop', 'line': [[6.0, 4.0], [6.0, 6.0], [4.0, 6.0], [4.0, 4.0], [6.0, 4.0]],
         'height': 0.02})
    for place in (start, end):
        assume(min(abs(item - line) for item in place for line in (3.0, 4.0, 6.0, 7.0)) > 0.05)
    assert level(floor, end) - level(floor, start) == pytest.approx(passed(floor, start, end))


def test_a_crest_requires_the_height_factor_of_its_angle():
    floor = floor_of({'kind': 'step', 'line': [[5.0, 10.0], [5.0, 0.0]], 'height': 0.03})
    found = cut(floor, (4.0, 5.0), 0.0, factor=lambda angle: 0.75)
    assert heights(found, [0.9, 1.0 + 1e-9, 1.2]) == pytest.approx([0.0, 0.04, 0.03], abs=1e-6)
    # A crest also exists behind a ball that drives away, but not for a ball that rolls down.
    away = cut(floor, (4.0, 5.0), math.pi, factor=lambda angle: 0.75)
    assert heights(away, [-0.9, -1.0 - 1e-9, -1.2]) == pytest.approx([0.0, 0.04, 0.03], abs=1e-6)
    down = cut(floor, (6.0, 5.0), math.pi, factor=lambda angle: 0.75)
    assert heights(down, [0.8, 1.0 - 1e-9, 1.1]) == pytest.approx([0.0, 0.0, -0.03], abs=1e-6)


@given(places, angles)
def test_heights_of_a_plane_are_cut_exactly(place, heading):
    x, y = np.meshgrid(0.05 + 0.1 * np.arange(100), 0.05 + 0.1 * np.arange(100))
    floor = replace(floor_of(), heights=Heights(0.05 * x - 0.02 * y, 0.1, (0.0, 0.0)))
    found = cut(floor, place, heading)
    along = np.linspace(-0.9, 0.9, 37)
    expected = (0.05 * (place[0] + along * math.cos(heading))
                - 0.02 * (place[1] + along * math.sin(heading)))
    assert heights(found, along) == pytest.approx(expected, abs=1e-9)
    assert area_height(floor, place) == pytest.approx(heights(found, 0.0))


@pytest.mark.parametrize('values, reason', [
    ([[0.0, math.nan]], 'not_finite'), ([[0.0, 45.0]], 'out_of_range')])
def test_heights_with_holes_or_in_millimetres_are_refused(values, reason):
    with pytest.raises(ConfigurationError) as caught:
        Heights(np.array(values), 0.1, (0.0, 0.0))
    assert (caught.value.reason, caught.value.field) == (reason, 'heights')
