# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors, line and drive for a `VirtualRobot`, and the time to zero torque."""
from dataclasses import replace
import math
import random

from virtual_robot import STEP

from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.can_frames import RECORD_SIZE

FORWARD = SetPoint(Mode.HOLD, 0.45)


def time_to_zero(robot, fault, seconds=2.0, set_point=FORWARD):
    """Return the time from a fault to the last torque of the motor [s]."""
    fault(robot)
    first = len(robot.torques)
    for _ in range(round(seconds / 0.02)):
        loop(robot, 0.02, set_point)
        if robot.session.supervisor.e_stop:
            break
    robot.loop(0.2)
    assert not any(robot.torques[-round(0.1 / STEP):])
    pulling = [number for number, torque in enumerate(robot.torques[first:], 1) if torque]
    return STEP * pulling[-1] if pulling else 0.0


def loop(robot, seconds, set_point):
    """Run the bridge, and give set-points until the e-stop engages."""
    end = robot.now + seconds
    while robot.now < end - 1e-9:
        if not robot.session.supervisor.e_stop:
            robot.session.give(set_point)
        robot.loop(0.02)


def hold_up(robot, rng, longest):
    """Suspend drive and line repeatedly, for random times up to `longest` [s]."""
    sent, write, live, until = [], robot.write, robot.live, robot.now

    def live_late():
        nonlocal until
        if robot.now >= until:
            for data in sent:
                write(data)
            sent.clear()
            live()
        if robot.now > until + 0.02:
            until = robot.now + rng.uniform(0.0, longest)
    robot.write, robot.live = sent.append, live_late


def loop_late(robot, rng, longest, seconds, set_point):
    """Run the loop of the bridge with random pauses of up to `longest` [s]."""
    end = robot.now + seconds
    while robot.now < end:
        robot.pass_time(rng.uniform(0.0, longest))
        loop(robot, STEP * rng.randrange(1, 5), set_point)


# Per axis: the measurements in the device, and the function of the robot that corrupts them.
ENCODERS = (('sensed', 'encoder'), ('second', 'lean_encoder'))


def frozen(velocity, axis=0):
    """Return a fault: the encoder repeats its last position, with the true or zero velocity."""
    def plant(robot):
        measured, encoder = ENCODERS[axis]
        position = getattr(robot.device, measured).position
        setattr(robot, encoder, lambda true: true._replace(
            position=position, velocity=true.velocity if velocity else 0.0))
    return plant


def scaled_encoder(scale, velocity):
    """Return a fault: the encoder has another scale, and its velocity another one."""
    def plant(robot):
        position = robot.device.sensed.position
        robot.encoder = lambda true: true._replace(
            position=position + scale * (true.position - position),
            velocity=velocity * true.velocity)
    return plant


def reversed_encoder(velocity, axis=0):
    """Return a fault: the encoder counts backwards, with the true or reversed velocity."""
    def plant(robot):
        measured, encoder = ENCODERS[axis]
        position = getattr(robot.device, measured).position
        setattr(robot, encoder, lambda true: true._replace(
            position=2.0 * position - true.position,
            velocity=true.velocity if velocity else -true.velocity))
    return plant


def lost_status(robot):
    """Let status replies get lost, and the drive trip."""
    driver = robot.session.line.driver
    poll, known = driver.poll, driver.telemetry

    def without_status():
        poll()
        driver.telemetry = driver.telemetry._replace(
            status_time=known.status_time, armed=known.armed, faults=known.faults)
        return driver.telemetry
    driver.poll = without_status


def repeated(robot):
    """Make the IMU repeat its last reading with new stamps."""
    last = []
    robot.reading = lambda true: last.append(true) or replace(last[0], stamp=true.stamp)


def in_degrees(robot):
    """Make the IMU report its turn rate in degrees per second."""
    robot.reading = lambda true: replace(true, turn_rate=math.degrees(true.turn_rate))


def in_g(robot):
    """Make the IMU report specific forces in multiples of gravity."""
    robot.reading = lambda true: replace(
        true, forward=true.forward / 9.81, upward=true.upward / 9.81)


