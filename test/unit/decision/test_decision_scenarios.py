# SPDX-License-Identifier: Apache-2.0
"""Scenarios in closed loop with the full model that once ended in a fall or a hit."""
from dataclasses import replace
import math

import numpy as np
import pytest

from ballbot_ros.decision import TerrainObservation
from ballbot_ros.studies.evaluation import loop
from ballbot_ros.studies.evaluation.approaches import Approach
from ballbot_ros.studies.evaluation.grounds import lay, Shape
from ballbot_ros.studies.evaluation.sensors import Flaws, Looks

BELIEVER = loop.Believer()
DROP, WALL = ((0.0, -0.12),), ((0.0, 0.3),)


def drive(strides, planner='rollout', kind='terrain', slope=0.0, foot=1.8, goal=math.inf,
          looks=Looks, monkeypatch=None, number=0, **flaws):
    """Return the row of an approach of the nominal robot."""
    if monkeypatch is not None:
        monkeypatch.setattr(loop, 'Looks', looks)
    shape = Shape('obstacle', list(strides), goal)
    ground = lay('obstacle', shape, foot, math.radians(slope), None,
                 BELIEVER.robot.surface_friction)
    row = loop.run_approach(Approach(0, number, BELIEVER.robot, ground,
                                     Flaws(kind=kind, **flaws), 0.0, 0.0), planner, BELIEVER)
    assert not row['failure']
    return row


class Frozen(Looks):
    """A sensor whose data do not change after some time, while its stamps advance."""

    def arrived(self, now):
        found = super().arrived(now)
        if now < 1.0:
            self.last = found[-1] if found else None
            return found
        return [replace(self.last, stamp=one.stamp) for one in found]


class Outliers(Looks):
    """A camera of whose points one in ten is wrong by up to 0.2 m."""

    random = np.random.default_rng(0)

    def arrived(self, now):
        return [self.spoiled(one) for one in super().arrived(now)]

    def spoiled(self, one: TerrainObservation) -> TerrainObservation:
        z = np.array(one.z)
        wrong = self.random.random(len(z)) < 0.1
        z[wrong] += self.random.uniform(-0.2, 0.2, wrong.sum())
        return replace(one, z=tuple(z.tolist()))


@pytest.mark.parametrize('planner', ['rollout', 'cubic'])
@pytest.mark.parametrize('kind', ['terrain', 'step'])
@pytest.mark.parametrize('strides', [DROP, WALL])
def test_a_frozen_sensor_ends_in_a_stop(planner, kind, strides, monkeypatch):
    assert drive(strides, planner, kind, looks=Frozen, monkeypatch=monkeypatch,
                 height_sd=0.0005)['outcome'] == 'stopped'


@pytest.mark.parametrize('planner', ['rollout', 'cubic'])
@pytest.mark.parametrize('angle, length', [(9.0, 0.4), (12.0, 0.3), (8.0, 1.0)])
def test_a_descent_too_steep_that_ends_in_a_drop_is_not_entered(planner, angle, length):
    fall = -length * math.tan(math.radians(angle))
    assert drive([(length, fall), (0.0, -0.12)], planner)['outcome'] == 'stopped'


@pytest.mark.parametrize('slope, sill', [(-3.0, 0.012), (-3.0, 0.02), (-1.5, 0.015)])
def test_behind_a_sill_on_a_descent_the_ball_stops_before_the_drop(slope, sill):
    row = drive([(0.0, sill), (0.25, 0.0), (0.0, -sill), (1.0, 0.0), (0.0, -0.15)], slope=slope,
                height_sd=0.0005)
    assert row['outcome'] == 'stopped'


@pytest.mark.parametrize('strides', [DROP, WALL])
def test_outliers_of_a_camera_are_single_lost_points(strides, monkeypatch):
    row = drive(strides, looks=Outliers, monkeypatch=monkeypatch, height_sd=0.001)
    assert row['outcome'] == 'stopped' and row['changes'] <= 2
