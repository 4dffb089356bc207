# SPDX-License-Identifier: Apache-2.0
"""
Offline studies of simulated and recorded runs.  No node imports this.

A study is one module here, which computes and returns values, and a verb of the command line,
which reads options and prints; docs/architecture.md names one to copy.

    >>> from ballbot_ros.studies import comparators
    >>> from ballbot_ros.physics import load_robot
    >>> round(1e3 * comparators.free_pendulum_impulse(load_robot('gimball'), 0.6), 1)
    18.4
"""