def upside_down(robot):
    """Rotate the IMU by half a turn about its forward axis."""
    robot.reading = lambda true: replace(
        true, turn_rate=-true.turn_rate, upward=-true.upward)


def mounted_backwards(robot):
    """Rotate the IMU by half a turn about its upward axis."""
    robot.reading = lambda true: replace(
        true, turn_rate=-true.turn_rate, forward=-true.forward)


def gyro(change):
    """Return a fault: `change` maps the true turn rate to the measured one [rad/s]."""
    def plant(robot):
        robot.reading = lambda true: replace(true, turn_rate=change(true.turn_rate))
    return plant


def exchanged_axes(robot):
    """Exchange the forward and the left axis of the IMU."""
    robot.reading = lambda true: replace(
        true, turn_rate=1e-3 * true.forward, forward=1e-3 * true.turn_rate)


def silent_imu(robot):
    """Stop the IMU readings."""
    robot.reading = lambda true: None


def unplugged(robot):
    """Pull the cable."""
    robot.plugged = False


def silent_drive(robot):
    """Discard all further replies of the drive."""
    robot.from_drive = lambda data: b''


def slow_reader(rate):
    """
    Return a fault: the drive takes only `rate` bytes per second from the line.

    The others are buffered until the line is closed.
    """
    def plant(robot):
        sent, live, credit = bytearray(), robot.live, 0.0

        def live_slowly():
            nonlocal credit
            credit += rate * STEP
            number = min(int(credit), len(sent))
            credit -= number
            taken = bytes(sent[:number])
            del sent[:number]
            write(taken)
            live()

        def close():
            sent.clear()
            close_line()
        write, robot.write, robot.live = robot.write, sent.extend, live_slowly
        close_line, robot.close = robot.close, close
    return plant


def growing_latency(robot):
    """Let replies arrive 20 ms later every 0.1 s."""
    begin, delay = robot.now, robot._delay

    def reply(data):
        robot._delay = delay + 0.2 * (robot.now - begin)
        return data
    robot.from_drive = reply


def jumping_encoder(robot):
    """Let the encoder jump by a radian of the shaft every 0.2 s."""
    begin = robot.now
    robot.encoder = lambda true: true._replace(
        position=true.position + 50.0 * math.floor((robot.now - begin) / 0.2))


def wrapping_encoder(robot):
    """Let the encoder count from 0 again after each turn of the shaft."""
    robot.encoder = lambda true: true._replace(position=math.remainder(true.position, math.tau))


def transmitted(share):
    """Return a fault: motor and gear transmit a share of the torque, negative for reversed."""
    def plant(robot):
        robot.transmitted = lambda torque, state: share * torque
    return plant


def sagging_supply(share):
    """Return a fault: the supply of the motor has a share of its voltage."""
    def plant(robot):
        per_volt, back_voltage, supply, _ = robot.session.robot.motor_line
        robot.transmitted = lambda torque, state: min(max(
            torque, per_volt * (-share * supply - back_voltage * state.joint_rate)),
            per_volt * (share * supply - back_voltage * state.joint_rate))
    return plant


def blocked_joint(robot):
    """Hold the joint at its angle by a stiff spring."""
    angle = robot.plant.state.joint_angle
    robot.transmitted = lambda torque, state: \
        torque - 60.0 * (state.joint_angle - angle) - 3.0 * state.joint_rate


def kept_torque(robot):
    """Let the drive keep its torque and ignore all commands."""
    torque = robot.device.torque()
    robot.transmitted = lambda *_: torque * robot.joint.gear_ratio * robot.joint.direction


def broken_belt(robot):
    """Break the belt between the encoder and the pendulum: the motor turns its rotor only."""
    rate, position = robot.plant.state.joint_rate, robot.device.sensed.position
    scale = robot.joint.gear_ratio * robot.joint.direction

    def turn_rotor(torque, state):
        nonlocal rate, position
        rate += STEP * (torque - 0.01 * rate) / (0.4 * robot.session.robot.joint_inertia)
        position += STEP * scale * rate
        return 0.0
    robot.transmitted = turn_rotor
    robot.encoder = lambda true: true._replace(position=position, velocity=scale * rate)


