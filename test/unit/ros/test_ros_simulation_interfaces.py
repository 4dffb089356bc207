# SPDX-License-Identifier: Apache-2.0
"""simulation_interfaces as a client uses them: codes, states, steps, entities."""
import math

import pytest
from rclpy.action import ActionClient
from rclpy.node import Node

from ballbot_ros.nodes.simulator.node import Simulator

srv = pytest.importorskip('simulation_interfaces.srv')
msg = pytest.importorskip('simulation_interfaces.msg')
SimulateSteps = pytest.importorskip('simulation_interfaces.action').SimulateSteps
Bounds, EntityCategory, EntityFilters, EntityState, Result = (
    msg.Bounds, msg.EntityCategory, msg.EntityFilters, msg.EntityState, msg.Result)
SimulationState, SimulatorFeatures, TagsFilter = (
    msg.SimulationState, msg.SimulatorFeatures, msg.TagsFilter)

STOPPED, PLAYING, PAUSED = 0, 1, 2
OK, UNSUPPORTED, NOT_FOUND, FAILED = (
    Result.RESULT_OK, Result.RESULT_FEATURE_UNSUPPORTED, Result.RESULT_NOT_FOUND,
    Result.RESULT_OPERATION_FAILED)


class Client:
    """A client in the process of the simulator."""

    def __init__(self, spinner, simulator, node):
        spinner.add(simulator, node)
        self.node, self.wait, self.clients = node, spinner.until, {}

    def done(self, future):
        self.wait(future.done)
        return future.result()

    def ask(self, kind, **fields):
        """Call a service and return its response."""
        if kind not in self.clients:
            name = ''.join('_' + c.lower() if c.isupper() else c for c in kind.__name__)[1:]
            self.clients[kind] = self.node.create_client(kind, f'/simulator/{name}')
        client = self.clients[kind]
        self.wait(client.service_is_ready)
        return self.done(client.call_async(kind.Request(**fields)))

    def code(self, kind, **fields):
        return self.ask(kind, **fields).result.result

    def state(self):
        return self.ask(srv.GetSimulationState).state.state

    def set_state(self, state):
        return self.code(srv.SetSimulationState, state=SimulationState(state=state))


@pytest.fixture
def simulator(make_node):
    return make_node(Simulator, scene='flat', start_paused=True, real_time_factor=0.0)


@pytest.fixture
def client(spinner, make_node, simulator):
    return Client(spinner, simulator, make_node(Node, 'client'))


def test_the_supported_features_are_reported(client):
    features = client.ask(srv.GetSimulatorFeatures).features
    assert SimulatorFeatures.STEP_SIMULATION_ACTION in features.features
    assert SimulatorFeatures.SIMULATION_RESET_TIME in features.features
    assert not features.spawn_formats


def test_states_and_transitions_have_their_codes(client, simulator):
    answer = srv.SetSimulationState.Response
    assert client.state() == STOPPED
    assert client.set_state(STOPPED) == answer.ALREADY_IN_TARGET_STATE
    assert client.set_state(PAUSED) == answer.INCORRECT_TRANSITION
    assert client.set_state(PLAYING) == OK and client.state() == PLAYING
    assert client.code(srv.StepSimulation, steps=1) == FAILED
    client.wait(lambda: simulator._plant.periods)  # before its start it is stopped, not paused
    assert client.set_state(PAUSED) == OK and client.state() == PAUSED
    assert client.set_state(PAUSED) == answer.ALREADY_IN_TARGET_STATE
    assert client.set_state(STOPPED) == OK and client.state() == STOPPED
    assert client.set_state(SimulationState.STATE_NO_WORLD) == answer.INCORRECT_TRANSITION
    assert client.set_state(SimulationState.STATE_QUITTING) == UNSUPPORTED


def test_steps_run_exactly_and_zero_steps_are_refused(client, simulator):
    assert client.code(srv.StepSimulation, steps=7) == OK
    assert simulator._plant.periods == 7 and client.state() == PAUSED
    assert client.code(srv.StepSimulation, steps=0) == FAILED


@pytest.mark.parametrize('scope, state, time', [
    ('SCOPE_DEFAULT', True, True), ('SCOPE_ALL', True, True), ('SCOPE_STATE', True, False),
    ('SCOPE_TIME', False, True), ('SCOPE_SPAWNED', False, False)])
def test_a_reset_covers_its_scope(client, simulator, scope, state, time):
    start = simulator._plant.state
    moved = start._replace(x=start.x + 1.0)
    simulator._scheduler.put(moved)
    client.ask(srv.StepSimulation, steps=5)
    code = client.code(srv.ResetSimulation, scope=getattr(srv.ResetSimulation.Request, scope))
    assert code == OK
    assert (abs(simulator._plant.state.x - start.x) < 0.5) is state
    assert simulator._plant.periods == (0 if time else 5)
    assert simulator._plant.state.time == pytest.approx(simulator._plant.time)
    assert (client.state() == STOPPED) is state


