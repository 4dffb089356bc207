# SPDX-License-Identifier: Apache-2.0
"""Messages are checked where they become values, and nowhere else."""
import math

from builtin_interfaces.msg import Time
from hypothesis import given, strategies as some
from joint_states import joint_state_message
import pytest
from refusals import refused
from sensor_msgs.msg import JointState

from ballbot_ros import decision
from ballbot_ros.control import Mode
from ballbot_ros.decision import Decision, Kind, Plan, Reason, Strategy
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import OdometryFilter, PendulumFilter
from ballbot_ros.msg import StepDecision, StepObservation, TerrainObservation
from ballbot_ros.physics import load_robot, Model, State, Terrain
from ballbot_ros.plant import TerrainSensor
from ballbot_ros.ros import conversions
from ballbot_ros.ros.frames import FRAMES
from ballbot_ros.steering import LateralState

GIMBALL = load_robot('gimball')


@given(some.integers(0, 2**31 - 1), some.integers(0, 10**9 - 1))
def test_a_stamp_survives_conversion_to_a_microsecond_and_small_ones_exactly(seconds, nanoseconds):
    stamp = Time(sec=seconds, nanosec=nanoseconds)
    back = conversions.to_time(conversions.to_seconds(stamp))
    assert abs((back.sec - seconds) * 10**9 + back.nanosec - nanoseconds) < 1000
    if seconds < 1000:
        assert back == stamp


@pytest.mark.parametrize('message, reason', [
    (JointState(name=['shell'], effort=[1.0]), 'unknown_joint'),
    (JointState(name=[], effort=[1.0]), 'unknown_joint'),
    (JointState(name=['pendulum', 'pendulum'], effort=[1.0, -1.0]), 'duplicate_joint'),
    (JointState(name=['pendulum', 'shell', 'pendulum'], effort=[1.0, 0.0, 1.0]),
     'duplicate_joint'),
    (JointState(name=['pendulum'], effort=[]), 'wrong_length'),
    (JointState(name=['pendulum'], effort=[1.0, 2.0]), 'wrong_length'),
    (JointState(name=['pendulum'], position=[1.0], effort=[1.0]), 'unsupported'),
    (JointState(name=['pendulum'], velocity=[1.0]), 'unsupported'),
])
def test_an_invalid_command_is_refused_with_a_reason(message, reason):
    with refused(reason, error=MessageError):
        conversions.command_torque(message)


def test_nan_in_a_command_means_not_given():
    message = JointState(
        name=['shell', 'pendulum'], position=[math.nan] * 2, effort=[math.nan, 1.5])
    assert conversions.command_torque(message) == 1.5


@pytest.mark.parametrize('message, mode, value', [
    (JointState(name=['pendulum'], position=[0.3]), Mode.HOLD, 0.3),
    (JointState(name=['pendulum'], velocity=[2.0]), Mode.DRIVE, 2.0),
    (JointState(name=['pendulum'], position=[math.nan], velocity=[2.0]), Mode.DRIVE, 2.0),
    (JointState(name=['pendulum']), Mode.IDLE, 0.0),
])
def test_the_field_of_a_set_point_selects_its_mode(message, mode, value):
    found = conversions.set_point(message, steers=False)
    assert (found.mode, found.value) == (mode, value)


@pytest.mark.parametrize('message, reason', [
    (JointState(name=['pendulum'], position=[0.3], velocity=[2.0]), 'contradictory'),
    (JointState(name=['shell'], position=[0.3]), 'unknown_joint'),
    (JointState(name=['pendulum'], position=[math.inf]), 'not_finite'),
    (JointState(name=['pendulum'], velocity=[-math.inf]), 'not_finite'),
    (JointState(name=['pendulum'], position=[math.nan]), 'not_finite'),
    (JointState(name=['pendulum'], velocity=[math.nan]), 'not_finite'),
    (JointState(name=['pendulum'], position=[math.nan], velocity=[math.nan]), 'not_finite'),
    (conversions.set_point_message(conversions.to_time(1.0), 0.3, 0.2), 'other_axes')])
def test_an_invalid_set_point_of_a_robot_that_drives_straight_is_refused(message, reason):
    with refused(reason, error=MessageError):
        conversions.set_point(message, steers=False)


@given(some.builds(State, *[some.floats(-50, 50)] * 9))
def test_readings_return_the_angles_of_the_state(state):
    found = conversions.readings(
        joint_state_message(state._replace(time=1.0), 0.5, True))
    assert found.pendulum_angle == pytest.approx(state.pendulum_angle, abs=1e-12)
    assert found.pendulum_rate == pytest.approx(state.pendulum_rate, abs=1e-12)


