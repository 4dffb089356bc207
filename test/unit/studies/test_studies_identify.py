# SPDX-License-Identifier: Apache-2.0
"""Identification from noisy runs: intervals contain the truth, undetermined ones are named."""
from dataclasses import replace
import json
import math
import warnings

from bag_of_a_run import BagOf
import numpy as np
import pytest
from refusals import refused

from ballbot_ros.bags.recorded_run import read_run
from ballbot_ros.bags.replay import measured_columns
from ballbot_ros.cli import main
from ballbot_ros.errors import PlausibilityWarning
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.results import read_columns, read_units, write_trajectory
from ballbot_ros.studies.identification import identify, present, with_values
from ballbot_ros.studies.recording import MOST_SAMPLES, Recording, replay

SWING = {'robot': 'gimball', 'initial': {'pendulum_angle_deg': 60.0}, 'duration': 2.0,
         'solver': {'method': 'adaptive'}, 'output_step': 0.01}
TRUTH = read_scene(SWING, 'swing', 'swing')
GUESS = with_values(TRUTH, {'joint_friction': 0.2, 'ball_inertia': 0.06})
ENCODER = 2e-3  # noise [rad]


def recorded(scene, seed, noise=ENCODER):
    """Return a recording of the encoders of shell and joint with noise."""
    run, chance = scene.simulate(), np.random.default_rng(seed)
    return Recording({name: (run['time'], values + chance.normal(0.0, noise, len(run)))
                      for name, values in (
                          ('ball_angle', run['ball_angle']),
                          ('joint_angle', run['pendulum_angle'] - run['ball_angle']))})


@pytest.mark.slow
def test_intervals_contain_the_true_parameters_at_their_confidence_level():
    inside = []
    for seed in range(10):
        found = identify(GUESS, recorded(TRUTH, seed), ['joint_friction', 'ball_inertia'])
        assert all(item.determined for item in found.estimates)
        assert found.vague == [] and found.rivals == []
        for item in found.estimates:
            truth = present(TRUTH, item.name)
            inside.append(item.low <= truth <= item.high)
            assert item.high - item.low < 0.2 * truth
        assert found.noise['ball_angle'] == pytest.approx(ENCODER, rel=0.2)
    # Of 20 intervals at 95 %, fewer than 17 contain the truth with a probability of 1/60.
    assert sum(inside) >= 17


def test_only_an_implausible_estimate_causes_a_warning():
    # Some starts of the fit are above 0.19 kg m2, with all mass of the ball at its shell.
    guess = with_values(TRUTH, {'ball_inertia': 0.15})
    with warnings.catch_warnings():
        warnings.simplefilter('error', PlausibilityWarning)
        identify(guess, recorded(TRUTH, 1), ['ball_inertia'])
    heavy = recorded(with_values(TRUTH, {'ball_inertia': 0.25}), 1)
    with pytest.warns(PlausibilityWarning):
        identify(guess, heavy, ['ball_inertia'])


@pytest.mark.slow
def test_parameters_without_effect_on_the_data_are_not_determined():
    # There is no edge, so no sample depends on its friction.
    found = identify(GUESS, recorded(TRUTH, 1), ['joint_friction', 'edge_friction'])
    friction, edge = found.estimates
    assert friction.determined and not edge.determined
    assert math.isnan(edge.low) and math.isnan(edge.high)
    assert found.vague == [{'edge_friction': pytest.approx(1.0, abs=1e-3)}] or found.vague == [
        {'edge_friction': pytest.approx(-1.0, abs=1e-3)}]


@pytest.mark.slow
def test_parameters_that_act_only_as_a_product_are_not_determined_separately():
    # Both affect the motion only by the torque, which is proportional to their product.
    driven = read_scene({**SWING, 'initial': {}, 'actuation': {'law': 'voltage', 'voltage': 4.0}},
                        'driven', 'driven')
    names = ['motor.gear_efficiency', 'motor.torque_constant']
    found = identify(driven, recorded(driven, 3), [*names, 'joint_friction'])
    sure = {item.name: item.determined for item in found.estimates}
    assert sure == {names[0]: False, names[1]: False, 'joint_friction': True}
    combination, = found.vague
    assert set(combination) == set(names)
    # Only their product is determined.
    assert combination[names[0]] == pytest.approx(-combination[names[1]], abs=0.02)


