# SPDX-License-Identifier: Apache-2.0
"""Contacts lie at the local minima of the distance between ball centre and any terrain."""
import math

from contact_cases import BOT, loads_at, RADIUS, rows_at, touching, velocities
from hypothesis import assume, given, settings, strategies
import numpy as np
import pytest

from ballbot_ros.physics import Terrain
from ballbot_ros.physics.mechanics.contact import (
    CORNER, EDGE, FRICTION, KIND, NORMAL_X, NORMAL_Y, PENETRATION, POINT_X, POINT_Y, SURFACE)


# The rule ---------------------------------------------------------------------------------

def signed_squares(terrain, x, y):
    """Return the sum of +-penetration^2 over the extrema of the sampled distance."""
    vertices = terrain.vertices.copy()
    vertices[0] += vertices[0] - vertices[1]  # the end segments are unbounded: lengthen them
    vertices[-1] += vertices[-1] - vertices[-2]
    tangents = np.diff(vertices, axis=0)
    many = np.maximum(2, (np.hypot(*tangents.T) / 5e-4).astype(int))
    segments = np.repeat(np.arange(len(many)), many)
    part = np.concatenate([np.arange(count) / count for count in many])
    points = vertices[segments] + part[:, None] * tangents[segments]
    distance = np.hypot(points[:, 0] - x, points[:, 1] - y)
    found = 0.0
    inner, before, after = distance[1:-1], distance[:-2], distance[2:]
    extreme = ((inner < before) & (inner <= after)) | ((inner > before) & (inner >= after))
    for index in np.flatnonzero(extreme & (inner < RADIUS)) + 1:
        tangent, past = tangents[segments[index]], tangents[segments[index - 1]]
        depth = RADIUS - distance[index]
        least = distance[index] < distance[index - 1]
        turn = past[0] * tangent[1] - past[1] * tangent[0]  # 0 except at a vertex
        offset = np.array([x, y]) - points[index]
        in_front = tangent[0] * offset[1] - tangent[1] * offset[0] > 0.0
        if least and (in_front or (part[index] == 0.0 and turn < 1e-9)):
            found += depth**2
        elif not least and turn > 0.0:
            found -= depth**2
    return found


@pytest.mark.slow
@settings(max_examples=150)
@given(touching())
def test_contacts_are_the_extrema_of_the_distance(case):
    terrain, x, y = case
    rows = rows_at(terrain, x, y)
    signs = np.where(rows[:, KIND] == CORNER, -1.0, 1.0)
    assert signs @ rows[:, PENETRATION]**2 == pytest.approx(
        signed_squares(terrain, x, y), rel=1e-3, abs=2e-8)


@pytest.mark.slow
@given(touching())
def test_minima_and_maxima_alternate_and_each_lies_on_the_ground(case):
    terrain, x, y = case
    rows = rows_at(terrain, x, y)
    assert len(rows)
    corners = rows[:, KIND] == CORNER
    assert not corners[[0, -1]].any()
    for index in np.flatnonzero(corners):
        assert not corners[index - 1] and not corners[index + 1]
        # The local maximum of the distance exceeds both neighbouring minima.
        assert rows[index, PENETRATION] <= rows[[index - 1, index + 1], PENETRATION].min()
    for row in rows:
        point = np.array([row[POINT_X], row[POINT_Y]])
        normal = np.array([row[NORMAL_X], row[NORMAL_Y]])
        assert normal @ normal == pytest.approx(1.0, rel=1e-12)
        np.testing.assert_allclose(
            point + (RADIUS - row[PENETRATION]) * normal, [x, y], atol=1e-12)
        starts, steps = terrain.vertices[:-1], np.diff(terrain.vertices, axis=0)
        place = np.einsum('ij,ij->i', point - starts, steps) / np.einsum('ij,ij->i', steps, steps)
        place[1:] = np.maximum(place[1:], 0.0)  # the end segments are unbounded
        place[:-1] = np.minimum(place[:-1], 1.0)
        gap = np.hypot(*(starts + place[:, None] * steps - point).T).min()
        assert gap < 1e-9


@pytest.mark.parametrize('x, kinds', [
    (-0.30, [SURFACE]),              # lower plane
    (-0.115, [SURFACE, CORNER, EDGE]),  # lower plane and corner, Fig. 2
    (0.02, [SURFACE])])              # upper plane
def test_the_three_contacts_of_figure_2(x, kinds):
    # A low step allows contact with lower plane and edge together; the edge point is fixed.
    terrain = Terrain.step(0.03)
    rows = rows_at(terrain, x, terrain.height(x) + RADIUS - 0.002)
    assert [int(row[KIND]) for row in rows] in (kinds, [kind for kind in kinds if kind != CORNER])
    for row in rows[rows[:, KIND] == EDGE]:
        assert row[[POINT_X, POINT_Y]] == pytest.approx([0.0, 0.03], abs=1e-15)
    for row in rows[rows[:, KIND] == SURFACE]:
        assert row[POINT_X] == pytest.approx(x, abs=1e-15)