def test_after_a_reset_a_run_is_repeated_to_the_bit(client, simulator):
    def run():
        assert client.code(srv.ResetSimulation) == OK
        client.ask(srv.StepSimulation, steps=20)
        return simulator._plant.state
    assert run() == run()


def test_the_action_reports_its_progress_and_can_be_canceled(client, simulator):
    action, reports = ActionClient(client.node, SimulateSteps, '/simulator/simulate_steps'), []
    client.wait(action.server_is_ready)

    def send(steps):
        return client.done(action.send_goal_async(
            SimulateSteps.Goal(steps=steps), lambda one: reports.append(one.feedback)))

    done = client.done(send(50).get_result_async())
    assert (done.status, done.result.result.result) == (4, OK)
    client.wait(lambda: reports and reports[-1].remaining_steps == 0)
    assert reports[-1].completed_steps == simulator._plant.periods == 50

    goal = send(2**40)
    other = client.done(send(1).get_result_async())
    assert (other.status, other.result.result.result) == (6, FAILED)
    client.done(goal.cancel_goal_async())
    done = client.done(goal.get_result_async())
    assert (done.status, done.result.result.result) == (5, FAILED)
    assert client.state() == PAUSED


def test_the_progress_of_the_action_counts_steps_and_not_the_time(client, simulator):
    action, reports = ActionClient(client.node, SimulateSteps, '/simulator/simulate_steps'), []
    client.wait(action.server_is_ready)
    goal = client.done(action.send_goal_async(
        SimulateSteps.Goal(steps=2**40), lambda one: reports.append(one.feedback)))
    client.wait(lambda: simulator._plant.periods > 10 and reports)
    assert client.code(srv.ResetSimulation) == OK
    reset_at, reports[:] = reports[-1].completed_steps, []
    client.wait(lambda: reports)
    assert reports[0].completed_steps > reset_at
    assert reports[0].completed_steps + reports[0].remaining_steps == 2**40
    client.done(goal.cancel_goal_async())
    assert client.done(goal.get_result_async()).status == 5


def test_entities_are_filtered_and_unknown_ones_not_found(client):
    def names(**filters):
        return client.ask(srv.GetEntities, filters=EntityFilters(**filters))

    everything = names()
    assert everything.result.result == OK and len(everything.entities) == 1
    robot = everything.entities[0]
    assert names(filter=f'^{robot[:3]}').entities == [robot]
    assert names(filter='^missing$').entities == []
    assert names(filter='(').result.result == FAILED
    assert names(categories=[EntityCategory(category=EntityCategory.CATEGORY_HUMAN)]).entities \
        == []
    assert names(tags=TagsFilter(tags=['x'])).result.result == UNSUPPORTED
    assert names(bounds=Bounds(type=Bounds.TYPE_BOX)).result.result == UNSUPPORTED
    assert client.code(srv.GetEntityState, entity='missing') == NOT_FOUND
    assert client.code(srv.SetEntityState, entity='missing') == NOT_FOUND


def test_the_robot_is_set_to_a_requested_pose_unless_it_is_invalid(client):
    robot = client.ask(srv.GetEntities).entities[0]

    def put(**changes):
        state = EntityState()
        state.pose.position.z, state.pose.orientation.w = 0.3, 1.0
        for path, value in changes.items():
            *parents, last = path.split('__')
            part = state
            for name in parents:
                part = getattr(part, name)
            setattr(part, last, value)
        return client.code(srv.SetEntityState, entity=robot, state=state, set_pose=True,
                           set_twist=True)

    assert put(pose__position__x=1.5, twist__linear__x=0.4) == OK
    state = client.ask(srv.GetEntityState, entity=robot).state
    assert (state.pose.position.x, state.pose.position.z, state.twist.linear.x) == (1.5, 0.3, 0.4)
    assert state.header.frame_id == 'odom' and client.state() == PAUSED
    for wrong in ({'pose__position__x': math.nan}, {'pose__position__y': 0.1},
                  {'pose__position__z': 0.1}, {'pose__position__z': 0.0},
                  {'pose__position__z': -1.0}, {'pose__orientation__w': 0.0},
                  {'twist__angular__z': 1.0}):
        assert put(**wrong) == srv.SetEntityState.Response.INVALID_POSE
    assert put(header__frame_id='map') == FAILED


def test_the_pose_of_the_resting_robot_can_be_set_again(client):
    robot = client.ask(srv.GetEntities).entities[0]
    state = client.ask(srv.GetEntityState, entity=robot).state
    assert client.code(srv.SetEntityState, entity=robot, state=state, set_pose=True) == OK
