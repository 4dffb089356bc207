# SPDX-License-Identifier: Apache-2.0
"""The scheduler never runs more control periods than are due and allowed."""
from types import SimpleNamespace

import pytest
from refusals import refused
from rosgraph_msgs.msg import Clock

from ballbot_ros.control import CommandGate
from ballbot_ros.nodes.simulator import scheduler
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant
from ballbot_ros.ros.conversions import to_time


class Outputs:
    """Count the publications."""

    state_subscribers = 2

    def __init__(self):
        self.published = self.repeated = 0

    def publish(self, everything=False):
        self.published += 1

    def repeat(self):
        self.repeated += 1


class Log(list):
    """Store the log messages."""

    def warning(self, text, **_):
        self.append(text)

    fatal = warning


@pytest.fixture
def clock(monkeypatch):
    """Return a wall clock that the test sets."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(scheduler.time, 'monotonic', lambda: clock.now)
    return clock


def scheduled(scene=None, **parameters):
    """Return a scheduler with its plant, gate, outputs and log."""
    settings = SimulatorSettings(**parameters)
    plant = Plant(scene or load_scene('flat'), settings.control_rate)
    setup = SimpleNamespace(plant=plant, gate=CommandGate(settings.command_timeout),
                            outputs=Outputs(), log=Log(), failures=[])
    setup.scheduler = scheduler.Scheduler(
        plant, setup.gate, setup.outputs, settings, setup.log,
        lambda: setup.failures.append(plant.time))
    return setup


def tick(setup, clock, seconds):
    clock.now += seconds
    setup.scheduler.tick()


def test_simulated_time_follows_the_clock_and_catches_up_to_a_limit(clock):
    setup = scheduled()
    tick(setup, clock, 0.0)
    tick(setup, clock, 0.0021)
    assert setup.plant.periods == 1
    tick(setup, clock, 0.0101)
    assert setup.plant.periods == 6
    tick(setup, clock, 5.0)
    assert setup.plant.periods == 16 and setup.scheduler.dropped == 2490
    tick(setup, clock, 1.0)
    assert setup.log[-1].startswith('falling behind: real-time factor 0.0')


def test_a_pause_does_not_count_in_the_real_time_factor(clock):
    setup = scheduled()
    for tenth in range(40):
        if tenth in (10, 29):
            (setup.scheduler.pause if tenth == 10 else setup.scheduler.resume)()
        for _ in range(10):
            tick(setup, clock, 0.01)
    assert setup.scheduler.real_time_factor == pytest.approx(1.0, abs=0.01) and not setup.log


def test_a_follower_of_a_slow_clock_does_not_fall_behind_its_own_real_time_factor(
        clock, monkeypatch):
    monkeypatch.setattr(scheduler, 'create_subscription', lambda *_: None)
    around = scheduled()
    followed = scheduler.FollowedClock(
        SimpleNamespace(get_logger=lambda: around.log), around.plant)
    follower = scheduler.Scheduler(around.plant, around.gate, around.outputs, SimulatorSettings(),
                                   around.log, around.failures.append, followed)
    for there, passed in ((0.0, 0.0), (0.05, 0.1), (0.1, 0.1), (2.0, 3.8)):
        followed._on_clock(Clock(clock=to_time(there)))
        tick(SimpleNamespace(scheduler=follower), clock, passed)
    assert follower.dropped and len(around.log) == 1
    assert around.log[0].startswith('/clock is at 2.000 s')


@pytest.mark.parametrize('parameters', [
    {}, {'real_time_factor': 50.0}, {'real_time_factor': 0.0}])
@pytest.mark.parametrize('periods', [1, 3, 17])
def test_a_step_is_the_requested_number_of_periods_even_if_more_are_due(
        clock, monkeypatch, parameters, periods):
    setup = scheduled(start_paused=True, **parameters)
    done = setup.scheduler.step(periods)
    for _ in range(30):
        tick(setup, clock, 0.01)
    assert setup.plant.periods == periods and setup.outputs.published == periods + 1
    assert done.done() and done.result() is True
    assert setup.scheduler.paused


def test_in_lockstep_time_waits_for_an_answer_and_the_state_is_repeated(clock):
    setup = scheduled(lockstep=True, real_time_factor=0.0, lockstep_timeout=2.0)
    for _ in range(10):
        tick(setup, clock, 0.05)
    assert setup.plant.periods == 0 and setup.outputs.repeated == 2
    setup.scheduler.command_accepted(answer=True)
    assert setup.plant.periods == 1
    setup.scheduler.command_accepted(answer=True)
    assert setup.plant.periods == 2
    setup.gate.offer(1.0, 0.004, 0.004)
    for _ in range(50):
        tick(setup, clock, 0.05)
    assert setup.plant.periods == 2 and setup.gate.torque(0.004) == 0.0
    assert 'no command answers the state of t = 0.004 s: time is stopped' in setup.log[-1]
    assert 'subscribers of joint_states: 2' in setup.log[-1]


def test_in_lockstep_in_real_time_an_answer_waits_for_the_clock(clock):
    setup = scheduled(lockstep=True, real_time_factor=1.0)
    tick(setup, clock, 0.0)
    setup.scheduler.command_accepted(answer=True)
    assert setup.plant.periods == 0
    tick(setup, clock, 0.0021)
    assert setup.plant.periods == 1
    tick(setup, clock, 0.5)  # late answers are not caught up with
    setup.scheduler.command_accepted(answer=True)
    setup.scheduler.command_accepted(answer=True)
    assert setup.plant.periods == 2


def test_an_answer_during_a_pause_counts_after_it(clock):
    setup = scheduled(lockstep=True, real_time_factor=0.0, start_paused=True)
    setup.scheduler.command_accepted(answer=True)
    assert setup.plant.periods == 0
    setup.scheduler.resume()
    tick(setup, clock, 0.05)
    assert setup.plant.periods == 1


def test_a_failure_ends_the_step_is_logged_once_and_is_cleared_by_reset(clock):
    falling = read_scene({
        'robot': 'gimball', 'robot_changes': {'contact_stiffness': 500.0}, 'duration': 1.0,
        'initial': {'y': 1.0, 'velocity_y': -10.0}}, 'test', 'test')
    setup = scheduled(falling, start_paused=True)
    done = setup.scheduler.step(1000)
    for _ in range(100):
        tick(setup, clock, 0.02)
    assert done.result() is False and len(setup.failures) == 1
    assert 'under the ground' in str(setup.scheduler.failure)
    assert sum('Nothing is published until ~/reset' in text for text in setup.log) == 1
    published = setup.outputs.published
    assert published == setup.plant.periods + 1
    for act in (setup.scheduler.resume, lambda: setup.scheduler.step(1)):
        with refused('failed', 'simulation'):
            act()
    assert setup.scheduler.paused
    setup.scheduler.reset()
    assert setup.scheduler.failure is None and setup.outputs.published == published + 1
    assert setup.scheduler.paused


def test_missing_commands_are_logged_once_each_time(clock):
    setup = scheduled(real_time_factor=0.0, start_paused=True, command_timeout=0.01)

    def run(periods):
        setup.scheduler.step(periods)
        while not setup.scheduler.paused:
            setup.scheduler.tick()
    for _ in range(2):
        run(20)
        setup.gate.offer(1.0, setup.plant.time, setup.plant.time)
        setup.scheduler.command_accepted(answer=False)
        run(20)
    assert len(setup.log) == 2
    assert 'no command for 0.01 s at t = 0.05' in setup.log[0]


def test_a_step_counts_down_and_then_pauses_and_an_interruption_leaves_it_incomplete(clock):
    setup = scheduled(start_paused=True)
    control, period = setup.scheduler, setup.plant.period
    tick(setup, clock, 5.0 * period)
    assert control.paused and not setup.plant.periods
    done = control.step(2)
    tick(setup, clock, 1.5 * period)
    assert not control.paused and not done.done()
    tick(setup, clock, 5.0 * period)
    assert control.paused and done.result() is True and setup.plant.periods == 2
    ended = control.step(3)
    with refused('refused', 'simulation'):
        control.step(1)
    control.pause()
    assert control.paused and ended.result() is False
    ended = control.step(3)
    control.resume()
    assert not control.paused and ended.result() is False