def test_a_ball_rolling_over_an_edge_touches_only_the_edge():
    rows = rows_at(Terrain.step(0.03), -0.03, 0.03 + RADIUS - 0.004)
    assert [int(row[KIND]) for row in rows] == [EDGE]
    assert rows[0, NORMAL_X] < 0.0 < rows[0, NORMAL_Y]


@pytest.mark.parametrize('height, kind', [(0.9, EDGE), (1.1, SURFACE)])
def test_a_face_higher_than_the_radius_is_a_wall(height, kind):
    rows = rows_at(Terrain.step(height * RADIUS), -RADIUS + 0.002, RADIUS)
    assert int(rows[-1, KIND]) == kind
    if kind == SURFACE:
        assert rows[-1, [NORMAL_X, NORMAL_Y]] == pytest.approx([-1.0, 0.0], abs=1e-15)
        assert rows[-1, PENETRATION] == pytest.approx(0.002, rel=1e-9)


def test_a_corner_of_floor_and_wall_gives_exactly_two_full_contacts():
    rows = rows_at(Terrain.step(1.0), -RADIUS + 0.003, RADIUS - 0.002)
    assert [int(row[KIND]) for row in rows] == [SURFACE, SURFACE]
    assert rows[:, PENETRATION] == pytest.approx([0.002, 0.003], rel=1e-9)
    assert rows[:, FRICTION] == pytest.approx(BOT.surface_friction, rel=1e-15)


def test_an_edge_is_touched_within_its_normal_cone_only():
    terrain = Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, -0.5]])  # convex bend at the origin
    for angle in np.linspace(-0.3, 0.8, 56):
        direction = np.array([math.sin(angle), math.cos(angle)])
        rows = rows_at(terrain, *((RADIUS - 0.001) * direction))
        inside = 0.0 <= angle <= math.atan(0.5)
        if abs(angle) > 1e-9:
            assert ([int(row[KIND]) for row in rows] == [EDGE]) == inside


# Symmetries -------------------------------------------------------------------------------

def same_kinds(rows, other):
    """Return whether two balls have contacts of the same kinds; rounding decides at a vertex."""
    return np.array_equal(rows[:, KIND], other[:, KIND])


@pytest.mark.slow
@given(touching(), velocities, strategies.floats(-3.0, 3.0), strategies.floats(-3.0, 3.0))
def test_translating_ground_and_ball_does_not_change_the_loads(case, motion, right, up):
    terrain, x, y = case
    moved = Terrain(terrain.vertices + [right, up])
    assume(same_kinds(rows_at(terrain, x, y), rows_at(moved, x + right, y + up)))
    here, there = loads_at(terrain, x, y, *motion), loads_at(moved, x + right, y + up, *motion)
    np.testing.assert_allclose(there, here, rtol=1e-7, atol=1e-6)


@pytest.mark.slow
@given(touching(), velocities)
def test_a_mirrored_ground_gives_mirrored_contacts(case, motion):
    terrain, x, y = case
    mirrored = Terrain(terrain.vertices[::-1] * [-1.0, 1.0])
    rows, other = rows_at(terrain, x, y), rows_at(mirrored, -x, y)[::-1]
    assume(same_kinds(rows, other))
    np.testing.assert_allclose(
        rows[:, 1:] * [-1.0, 1.0, -1.0, 1.0, 1.0, 1.0], other[:, 1:], atol=1e-9)
    velocity_x, velocity_y, rate = motion
    np.testing.assert_allclose(
        loads_at(terrain, x, y, *motion) * [-1.0, 1.0, -1.0, 1.0, 1.0],
        loads_at(mirrored, -x, y, -velocity_x, velocity_y, -rate), rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@given(touching(), velocities, strategies.lists(strategies.floats(0.05, 0.95), max_size=5))
def test_an_extra_vertex_on_a_straight_line_does_not_change_the_loads(case, motion, places):
    terrain, x, y = case
    points = list(terrain.vertices)
    added = []
    for number, place in enumerate(places):
        segment = number % (len(terrain.vertices) - 1)
        one, two = terrain.vertices[segment:segment + 2]
        added.append((segment, place, one + place * (two - one)))
    # Insert from the back, so that the indices in front stay valid.
    for segment, _, point in sorted(added, key=lambda item: item[:2], reverse=True):
        points.insert(segment + 1, point)
    points = np.array(points)
    steps = np.diff(points, axis=0)
    assume((np.hypot(*steps.T) > 1e-4).all() and (steps[:, 0] >= 0.0).all())
    # A contact exactly at the new vertex would be an edge contact with edge friction.
    rows = rows_at(terrain, x, y)
    assume(all(np.hypot(*(row[[POINT_X, POINT_Y]] - point)) > 1e-6
               for row in rows for *_, point in added))
    np.testing.assert_allclose(loads_at(Terrain(points), x, y, *motion),
                               loads_at(terrain, x, y, *motion), rtol=1e-6, atol=1e-5)
