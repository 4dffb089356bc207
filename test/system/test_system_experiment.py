# SPDX-License-Identifier: Apache-2.0
"""An experiment with real nodes: one folder, from which the results are reproduced."""
import json
import subprocess
import sys

PLAN = """
scene: ramp_release
duration: 0.1
seeds: [7]
simulator: {observation_height_sd: 0.001}
"""


def run(*words):
    """Run the command, and return its output."""
    done = subprocess.run([sys.executable, '-m', 'ballbot_ros.cli', 'run', *map(str, words)],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


def test_an_experiment_is_reproduced_from_its_folder(tmp_path):
    (tmp_path / 'plan.yaml').write_text(PLAN)
    run(tmp_path / 'plan.yaml', '--out', tmp_path / 'out')
    numbers = json.loads((tmp_path / 'out' / 'seed_7' / 'numbers.json').read_text())
    # Up to the last state and its command.
    assert numbers['messages'] == {
        '/ball_state': 11, '/joint_commands': 51, '/joint_states': 51, '/odom': 11,
        '/terrain_observation': 6}
    assert 'same numbers: yes' in run(tmp_path / 'out')