def test_a_robot_without_a_pendulum_has_one_joint_and_nan_for_the_rest():
    model = Model(load_robot('shellball'), Terrain.flat())
    state = model.at_rest(0.0, 0.5)
    assert list(joint_state_message(state, 0.0, False).name) == ['shell']
    message = conversions.ball_state_message(
        state, 0.0, model, FRAMES, LateralState(), (state.x, 0.0, 0.0))
    assert math.isnan(message.pendulum_angle) and math.isnan(message.pendulum_torque)
    assert len(message.contacts) == 1
    assert message.contacts[0].normal_force == pytest.approx(model.robot.weight)


@pytest.mark.parametrize('kind', list(Kind))
@pytest.mark.parametrize('reason', list(Reason))
def test_every_decision_has_its_number_in_the_message(kind, reason):
    message = conversions.decision_message(Time(), Decision(kind, reason, 0.4, 'because'))
    assert message.decision == getattr(StepDecision, f'DECISION_{kind.name}') != 0
    assert message.reason == getattr(StepDecision, f'REASON_{reason.name}') != 0
    assert message.explanation == 'because'


@given(some.floats(-3.0, 3.0), some.floats(0.0, 1e6), some.floats(-1.0, 1.0))
def test_a_set_point_survives_conversion(angle, stamp, yaw_rate):
    found = conversions.set_point(
        conversions.set_point_message(conversions.to_time(stamp), angle, yaw_rate), steers=True)
    assert (found.mode, found.value, found.yaw_rate) == (Mode.HOLD, angle, yaw_rate)
    assert found.stamp == pytest.approx(stamp, abs=1e-9, rel=1e-15)


def test_a_command_is_found_by_its_name_not_its_index():
    message = JointState(name=['wheel', 'pendulum', 'shell'], effort=[1.0, 2.0, 3.0])
    assert conversions.command_torque(message) == 2.0


STATE = {'name': ['shell', 'pendulum'], 'position': [0.1, 0.2], 'velocity': [0.3, 0.4]}


@pytest.mark.parametrize('change, reason', [
    ({'name': ['shell', 'wheel']}, 'unknown_joint'),
    ({'name': ['pendulum', 'pendulum']}, 'unknown_joint'),
    ({'name': ['shell', 'pendulum', 'shell']}, 'duplicate_joint'),
    ({'name': ['wheel', 'pendulum']}, 'unknown_joint'), ({'name': ['shell']}, 'wrong_length'),
    ({'position': [0.1]}, 'wrong_length'), ({'velocity': []}, 'wrong_length'),
    ({'position': [math.nan, 0.2]}, 'not_finite'), ({'velocity': [0.3, math.inf]}, 'not_finite')])
def test_invalid_readings_are_refused(change, reason):
    with refused(reason, error=MessageError):
        conversions.readings(JointState(**{**STATE, **change}))


@given(some.builds(State, *[some.floats(-50, 50)] * 9))
def test_odometry_returns_position_and_speed(state):
    message = conversions.odometry_message(
        state._replace(time=2.5), (state.x, 0.0, 0.0), LateralState(), 0.226, FRAMES)
    assert conversions.motion(message) == (
        type(conversions.motion(message))(2.5, state.x, state.velocity_x))
    assert message.pose.pose.position.z == state.y
    assert message.pose.pose.orientation.w == 1.0  # level: the frame does not roll
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')


def test_odometry_of_the_simulator_is_marked_as_exact_and_not_as_unknown():
    message = conversions.odometry_message(
        State(), (0.0, 0.0, 0.0), LateralState(), 0.226, FRAMES)
    for covariance in (message.pose.covariance, message.twist.covariance):
        variances = covariance.reshape(6, 6).diagonal()
        assert all(variances > 0.0) and all(variances < 1e-9)
        assert covariance.sum() == variances.sum()


def test_estimated_odometry_has_variances_of_the_path_and_of_unknown_quantities():
    estimate = PendulumFilter(GIMBALL).start(3.0, 0.0)
    state = OdometryFilter(GIMBALL).start(estimate)._replace(
        position=1.5, speed=-0.25, position_variance=0.04, speed_variance=0.01)
    message = conversions.estimated_odometry_message(
        1e9, state, 0.226, FRAMES, None, LateralState())
    motion = conversions.motion(message)
    assert (motion.stamp, motion.position, motion.speed) == (1e9, 1.5, -0.25)
    pose, twist = (covariance.reshape(6, 6).diagonal() for covariance in (
        message.pose.covariance, message.twist.covariance))
    assert pose[0] == pytest.approx(0.04) and twist[0] == pytest.approx(0.01)
    for variances in (pose, twist):
        assert all(variances[[1, 2, 5]] == conversions.UNKNOWN)
        assert all(variances[[3, 4]] == conversions.EXACT)
    assert message.pose.pose.position.z == 0.226
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')


