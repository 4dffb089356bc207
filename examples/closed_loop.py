# SPDX-License-Identifier: Apache-2.0
"""
Close the loop in one process: robot, camera, decision and controller, without ROS.

The nodes exchange the same data over topics.

    python examples/closed_loop.py
"""
from ballbot_ros.control import JointReadings, load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.decision import (
    check_decision, Decider, Knowledge, load_curve, load_decision_tuning, Motion,
    TerrainObservation)
from ballbot_ros.physics import load_scene
from ballbot_ros.plant import Plant, TerrainSensor

RATE, OBSERVATION_PERIODS = 500, 10  # control periods per second, and between observations


def main() -> None:
    """Drive towards a step and print each change of the decision."""
    scene = load_scene('doorstep')
    robot, tuning = scene.model.robot, load_decision_tuning('decision_default')
    curve = load_curve('gimball_down')
    check_decision(robot, curve, tuning)
    plant = Plant(scene, RATE)
    controller = PendulumController(robot, load_tuning('published'))
    camera = TerrainSensor(scene.model.terrain, reach=3.0, height_sd=0.001)
    decider, reason = Decider(Knowledge(robot, curve, tuning), planner='rollout'), None

    for period in range(12 * RATE):
        state = plant.state
        if period % OBSERVATION_PERIODS == 0:
            sight = camera.measure(state.x, state.y, period // OBSERVATION_PERIODS)
            if sight is not None:
                decider.observe(TerrainObservation(
                    plant.time, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max))
            decider.move(Motion(plant.time, state.x, state.velocity_x))
            _, decision, angle = decider.decide()
            controller.give(SetPoint(Mode.HOLD, angle, plant.time))
            if decision.reason is not reason:
                reason = decision.reason
                print(f'{plant.time:5.2f} s  {decision.kind.name:8}  {decision.explanation}')
        readings = JointReadings(plant.time, state.ball_angle, state.joint_angle,
                                 state.ball_rate, state.joint_rate)
        plant.advance(controller.torque(readings))
    print(f'{plant.time:5.2f} s  at x = {plant.state.x:.2f} m, '
          f'{plant.state.velocity_x:.2f} m/s')


if __name__ == '__main__':
    main()