def noisy_line(change, seed=1):
    """Return a fault: `change` maps each byte, in both directions, to the received bytes."""
    def plant(robot):
        rng = random.Random(seed)
        robot.to_drive = robot.from_drive = lambda data: b''.join(
            change(byte, rng) if rng.random() < 0.01 else bytes([byte]) for byte in data)
    return plant


def second_node(robot):
    """Add an idle drive with the same id to the bus, which answers before the first one."""
    device, other = robot.device, type(robot.device)(robot.device.settings)
    receive, tick = device.receive, device.tick
    device.receive = lambda data, now: other.receive(data, now) + receive(data, now)

    def tick_both(now):
        other.tick(now)
        tick(now)
    device.tick = tick_both


def bunched_replies(period):
    """Return a fault: replies arrive together at multiples of a period [s]."""
    def plant(robot):
        def reply(data, always=False):
            arrival = period * math.ceil((robot.now + robot._delay) / period)
            robot.waiting.append((arrival, robot.device.receive(data, robot.now)))
        robot._reply = reply
    return plant


def lossy_bus(share, seed=1):
    """Return a fault: a share of the frames of a CAN bus is lost, in both directions."""
    def plant(robot):
        rng = random.Random(seed)
        robot.to_drive = robot.from_drive = lambda data: b''.join(
            data[start:start + RECORD_SIZE] for start in range(0, len(data), RECORD_SIZE)
            if rng.random() >= share)
    return plant


def slow_bytes(robot):
    """Let the bytes of each reply arrive one by one, 1 ms apart."""
    def reply(data, always=False):
        for byte in robot.device.receive(data, robot.now):
            last = max([robot.now + robot._delay, *(when for when, _ in robot.waiting)])
            robot.waiting.append((last + 0.001, bytes([byte])))
    robot._reply = reply


def tripped_drive(robot):
    """Let the current sensor of the drive read too much."""
    robot.device.over_current()


def rebooted_drive(robot):
    """Let the drive lose its supply for the boot time."""
    robot.device.reboot(robot.now)


def requested_stop(robot):
    """Engage the e-stop."""
    robot.session.engage('requested')


# Name and fault; the bound of each is in docs/hardware_bridge.md.  Only the effect of the second
# ones depends on the protocol of the drive.
COMMON_FAULTS = {
    'e-stop requested': requested_stop,
    'encoder frozen, its velocity too': frozen(False), 'encoder frozen': frozen(True),
    'encoder reversed': reversed_encoder(False),
    'encoder with half the scale': scaled_encoder(0.5, 0.5),
    'encoder with twice the scale': scaled_encoder(2.0, 2.0),
    'encoder wraps each turn': wrapping_encoder, 'encoder jumps every 0.2 s': jumping_encoder,
    'motor without torque': transmitted(0.0), 'motor reversed': transmitted(-1.0),
    'joint blocked': blocked_joint,
    'IMU silent': silent_imu, 'IMU frozen': repeated, 'IMU in degrees per second': in_degrees,
    'IMU in g': in_g, 'IMU upside down': upside_down, 'IMU backwards': mounted_backwards,
    'IMU axes exchanged': exchanged_axes, 'gyro reversed': gyro(lambda rate: -rate),
    'gyro saturated': gyro(lambda rate: max(-0.3, min(rate, 0.3))),
    'gyro with half the scale': gyro(lambda rate: 0.5 * rate)}
DRIVE_FAULTS = {
    'cable unplugged': unplugged, 'no reply arrives': silent_drive,
    'bytes of replies 1 ms apart': slow_bytes,
    'replies 20 ms later every 0.1 s': growing_latency,
    'replies together every 80 ms': bunched_replies(0.08), 'status not confirmed': lost_status,
    'drive trips': tripped_drive, 'drive reboots': rebooted_drive}
FAULTS = {**COMMON_FAULTS, **DRIVE_FAULTS}
