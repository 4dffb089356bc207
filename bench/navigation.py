# SPDX-License-Identifier: Apache-2.0
"""Route planning on random floors of 20 m x 20 m at 5 cm: set-up and queries."""
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.errors import RefusedError
from ballbot_ros.floors import load_floor
from ballbot_ros.navigation import RoutePlanner
from ballbot_ros.navigation.learned import Learned
from ballbot_ros.physics import load_robot

KNOWLEDGE = Knowledge(load_robot('gimball'), load_curve('gimball_down'),
                      load_decision_tuning('decision_default'))
SIDE, ROOM, DOOR, QUERIES = 20.0, 4.0, 1.0, 40


def house(random):
    """Return the text of a floor of rooms with doors, some of which have steps."""
    lines, features = [], []
    for at in np.arange(ROOM, SIDE, ROOM):
        for begin in np.arange(0.0, SIDE, ROOM):
            door = begin + random.uniform(0.5, ROOM - DOOR - 0.5)
            for swap in (False, True):
                def place(along, at=at, swap=swap):
                    return [float(at), float(along)] if swap else [float(along), float(at)]
                lines += [[place(begin), place(door)], [place(door + DOOR), place(begin + ROOM)]]
                if random.random() < 0.3:
                    features.append(f'  - {{kind: step, line: {[place(door), place(door + DOOR)]},'
                                    f' height: {random.choice([0.01, 0.02, 0.03, 0.04])}}}\n')
    return (f'walls: {{size: [{SIDE}, {SIDE}], lines: {lines}}}\nfeatures:\n' + ''.join(features))


def measure():
    setups, queries, replans = [], [], []
    for seed in range(3):
        random = np.random.default_rng(seed)
        with TemporaryDirectory() as folder:
            path = Path(folder) / 'house.yaml'
            path.write_text(house(random))
            floor = load_floor(path)
        begin = process_time()
        planner = RoutePlanner(floor, KNOWLEDGE)
        setups.append(process_time() - begin)
        planner.warm_up()  # as the node does before it accepts goals
        for _ in range(QUERIES):
            start, goal = random.uniform(0.5, SIDE - 0.5, (2, 2))
            begin = process_time()
            try:
                planner.route(start, goal)
                queries.append(1e3 * (process_time() - begin))
                begin = process_time()
                planner.learn(Learned(obstacles=tuple(random.uniform(0.5, SIDE - 0.5, (2, 2)))))
                planner.route(start, goal)
                replans.append(1e3 * (process_time() - begin))
            except RefusedError:
                pass
            planner.learn(Learned())
    yield 'route planner, 20 m x 20 m at 5 cm: set-up', 's', setups, 10.0
    yield 'a route', 'ms', queries, 100.0
    yield 'a route, at p99', 'ms', [float(np.quantile(queries, 0.99))], 100.0
    yield 'another route after an obstacle', 'ms', replans, 20.0
    yield 'another route, at p99', 'ms', [float(np.quantile(replans, 0.99))], 20.0