@pytest.mark.slow
def test_an_unknown_initial_state_can_be_estimated():
    tilted = with_values(TRUTH, {'initial.pendulum_angle_deg': 66.0})
    found = identify(TRUTH, recorded(tilted, 5), ['initial.pendulum_angle_deg', 'joint_friction'])
    angle = found.estimates[0]
    assert angle.unit == 'deg' and angle.low <= 66.0 <= angle.high
    assert angle.high - angle.low < 0.5


def test_a_recorded_torque_is_replayed():
    driven = read_scene({**SWING, 'actuation': {'law': 'torque', 'torque': 0.4}}, 'a', 'a')
    run = driven.simulate()
    recording = Recording.of_columns(run.columns)
    free = replace(driven, actuation=TRUTH.actuation)
    exact = replay(driven, recording, False)
    for name, values in replay(free, recording, True).items():
        np.testing.assert_allclose(values, exact[name], atol=1e-5)
    with refused('missing', 'pendulum_torque'):
        replay(free, Recording(recording.channels), True)


@pytest.mark.slow
def test_the_command_reads_a_csv_and_writes_table_and_figure(tmp_path, capsys):
    write_trajectory(TRUTH.simulate(), tmp_path / 'run.csv')
    (tmp_path / 'run.csv').rename(tmp_path / 'run.CSV')
    scene = tmp_path / 'mine.yaml'
    scene.write_text('robot: gimball\nrobot_changes: {joint_friction: 0.2}\n'
                     'initial: {pendulum_angle_deg: 60.0}\nduration: 2.0\n')
    words = ['identify', str(scene), str(tmp_path / 'run.CSV'), '--estimate', 'joint_friction',
             'edge_friction', '--channels', 'ball_angle', 'pendulum_angle', '--out',
             str(tmp_path / 'out')]
    assert main(words) == 0
    out, _ = capsys.readouterr()
    assert 'not determined' in out and '0.124' in out
    assert main([*words, '--json', '--overwrite']) == 0
    report = json.loads(capsys.readouterr().out)
    assert report == json.loads((tmp_path / 'out' / 'identify.json').read_text())
    assert report['estimates'][0]['value'] == pytest.approx(0.124, rel=1e-3)
    assert report['estimates'][1]['low'] is None
    for kind in ('png', 'svg'):
        assert (tmp_path / 'out' / f'residuals.{kind}').stat().st_size > 5000


def test_noise_free_data_never_exclude_the_true_value():
    # The run uses the step of the shipped scenes, which differs from that of the fit.
    truth = read_scene({**SWING, 'solver': {}}, 'swing', 'swing')
    run = truth.simulate()
    recording = Recording({name: (run['time'], run[name])
                           for name in ('x', 'ball_angle', 'pendulum_angle')})
    found = identify(with_values(truth, {'joint_friction': 0.2}), recording, ['joint_friction'])
    friction, = found.estimates
    assert friction.low <= present(truth, 'joint_friction') <= friction.high
    assert friction.high - friction.low < 1e-6
    # All nine fits find the same solution, which is reported once.
    assert found.rivals == [] and not found.interrupted
    assert {item.verdict for item in found.channels.values()} == {'good'}


@pytest.mark.slow
def test_the_run_of_another_scene_is_refused_with_an_error(tmp_path, capsys):
    rolling = read_scene({'robot': 'gimball', 'initial': {'speed': 0.8}, 'duration': 2.0,
                          'output_step': 0.02}, 'rolling', 'rolling')
    write_trajectory(rolling.simulate(), tmp_path / 'run.csv')
    (tmp_path / 'swing.yaml').write_text(
        'robot: gimball\ninitial: {pendulum_angle_deg: 60.0}\nduration: 2.0\n')
    assert main(['identify', str(tmp_path / 'swing.yaml'), str(tmp_path / 'run.csv'),
                 '--estimate', 'joint_friction', '--channels', 'x', '--out',
                 str(tmp_path / 'out'), '--json']) == 1
    out, err = capsys.readouterr()
    assert 'x: poor fit, residual RMS' in err
    assert 'the model does not fit x: no parameter is estimated' in err
    report = json.loads((tmp_path / 'out' / 'identify.json').read_text())
    assert report['estimates'][0]['low'] is None and not report['estimates'][0]['determined']