def test_the_ball_state_holds_the_values_of_the_model():
    model = Model(load_robot('gimball'), Terrain.step(0.05, at=0.226))
    state = model.at_rest(0.0, 0.3)._replace(time=1.25, motor_work=0.5, friction_loss=0.25)
    message = conversions.ball_state_message(
        state, 0.75, model, FRAMES, LateralState(), (state.x, 0.0, 0.0))
    assert (message.x, message.y, message.velocity_x) == (state.x, state.y, state.velocity_x)
    assert message.pendulum_torque == 0.75 and message.motor_work == 0.5
    assert message.dissipated_energy == 0.25
    energies = model.energies(state)
    assert message.kinetic_energy + message.potential_energy + message.contact_energy \
        == pytest.approx(energies.total)
    assert [contact.x for contact in message.contacts] == [
        touch.x for touch in model.touches(state)]
    assert conversions.to_seconds(message.header.stamp) == 1.25


@given(*[some.floats(allow_nan=True, allow_infinity=True)] * 4, some.booleans())
def test_an_observation_is_passed_to_the_tracker_unchanged(
        distance, height, distance_sd, height_sd, detected):
    found = conversions.observation(StepObservation(
        detected=detected, distance=distance, height=height, distance_sd=distance_sd,
        height_sd=height_sd))
    assert str((found.distance, found.height, found.distance_sd, found.height_sd)) \
        == str((distance, height, distance_sd, height_sd))
    assert found.detected == detected


@pytest.mark.parametrize('position, start, swing', [(0.7, 0.0, 0.3), (0.9, 0.0, 0.1)])
def test_the_distance_to_the_swing_is_that_from_the_present_position(position, start, swing):
    plan = Plan(Strategy.SWING, swing_position=1.0, edge=1.3)
    message = conversions.decision_message(
        Time(), Decision(Kind.CROSS, Reason.COMMITTED, 0.4, '', plan=plan), position)
    assert (message.start_distance, message.swing_distance) == pytest.approx((start, swing))


def test_the_distance_to_the_start_of_a_run_up_is_that_from_the_present_position():
    plan = Plan(Strategy.BACK_OFF, start=-0.5)
    message = conversions.decision_message(
        Time(), Decision(Kind.BACK_OFF, Reason.RUN_UP, 0.4, '', plan=plan), 0.2)
    assert message.start_distance == pytest.approx(0.7)


def test_a_decision_without_a_step_has_height_0_and_nan_for_unknown_values():
    message = conversions.decision_message(
        conversions.to_time(3.0), Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, 0.4, 'free'))
    assert message.height == 0.0 and message.speed == 0.4
    assert all(map(math.isnan, (message.required_speed, message.reachable_speed,
                                message.height_margin, message.distance)))


@given(some.lists(some.floats(allow_nan=True, allow_infinity=True), max_size=3),
       some.lists(some.floats(allow_nan=True, allow_infinity=True), max_size=3),
       some.floats(allow_nan=True, allow_infinity=True), some.text(max_size=9))
def test_a_polyline_is_passed_to_the_tracker_unchanged(x, z, x_max, frame):
    message = TerrainObservation(x=x, z=z, z_sd=z, x_min=-1.0, x_max=x_max)
    message.header.frame_id = frame
    message.header.stamp = conversions.to_time(2.5)
    found = conversions.terrain_observation(message)
    assert str(found) == str(decision.TerrainObservation(
        2.5, tuple(x), tuple(z), tuple(z), -1.0, x_max, frame))


def test_terrain_observations_are_stamped_and_in_the_level_frame():
    sight = TerrainSensor(Terrain.flat(), 3.0, 0.001).measure(0.0, 0.226, 0)
    message = conversions.terrain_message(conversions.to_time(1.5), sight, FRAMES)
    assert conversions.terrain_observation(message) == decision.TerrainObservation(
        1.5, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max)


def test_names_of_any_length_give_a_short_error():
    with refused('unknown_joint', error=MessageError) as caught:
        conversions.command_torque(JointState(name=['x' * 100000], effort=[1.0]))
    assert len(str(caught.value)) < 400
