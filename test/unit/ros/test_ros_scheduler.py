# SPDX-License-Identifier: Apache-2.0
"""The scheduler never runs more control periods than are due and allowed."""
from types import SimpleNamespace

import pytest

from ballbot_ros.control import CommandGate
from ballbot_ros.nodes.simulator import scheduler
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant


class Outputs:
    """Count what would be published."""

    state_subscribers = 2

    def __init__(self):
        self.published = self.repeated = 0

    def publish(self, everything=False):
        self.published += 1

    def repeat(self):
        self.repeated += 1


class Log(list):
    """Keep what would be logged."""

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
    """Return a scheduler with all around it."""
    settings = SimulatorSettings(**parameters)
    plant = Plant(scene or load_scene('flat'), settings.control_rate)
    around = SimpleNamespace(plant=plant, gate=CommandGate(settings.command_timeout),
                             outputs=Outputs(), log=Log(), failures=[])
    around.scheduler = scheduler.Scheduler(
        plant, around.gate, around.outputs, settings, around.log,
        lambda: around.failures.append(plant.time))
    return around


def tick(around, clock, seconds):
    clock.now += seconds
    around.scheduler.tick()


def test_real_time_passes_with_the_clock_and_catches_up_so_far(clock):
    around = scheduled()
    tick(around, clock, 0.0)
    tick(around, clock, 0.0021)
    assert around.plant.periods == 1
    tick(around, clock, 0.0101)
    assert around.plant.periods == 6
    tick(around, clock, 5.0)
    assert around.plant.periods == 16 and around.scheduler.dropped == 2490
    tick(around, clock, 1.0)
    assert around.log[-1].startswith('falling behind: real-time factor 0.0')


@pytest.mark.parametrize('parameters', [
    {}, {'real_time_factor': 50.0}, {'real_time_factor': 0.0}])
@pytest.mark.parametrize('periods', [1, 3, 17])
def test_a_step_is_the_requested_number_of_periods_even_where_more_are_due(
        clock, monkeypatch, parameters,
                                                           periods):
    around = scheduled(start_paused=True, **parameters)
    done = around.scheduler.step(periods)
    for _ in range(30):
        tick(around, clock, 0.01)
    assert around.plant.periods == periods and around.outputs.published == periods + 1
    assert done.done() and done.result() is True
    assert around.scheduler.paused


def test_in_lockstep_time_waits_for_its_answer_and_asks_again(clock):
    around = scheduled(lockstep=True, real_time_factor=0.0, lockstep_timeout=2.0)
    for _ in range(10):
        tick(around, clock, 0.05)
    assert around.plant.periods == 0 and around.outputs.repeated == 2
    around.scheduler.command_accepted(answer=True)
    assert around.plant.periods == 1
    around.scheduler.command_accepted(answer=True)
    assert around.plant.periods == 2
    around.gate.offer(1.0, 0.004, 0.004)
    for _ in range(50):
        tick(around, clock, 0.05)
    assert around.plant.periods == 2 and around.gate.torque(0.004) == 0.0
    assert 'no command answers the state of t = 0.004 s: time is stopped' in around.log[-1]
    assert 'subscribers of joint_states: 2' in around.log[-1]


def test_in_lockstep_in_real_time_an_answer_waits_for_the_clock(clock):
    around = scheduled(lockstep=True, real_time_factor=1.0)
    tick(around, clock, 0.0)
    around.scheduler.command_accepted(answer=True)
    assert around.plant.periods == 0
    tick(around, clock, 0.0021)
    assert around.plant.periods == 1
    tick(around, clock, 0.5)  # late answers are not caught up with
    around.scheduler.command_accepted(answer=True)
    around.scheduler.command_accepted(answer=True)
    assert around.plant.periods == 2


def test_an_answer_that_came_while_paused_counts_after(clock):
    around = scheduled(lockstep=True, real_time_factor=0.0, start_paused=True)
    around.scheduler.command_accepted(answer=True)
    assert around.plant.periods == 0
    around.scheduler.resume()
    tick(around, clock, 0.05)
    assert around.plant.periods == 1


def test_a_failure_ends_the_step_is_logged_once_and_reset_ends_it(clock):
    falling = read_scene({
        'robot': 'gimball', 'robot_changes': {'contact_stiffness': 500.0}, 'duration': 1.0,
        'initial': {'y': 1.0, 'velocity_y': -10.0}}, 'test', 'test')
    around = scheduled(falling, start_paused=True)
    done = around.scheduler.step(1000)
    for _ in range(100):
        tick(around, clock, 0.02)
    assert done.result() is False and len(around.failures) == 1
    assert 'under the ground' in str(around.scheduler.failure)
    assert sum('Nothing is published until ~/reset' in text for text in around.log) == 1
    published = around.outputs.published
    assert published == around.plant.periods + 1
    around.scheduler.reset()
    assert around.scheduler.failure is None and around.outputs.published == published + 1
    assert around.scheduler.paused


def test_missing_commands_are_logged_once_each_time(clock):
    around = scheduled(real_time_factor=0.0, start_paused=True, command_timeout=0.01)

    def run(periods):
        around.scheduler.step(periods)
        while not around.scheduler.paused:
            around.scheduler.tick()
    for _ in range(2):
        run(20)
        around.gate.offer(1.0, around.plant.time, around.plant.time)
        around.scheduler.command_accepted(answer=False)
        run(20)
    assert len(around.log) == 2
    assert 'no command for 0.01 s at t = 0.05' in around.log[0]


def test_a_step_counts_down_and_then_pauses_and_an_interruption_leaves_it_incomplete(clock):
    around = scheduled(start_paused=True)
    control, period = around.scheduler, around.plant.period
    tick(around, clock, 5.0 * period)
    assert control.paused and not around.plant.periods
    done = control.step(2)
    tick(around, clock, 1.5 * period)
    assert not control.paused and not done.done()
    tick(around, clock, 5.0 * period)
    assert control.paused and done.result() is True and around.plant.periods == 2
    ended = control.step(3)
    control.pause()
    assert control.paused and ended.result() is False
    ended = control.step(3)
    control.resume()
    assert not control.paused and ended.result() is False