@pytest.mark.slow
def test_correlated_residuals_widen_the_interval_and_are_reported():
    # The recording contains an effect that the model lacks: a slow wave of 0.02 rad.
    exact, chance = recorded(TRUTH, 2), np.random.default_rng(0)
    times, angle = exact.channels['ball_angle']
    bent = Recording({'ball_angle': (times, angle + 0.02 * np.sin(5.0 * times))})
    plain = Recording({'ball_angle': (times, angle + chance.normal(0.0, 0.02, len(times)))})
    wave, noise = (identify(GUESS, item, ['joint_friction']) for item in (bent, plain))
    assert wave.channels['ball_angle'].verdict == 'correlated'
    assert noise.channels['ball_angle'].verdict == 'good'
    (odd,), (fair,) = wave.estimates, noise.estimates
    assert odd.high - odd.low > 2.0 * (fair.high - fair.low)
    assert odd.low <= present(TRUTH, 'joint_friction') <= odd.high


def test_ctrl_c_keeps_the_best_estimates(tmp_path, capsys, monkeypatch):
    def press(done):
        if done >= 2:
            raise KeyboardInterrupt

    found = identify(GUESS, recorded(TRUTH, 0), ['joint_friction'], progress=press)
    assert found.interrupted and found.runs < 200
    assert found.estimates[0].value == pytest.approx(present(TRUTH, 'joint_friction'), rel=0.1)
    assert found.estimates[0].determined
    done = []
    monkeypatch.setattr('ballbot_ros.studies.identification.STARTS', 2)
    identify(GUESS, recorded(TRUTH, 0), ['joint_friction'], progress=done.append)
    assert done == sorted(done) and done[-1] == 5


def test_a_run_truncated_by_ctrl_c_is_not_used_as_a_residual(monkeypatch):
    from ballbot_ros.studies import recording
    whole = recording.simulate
    monkeypatch.setattr(recording, 'simulate', lambda *words: (
        lambda run: replace(run, rows=run.rows[:20]))(whole(*words)))
    with pytest.raises(KeyboardInterrupt):
        replay(TRUTH, recorded(TRUTH, 0), False)


@pytest.mark.parametrize('unit, factor', [('deg', 180.0 / np.pi), ('mrad', 1e3), ('rad', 1.0)])
def test_columns_in_other_units_are_converted(tmp_path, unit, factor):
    (tmp_path / 'run.CSV').write_text(
        f'time [ms],ball_angle [{unit}],battery [banana]\n'
        + ''.join(f'{10 * n},{0.1 * n * factor!r},{n}\n' for n in range(9)))
    columns = read_columns(tmp_path / 'run.CSV')
    np.testing.assert_allclose(columns['time'], 0.01 * np.arange(9))
    np.testing.assert_allclose(columns['ball_angle'], 0.1 * np.arange(9))
    assert read_units(tmp_path / 'run.CSV') == {
        'time': 's', 'ball_angle': 'rad', 'battery': 'banana'}


@pytest.mark.parametrize('heading, column', [
    ('time [s],ball_angle [banana]', 'ball_angle'), ('time [s],x [rad]', 'x'),
    ('time [m],x [m]', 'time')])
def test_an_invalid_unit_is_refused(tmp_path, heading, column):
    (tmp_path / 'run.csv').write_text(f'{heading}\n' + '1,2\n' * 9)
    with refused('not_a_choice', column):
        read_columns(tmp_path / 'run.csv')


