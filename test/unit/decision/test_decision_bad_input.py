# SPDX-License-Identifier: Apache-2.0
"""Any sensor data gives angles within limits and no crossing above the energy bound."""
from functools import lru_cache
import math

from hypothesis import event, given, settings, strategies
import pytest

from ballbot_ros.decision import (
    Decider, Kind, Knowledge, load_curve, load_decision_tuning, Motion, PLANNERS, StepObservation,
    TerrainObservation)
from ballbot_ros.decision.planning.safety_filter import energy_bound
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
KNOWN = Knowledge(GIMBALL, load_curve('gimball_down'), load_decision_tuning('decision_default'))
TUNING = KNOWN.tuning
LARGEST_ANGLE = max(math.pi / 2.0, TUNING.largest_swing, TUNING.emergency_lean)

anything = strategies.floats(allow_nan=True, allow_infinity=True)
sane = strategies.floats(-1.0, 3.0)
heights = strategies.one_of(strategies.floats(-0.3, 0.3), anything)
numbers = strategies.one_of(sane, anything)
small = strategies.one_of(strategies.just(0.0), strategies.floats(0.0, 0.02), anything)
# Ages of observations [s]: stamps may repeat, go back, jump, or not be finite.
lags = strategies.one_of(strategies.floats(-0.1, 0.7), strategies.just(0.0), anything)
steps = strategies.tuples(
    lags, strategies.booleans(), numbers, heights, small, small)
polylines = strategies.tuples(
    lags, strategies.lists(strategies.tuples(numbers, heights), max_size=6), small,
    strategies.sampled_from(['base_link', 'odom', '']), strategies.booleans())
good = strategies.tuples(
    strategies.just(0.0), strategies.just(True), strategies.floats(0.3, 2.0),
    strategies.floats(0.0, 0.05), strategies.just(0.005), strategies.just(0.0005))
inputs = strategies.one_of(good, steps, polylines, strategies.none())
motions = strategies.one_of(
    strategies.tuples(strategies.floats(0.0, 0.05), strategies.floats(-0.02, 0.03), sane),
    strategies.tuples(strategies.floats(0.0, 0.05), anything, anything))


def observation(values, now):
    """Return an observation, plausible or not."""
    if len(values) == 6:
        lag, detected, distance, height, distance_sd, height_sd = values
        return StepObservation(now - lag, detected, distance, height, distance_sd, height_sd)
    lag, points, sd, frame, upright = values
    # A sensor mounted upside down measures the ground above the ball.
    floor = -GIMBALL.ball_radius if upright else GIMBALL.ball_radius
    x, z = tuple(point[0] for point in points), tuple(floor + point[1] for point in points)
    return TerrainObservation(now - lag, x, z, (sd,) * len(x), min(x, default=0.0),
                              max(x, default=0.0), frame)


@lru_cache(maxsize=None)
def decider(planner):
    """Return a cached decider: sampling its worlds takes longer than an example."""
    return Decider(KNOWN, planner)


@pytest.mark.slow
@pytest.mark.parametrize('planner', PLANNERS)
@given(stream=strategies.lists(strategies.tuples(inputs, motions), min_size=1, max_size=12))
@settings(max_examples=25, deadline=None)
def test_for_any_data_the_decision_is_valid_and_within_limits(planner, stream):
    deciding, now, position = decider(planner), 0.0, 0.0
    deciding.reset()
    for values, (passed, moved, speed) in stream:
        now, position = now + passed, position + moved
        if values is not None:
            deciding.observe(observation(values, now))
        deciding.move(Motion(now, position, speed))
        _, decision, angle = deciding.decide()
        assert math.isfinite(angle) and abs(angle) <= LARGEST_ANGLE
        assert decision.explanation
        limit = TUNING.highest_speed if decision.kind is Kind.CROSS else TUNING.cruise_speed
        assert 0.0 <= decision.set_speed <= limit + 1e-9
        plan = decision.plan
        assert 0.0 <= plan.speed <= limit + 1e-9
        assert abs(plan.swing_angle) <= TUNING.largest_swing
        event(decision.kind.value)
        if decision.kind is Kind.CROSS:
            assert all(map(math.isfinite, (now, position, speed)))
            profile = deciding.profile
            face = next(item for item in profile.faces if item.number == decision.step)
            swing = max(TUNING.largest_lean, abs(plan.swing_angle))
            assert face.height <= energy_bound(GIMBALL, max(TUNING.highest_speed, speed), swing)
        if not math.isfinite(position):
            position = 0.0
