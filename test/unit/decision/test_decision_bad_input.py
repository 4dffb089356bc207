# SPDX-License-Identifier: Apache-2.0
"""Any sensor data gives angles within limits and no crossing above the energy bound."""
from dataclasses import replace
from functools import lru_cache
import math

from hypothesis import event, given, settings, strategies
import pytest

from ballbot_ros.control import JointReadings, load_tuning, PendulumController, SetPoint
from ballbot_ros.decision import (
    Decider, Kind, Knowledge, load_curve, load_decision_tuning, Motion, PLANNERS, StepObservation,
    TerrainObservation)
from ballbot_ros.decision.planning.safety_filter import energy_bound
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.plant import Plant

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
        if plan is not None:
            assert 0.0 <= plan.speed <= limit + 1e-9
            assert abs(plan.swing_angle) <= TUNING.largest_swing
        event(decision.kind.value)
        if decision.kind is Kind.CROSS:
            assert all(map(math.isfinite, (now, position, speed)))
            profile = deciding.profile
            face = next(item for item in profile.faces if item.number == decision.step)
            swing = max(TUNING.largest_lean, abs(plan.swing_angle)) if plan else 0.0
            assert face.height <= energy_bound(GIMBALL, max(TUNING.highest_speed, speed), swing)
        if not math.isfinite(position):
            position = 0.0


@pytest.mark.slow
@given(height=strategies.sampled_from([-0.1, 0.12, 0.4]), face=strategies.floats(1.3, 2.2),
       slope=strategies.floats(-3.0, 3.0), speed=strategies.floats(0.0, 0.4),
       noise=strategies.floats(0.0, 0.004), latency=strategies.sampled_from([0.0, 0.2, 0.5]))
@settings(max_examples=4, deadline=None)
def test_a_stop_ends_at_rest_where_physically_possible(height, face, slope, speed, noise, latency):
    rise = math.tan(math.radians(slope))
    scene = load_scene('flat')
    terrain = Terrain([[-20.0, -(20.0 + face) * rise], [face, 0.0], [face, height],
                       [20.0, height + (20.0 - face) * rise]])
    plant = Plant(replace(scene, model=replace(
        scene.model, terrain=terrain, solver=Solver(step=5e-4))), 1000.0)
    plant.state = start = plant.model.at_rest(0.0)._replace(
        velocity_x=speed, velocity_y=speed * rise, ball_rate=-speed / GIMBALL.ball_radius)
    controller, deciding = PendulumController(GIMBALL, load_tuning('published')), Decider(KNOWN)
    underway = []
    for index in range(12000):
        now, state = index / 1000, plant.state
        if index % 20 == 0:
            ahead, wrong = face - state.x, noise * math.sin(13.0 * now)
            underway.append(StepObservation(now, True, max(0.0, ahead + wrong), height + wrong,
                                            0.01, max(noise, 0.0005)))
            while underway and underway[0].stamp <= now - latency:
                deciding.observe(underway.pop(0))
            turned = -GIMBALL.ball_radius * (state.ball_angle - start.ball_angle)
            deciding.move(Motion(now, turned, -GIMBALL.ball_radius * state.ball_rate))
            _, decision, angle = deciding.decide()
            assert decision.kind in (Kind.STOP, Kind.GO_ROUND)
            controller.give(SetPoint('hold', angle, now))
            assert ahead > GIMBALL.ball_radius
        plant.advance(controller.torque(JointReadings(
            now, state.ball_angle, state.joint_angle, state.ball_rate, state.joint_rate)))
    assert abs(plant.state.velocity_x) < 0.05
