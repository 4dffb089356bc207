# SPDX-License-Identifier: Apache-2.0
"""The table of motor states: all transitions to and from power."""
from itertools import product

from hypothesis import given, strategies
import pytest

from ballbot_ros.bridge.motor_state import (
    Event, MEASUREMENT_AGE_MAX, MotorState, Power, STATUS_TIMEOUT, TRANSITIONS)
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.imus.plausibility import EXPLANATIONS

DISCONNECTED, DISARMED, ARMED, STOPPING = MotorState
# Events that a drive, its loss, or a delay of the loop may cause at any time.
UNREQUESTED = {StopReason.SILENT, StopReason.UNCONFIRMED, StopReason.HAZARD,
               StopReason.DISARMED_BY_DRIVE, StopReason.HELD_UP, StopReason.LOST}
EVENTS = (*Event, *StopReason)


def matching(to=None, by=None):
    """Return (state, event) of the transitions to a state or by an event."""
    return {key for key, after in TRANSITIONS.items()
            if to in (None, after) and by in (None, key[1])}


def test_the_motor_is_armed_only_from_disarmed_and_only_by_confirmation():
    assert matching(to=ARMED) == {(DISARMED, Event.ARMED)}


def test_the_motor_is_disarmed_only_by_confirmation():
    assert matching(to=DISARMED) == {(DISCONNECTED, Event.FOUND), (STOPPING, Event.STOPPED)}


def test_every_transition_from_power_leads_to_a_stop_or_a_disconnected_drive():
    assert {TRANSITIONS[key] for key in TRANSITIONS if key[0] is ARMED} == {
        STOPPING, DISCONNECTED}
    assert matching(to=DISCONNECTED) & {(ARMED, event) for event in EVENTS} == {
        (ARMED, StopReason.LOST)}


def test_a_line_may_be_lost_in_any_connected_state_and_closed_in_any_state_without_power():
    assert matching(by=StopReason.LOST) == {
        (state, StopReason.LOST) for state in (DISARMED, ARMED, STOPPING)}
    assert matching(by=Event.CLOSED) == {
        (state, Event.CLOSED) for state in (DISCONNECTED, DISARMED, STOPPING)}
    assert matching(to=DISCONNECTED) == matching(by=StopReason.LOST) | matching(by=Event.CLOSED)


def test_an_unrequested_change_is_a_fault_if_the_motor_had_power():
    faults = {key for key in TRANSITIONS if isinstance(key[1], StopReason)}
    assert faults == {(ARMED, event) for event in UNREQUESTED} | {
        (STOPPING, StopReason.LOST), (DISARMED, StopReason.LOST),
        (DISARMED, StopReason.NOT_ARMED)}


def test_an_impossible_transition_is_an_error():
    for state, event in product(MotorState, EVENTS):
        if (state, event) not in TRANSITIONS:
            with pytest.raises(KeyError):
                Power(state).after(event, 1.0)


@given(strategies.lists(strategies.sampled_from(EVENTS)))
def test_a_state_lasts_since_the_last_event_that_changed_it(events):
    power, since = Power(), 0.0
    for number, event in enumerate(events, 1):
        if (power.state, event) in TRANSITIONS:
            power, since = power.after(event, float(number)), float(number)
            assert (power.state is ARMED) is (event is Event.ARMED)
    assert power.since == since


# What a drive does by itself --------------------------------------------------------------

WELL = Telemetry(status_time=11.0, armed=True)


def observed(silence=0.0, state=ARMED, status_age=0.0, **telemetry):
    """Return the stop reason that is observed in `state`, entered at 10 s, or None."""
    found = Power(state, 10.0).observe(WELL._replace(**telemetry), silence, status_age)
    return None if found is None else found.reason


def test_a_drive_that_answers_without_faults_causes_no_event():
    assert observed() is None and observed(armed=None) is None


@pytest.mark.parametrize('telemetry', [{'armed': False}, {'faults': ('HOT',)},
                                       {'faults': ('HOT',), 'armed': None}])
def test_a_drive_that_reports_a_fault_or_no_power_has_disarmed_the_motor(telemetry):
    assert observed(**telemetry) is StopReason.DISARMED_BY_DRIVE


@pytest.mark.parametrize('status_time', [None, 9.0, 10.0])
def test_a_status_from_before_arming_does_not_count(status_time):
    assert observed(status_time=status_time, armed=False, faults=('HOT',)) is None


def test_an_overdue_answer_makes_a_drive_silent_after_any_report():
    assert observed(MEASUREMENT_AGE_MAX) is None
    assert observed(MEASUREMENT_AGE_MAX + 1e-6) is StopReason.SILENT
    assert observed(MEASUREMENT_AGE_MAX + 1e-6, armed=False) is StopReason.SILENT


def test_a_status_that_is_not_confirmed_in_time_is_a_fault():
    assert observed(status_age=STATUS_TIMEOUT) is None
    assert observed(status_age=STATUS_TIMEOUT + 1e-6) is StopReason.UNCONFIRMED


@pytest.mark.parametrize('state', [DISCONNECTED, DISARMED, STOPPING])
def test_without_power_no_event_is_observed(state):
    assert observed(1.0, state, armed=False, faults=('HOT',)) is None


def test_the_faults_are_named_and_may_be_none():
    def names(**telemetry):
        return Power(ARMED).observe(WELL._replace(armed=False, **telemetry), 0.0, 0.0).names
    assert names(faults=('HOT', 'OVER_CURRENT')) == ('HOT', 'OVER_CURRENT') and names() == ()


def test_each_fault_of_motor_and_imu_has_a_code():
    faults = {event for _, event in TRANSITIONS if isinstance(event, StopReason)}
    assert all(StopReason(reason).is_fault for reason in (*faults, *EXPLANATIONS))
