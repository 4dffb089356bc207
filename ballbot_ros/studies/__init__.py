# SPDX-License-Identifier: Apache-2.0
"""
Offline studies of simulated and recorded runs.  No node imports this.

A study is one module here and a verb of the command line.  To add one, copy `comparison.py`, which
computes and returns values, and `cli/compare_models.py`, which reads options and prints; the line
that registers it stands in `cli.command.VERBS`.

    >>> from ballbot_ros.studies import comparators
    >>> from ballbot_ros.physics import load_robot
    >>> round(1e3 * comparators.free_pendulum_impulse(load_robot('gimball'), 0.6), 1)
    18.4
"""
