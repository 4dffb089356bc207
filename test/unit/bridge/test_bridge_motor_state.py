# SPDX-License-Identifier: Apache-2.0
"""The table of motor states: what leads to power, and where every way from it leads."""
from itertools import product

from hypothesis import given, strategies
import pytest

from ballbot_ros.bridge.motor_state import (
    Event, MEASUREMENT_AGE_MAX, MotorState, Power, STATUS_TIMEOUT, TRANSITIONS)
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.imus.plausibility import EXPLANATIONS

DISCONNECTED, DISARMED, ARMED, STOPPING = MotorState
# What a drive, or the lack of one, may do at any moment.
UNASKED = {StopReason.SILENT, StopReason.UNCONFIRMED, StopReason.HAZARD,
           StopReason.DISARMED_BY_DRIVE, StopReason.LOST}
EVENTS = (*Event, *StopReason)


def ways(to=None, by=None):
    """Return (state, event) of the transitions to a state, or by an event."""
    return {way for way, after in TRANSITIONS.items()
            if to in (None, after) and by in (None, way[1])}


def test_only_a_drive_that_confirmed_it_is_armed_and_only_from_disarmed():
    assert ways(to=ARMED) == {(DISARMED, Event.ARMED)}


def test_disarmed_is_only_what_a_drive_has_confirmed():
    assert ways(to=DISARMED) == {(DISCONNECTED, Event.FOUND), (STOPPING, Event.STOPPED)}


def test_every_way_from_power_leads_to_a_stop_or_to_a_drive_that_is_away():
    assert {TRANSITIONS[way] for way in TRANSITIONS if way[0] is ARMED} == {
        STOPPING, DISCONNECTED}
    assert ways(to=DISCONNECTED) & {(ARMED, event) for event in EVENTS} == {
        (ARMED, StopReason.LOST)}


def test_a_line_may_be_lost_wherever_there_is_one_and_closed_wherever_there_is_no_power():
    assert ways(by=StopReason.LOST) == {
        (state, StopReason.LOST) for state in (DISARMED, ARMED, STOPPING)}
    assert ways(by=Event.CLOSED) == {
        (state, Event.CLOSED) for state in (DISCONNECTED, DISARMED, STOPPING)}
    assert ways(to=DISCONNECTED) == ways(by=StopReason.LOST) | ways(by=Event.CLOSED)


def test_an_unrequested_change_is_a_fault_where_the_motor_had_power():
    faults = {way for way in TRANSITIONS if isinstance(way[1], StopReason)}
    assert faults == {(ARMED, event) for event in UNASKED} | {
        (STOPPING, StopReason.LOST), (DISARMED, StopReason.LOST),
        (DISARMED, StopReason.NOT_ARMED)}


def test_an_impossible_transition_is_an_error():
    for state, event in product(MotorState, EVENTS):
        if (state, event) not in TRANSITIONS:
            with pytest.raises(KeyError):
                Power(state).after(event, 1.0)


@given(strategies.lists(strategies.sampled_from(EVENTS)))
def test_power_lasts_since_the_last_event_that_changed_it(events):
    power, since = Power(), 0.0
    for number, event in enumerate(events, 1):
        if (power.state, event) in TRANSITIONS:
            power, since = power.after(event, float(number)), float(number)
            assert (power.state is ARMED) is (event is Event.ARMED)
    assert power.since == since


# What a drive does by itself --------------------------------------------------------------

WELL = Telemetry(status_time=11.0, armed=True)


def observed(silence=0.0, state=ARMED, status_age=0.0, **telemetry):
    """Return the event that a power since 10 s observes, None for none."""
    found = Power(state, 10.0).observe(WELL._replace(**telemetry), silence, status_age)
    return None if found is None else found.reason


def test_a_drive_that_answers_and_says_that_all_is_well_has_done_nothing():
    assert observed() is None and observed(armed=None) is None


@pytest.mark.parametrize('telemetry', [{'armed': False}, {'faults': ('HOT',)},
                                       {'faults': ('HOT',), 'armed': None}])
def test_a_drive_that_says_so_has_disarmed(telemetry):
    assert observed(**telemetry) is StopReason.DISARMED_BY_DRIVE


@pytest.mark.parametrize('status_time', [None, 9.0, 10.0])
def test_a_status_from_before_arming_does_not_count(status_time):
    assert observed(status_time=status_time, armed=False, faults=('HOT',)) is None


def test_a_drive_that_owes_an_answer_for_long_is_silent_after_any_report():
    assert observed(MEASUREMENT_AGE_MAX) is None
    assert observed(MEASUREMENT_AGE_MAX + 1e-6) is StopReason.SILENT
    assert observed(MEASUREMENT_AGE_MAX + 1e-6, armed=False) is StopReason.SILENT


def test_a_status_that_is_not_confirmed_for_long_is_a_fault():
    assert observed(status_age=STATUS_TIMEOUT) is None
    assert observed(status_age=STATUS_TIMEOUT + 1e-6) is StopReason.UNCONFIRMED


@pytest.mark.parametrize('state', [DISCONNECTED, DISARMED, STOPPING])
def test_without_power_there_is_nothing_to_lose(state):
    assert observed(1.0, state, armed=False, faults=('HOT',)) is None


def test_the_faults_are_named_and_their_lack_too():
    def names(**telemetry):
        return Power(ARMED).observe(WELL._replace(armed=False, **telemetry), 0.0, 0.0).names
    assert names(faults=('HOT', 'OVER_CURRENT')) == ('HOT', 'OVER_CURRENT') and names() == ()


def test_each_fault_of_motor_and_imu_has_a_code():
    faults = {event for _, event in TRANSITIONS if isinstance(event, StopReason)}
    assert all(StopReason(reason).is_fault for reason in (*faults, *EXPLANATIONS))
