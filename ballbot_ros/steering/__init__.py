# SPDX-License-Identifier: Apache-2.0
"""
Turning by leaning the pendulum sideways: model, limits and law; docs/steering.md derives them.

The planar physics computes the forward motion; a `LateralState` adds the lateral motion.  In each
control period `law` computes the set-point of the lean for a commanded yaw rate, and `step` (the
simulated robot) follows it:

    >>> from ballbot_ros.physics import load_robot
    >>> robot, state = load_robot('gimball'), LateralState()
    >>> for _ in range(2500):
    ...     command = law(robot, state, speed=0.4, yaw_rate=0.2)
    ...     state = step(robot, state, 0.4, command, dt=0.002)
    >>> round(state.yaw_rate, 3)
    0.2

The commanded yaw rate is limited to `yaw_rate_limit`, and curvature to `curvature_limit`, which
does not depend on the yaw rate and is 0 for a robot that drives straight:

    >>> yaw_rate_limit(robot, 0.4) > 0.2
    True
    >>> curvature_limit(load_robot('shellball'), 0.4)
    0.0

While the ball accelerates, `step` also needs the derivative of the speed.  The ball moves at
`speed` along the heading and at `lateral_speed` to the left of it.

At an angle, `height_factor` reduces the maximum step height:

    >>> height_factor(0.0), 0.4 < height_factor(0.7) < 0.7, height_factor(1.0)
    (1.0, True, 0.0)
"""
from ballbot_ros.steering.law import curvature_limit, law, steady_turn, Turn, yaw_rate_limit
from ballbot_ros.steering.model import (
    follow, GroundTrack, lateral_acceleration, lateral_speed, LateralState, pull,
    required_steering, servo_torque, step)
from ballbot_ros.steering.oblique import height_factor, load_oblique_steps, ObliqueSteps

__all__ = [
    'curvature_limit', 'follow', 'GroundTrack', 'height_factor', 'lateral_acceleration',
    'lateral_speed', 'LateralState', 'law', 'load_oblique_steps', 'ObliqueSteps', 'pull',
    'required_steering', 'servo_torque', 'steady_turn', 'step', 'Turn', 'yaw_rate_limit']
