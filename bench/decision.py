# SPDX-License-Identifier: Apache-2.0
"""Time the rollout planner: one attempt, the first decision about a step, later ones."""
from dataclasses import replace
import math
from time import process_time

import numpy as np

from ballbot_ros.decision import (
    Face, Knowledge, load_curve, load_decision_tuning, Motion, PLANNERS, Profile, Situation)
from ballbot_ros.decision.planning.ahead import Candidate, look_ahead
from ballbot_ros.decision.planning.rollout.search import plan_row
from ballbot_ros.decision.planning.rollout.worlds import Worlds
from ballbot_ros.decision.values import Strategy
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
# Room for a stop behind the edge is assumed: a step sensor does not measure it.
TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.0)
KNOWLEDGE = Knowledge(GIMBALL, load_curve('gimball_down'), TUNING)
PERIOD, ACCELERATION, SEEN = 0.02, 0.5, 1.6
HEIGHTS = (0.012, 0.020, 0.028, 0.036, 0.044, 0.052, 0.060)


def attempts(height, speed, swing, count=400):
    """Return repeated measurements of the time of an attempt [us]."""
    worlds = Worlds(KNOWLEDGE)
    face = Face(1, 0.0, height, 0.01, 0.001)
    ahead = look_ahead(Situation(Motion(0.0, -1.4, 0.0, slope_sd=0.003), Profile(0.0, (face,))),
                       (face,), GIMBALL.ball_radius, TUNING)
    worlds.see(ahead)
    row = plan_row(Candidate(Strategy.SWING, speed, swing, 1.5), ahead)
    draws = worlds.sample(count)
    spent = []
    for _ in range(6):
        begin = process_time()
        worlds.attempt((-1.4, 0.0, 0.0, 0.0), [row], draws, ahead)
        spent.append(1e6 * (process_time() - begin) / count)
    return spent[1:]


def approach(height, seed):
    """Return the times of all decisions of an approach until touch or stop [ms]."""
    random, decide = np.random.default_rng(seed), PLANNERS['rollout'](KNOWLEDGE)
    position, speed, decision, spent = -SEEN, 0.3, None, []
    noise = float(random.normal(0.0, 0.002))
    for number in range(300):
        # The estimate converges with the number of observations.
        settled = 1.0 / math.sqrt(1.0 + number)
        face = Face(1, 0.0, height + noise * settled, 0.01, max(0.0005, 0.002 * settled))
        begin = process_time()
        decision = decide(Situation(
            Motion(PERIOD * number, position, speed), Profile(PERIOD * number, (face,))), decision)
        spent.append(1e3 * (process_time() - begin))
        stop = decision.plan.stop_position if decision.plan else math.inf
        wanted = min(decision.set_speed, math.sqrt(max(0.0, 2.0 * 0.4 * (stop - position))))
        speed += min(max(wanted - speed, -ACCELERATION * PERIOD), ACCELERATION * PERIOD)
        position += PERIOD * speed
        if position > -0.1:
            break
    return spent


def measure():
    yield 'an attempt, over a 30 mm step from 1.2 m', 'us', attempts(0.03, 0.6, 0.2), 200.0
    yield 'an attempt, not over a 60 mm step', 'us', attempts(0.06, 0.6, 0.2), 200.0
    runs = [approach(height, seed) for seed, height in enumerate(HEIGHTS, 1)]
    later = [time for run in runs for time in run[1:]]
    yield 'the first answer about a step', 'ms', [run[0] for run in runs], 50.0
    yield 'later answers, at p99', 'ms', [float(np.quantile(later, 0.99))], 5.0
    yield 'answers, mean', 'ms', [float(np.mean(run)) for run in runs], 10.0
    yield 'an approach, all answers', 'ms', [sum(run) for run in runs], 150.0