def write_bag(folder, run):
    """Write joint states of a run as a bag, with an offset of the stamps."""
    bag = BagOf(folder, {}, '/robot')
    joint = {'angle': run['pendulum_angle'] - run['ball_angle'],
             'rate': run['pendulum_rate'] - run['ball_rate']}
    for row in range(len(run)):
        bag.joints('joint_states', 1_700_000_000 * 10**9 + round(1e9 * run['time'][row]),
                   ['shell', 'pendulum'], [run['ball_angle'][row], joint['angle'][row]],
                   [run['ball_rate'][row], joint['rate'][row]],
                   [0.0, run['pendulum_torque'][row]])
    bag.writer.close()


@pytest.mark.slow
def test_parameters_are_identified_from_a_bag(tmp_path):
    run = TRUTH.simulate()
    write_bag(tmp_path / 'bag', run)
    recording = Recording.of_columns(measured_columns(read_run(tmp_path / 'bag')))
    assert set(recording.channels) == {'ball_angle', 'ball_rate', 'joint_angle', 'joint_rate'}
    times, values = recording.channels['joint_angle']
    np.testing.assert_allclose(times, run['time'], atol=1e-6)
    np.testing.assert_array_equal(values, run['pendulum_angle'] - run['ball_angle'])
    found = identify(GUESS, recording, ['joint_friction', 'ball_inertia'], use_torque=True)
    assert [item.value for item in found.estimates] == pytest.approx([0.124, 0.08], rel=1e-3)


def test_a_path_without_a_bag_is_refused(tmp_path):
    (tmp_path / 'metadata.yaml').write_text('nonsense')
    for path in (tmp_path, tmp_path / 'none', tmp_path / 'metadata.yaml'):
        with refused('unreadable') as error:
            read_run(path)
        assert 'PosixPath' not in str(error.value)


def test_long_channels_are_downsampled():
    times = np.arange(3 * MOST_SAMPLES + 1) * 1e-3
    assert len(Recording({'x': (times, times)}).channels['x'][0]) <= MOST_SAMPLES


TIMES = np.linspace(0.0, 1.0, 20)


@pytest.mark.parametrize('channels, reason, field', [
    ({}, 'missing', 'channels'), ({'z': (TIMES, TIMES)}, 'unknown_name', 'z'),
    ({'x': (TIMES[:5], TIMES[:5])}, 'out_of_range', 'x'),
    ({'x': (TIMES, TIMES * math.nan)}, 'not_finite', 'x'),
    ({'x': (TIMES[::-1], TIMES)}, 'inconsistent', 'time'),
    ({'x': (TIMES - 0.5, TIMES)}, 'out_of_range', 'time')])
def test_an_invalid_recording_is_refused(channels, reason, field):
    with refused(reason, field):
        Recording(channels)


@pytest.mark.parametrize('names, reason, field', [
    ([], 'inconsistent', 'parameters'), (['joint_friction'] * 2, 'inconsistent', 'parameters'),
    (['motor.colour', 'joint_frction'], 'unknown_name', 'motor.colour')])
def test_parameters_that_cannot_be_estimated_are_refused(names, reason, field):
    with refused(reason, field) as error:
        identify(TRUTH, recorded(TRUTH, 0), names)
    assert all(name in str(error.value) for name in set(names) - {'joint_friction'})


def test_values_with_a_wrong_unit_label_are_refused_with_the_likely_unit():
    run = recorded(TRUTH, 0)
    times, values = run.channels['joint_angle']
    with refused('out_of_range', 'joint_angle') as error:
        identify(TRUTH, Recording({'joint_angle': (times, np.degrees(values))}),
                 ['joint_friction'])
    assert '"joint_angle [deg]"' in str(error.value)


def test_times_in_milliseconds_labelled_as_seconds_are_refused_with_the_likely_unit():
    channels = {name: (1e3 * times, values)
                for name, (times, values) in recorded(TRUTH, 0).channels.items()}
    with refused('out_of_range', 'time') as error:
        identify(TRUTH, Recording(channels), ['joint_friction'])
    assert '"time [ms]"' in str(error.value)
