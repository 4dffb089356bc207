# SPDX-License-Identifier: Apache-2.0
"""
Experiments with the model: what others predict, what a test bench would measure.

    >>> from ballbot_ros.studies import comparators
    >>> from ballbot_ros.physics import load_robot
    >>> round(1e3 * comparators.free_pendulum_impulse(load_robot('gimball'), 0.6), 1)
    18.4
"""
