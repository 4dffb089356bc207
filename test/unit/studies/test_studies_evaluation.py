# SPDX-License-Identifier: Apache-2.0
"""Approaches are drawn by their numbers, run, judged on the truth, and kept."""
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
import json

import pytest

from ballbot_ros.decision import Decision, Kind, Reason
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant import SensorFaults
from ballbot_ros.studies.evaluation.approaches import draw_approach
from ballbot_ros.studies.evaluation.campaign import Campaign, FILE, read_rows, run_campaign
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop
from ballbot_ros.studies.evaluation.grounds import Ground, KINDS
from ballbot_ros.studies.evaluation.judge import Judge
from ballbot_ros.studies.evaluation.loop import Believer
from ballbot_ros.studies.evaluation.replay import replay
from ballbot_ros.studies.evaluation.sensors import Flaws, Looks

BELIEVER = Believer()
SMALL = Campaign((('cubic', 'drawn', 6),), sensor='step', kind='step')


def timeless(row):
    """Return a row as text, without what depends on the machine."""
    return json.dumps({name: value for name, value in row.items() if not name.endswith('_ms')})


def an_approach(*vertices, goal=float('inf'), speed=0.4):
    """Return an approach on a ground, with a perfect sensor."""
    ground = Ground('', '', Terrain(vertices), 1.0, goal, 0.0, 'any')
    return replace(draw_approach(BELIEVER.robot, BELIEVER.tuning, 0, 0), robot=BELIEVER.robot,
                   ground=ground, flaws=Flaws(), speed=speed, room_behind=0.0)


def judged(approach, kind, angle=0.0, distance=1.0, limit=8.0):
    """Return the verdict of a ball that rolls on while a decision stands."""
    loop = ClosedLoop(approach.robot, approach.ground.terrain, BELIEVER.robot, BELIEVER.gains,
                      approach.speed, 0.0)
    judge = Judge(approach, loop, BELIEVER.tuning)
    while loop.time < limit:
        before, x = loop.time, loop.state.x
        loop.advance(angle, 10)
        if judge.look(before, Decision(kind, Reason.COMMITTED, 0.4, '', distance=distance - x)):
            break
    else:
        judge.finish(loop.state)
    return judge.verdict


@pytest.mark.parametrize('kind', KINDS)
def test_each_kind_of_ground_can_be_rolled_on_and_seen(kind):
    for number in range(5):
        approach = draw_approach(BELIEVER.robot, BELIEVER.tuning, 1, number, kind)
        ground = approach.ground
        loop = ClosedLoop(approach.robot, ground.terrain, BELIEVER.robot, BELIEVER.gains,
                          approach.speed, 0.0)
        loop.advance(0.1, 10)
        assert -0.1 < loop.state.x < 0.1
        assert ground.foot > approach.robot.ball_radius
        looks = Looks(ground.terrain, replace(approach.flaws, faults=SensorFaults()), 0)
        looks.look(0, 0.0, 0.0, loop.state.y)
        assert len(looks.arrived(0.0)) == 1


def test_an_approach_depends_on_its_seed_and_number_alone():
    one = draw_approach(BELIEVER.robot, BELIEVER.tuning, 3, 7)
    draw_approach(BELIEVER.robot, BELIEVER.tuning, 3, 8)
    again = draw_approach(BELIEVER.robot, BELIEVER.tuning, 3, 7)
    other = draw_approach(BELIEVER.robot, BELIEVER.tuning, 4, 7)
    assert (one.words, one.robot, one.flaws) == (again.words, again.robot, again.flaws)
    assert one.robot != other.robot


def test_messages_arrive_late_by_the_latency_and_keep_their_stamp():
    looks = Looks(Terrain.step(0.02, 1.0), Flaws(faults=SensorFaults(latency=0.1)), 0)
    looks.look(0, 5.0, 0.0, 0.226)
    assert looks.arrived(5.08) == []
    seen, = looks.arrived(5.1)
    assert (seen.stamp, seen.distance, seen.height) == (5.0, 1.0, 0.02)
    assert looks.arrived(5.2) == []


def test_a_ball_that_rolls_off_a_drop_that_nobody_took_fell():
    drop = an_approach([-9.0, 0.0], [0.5, 0.0], [0.5, -0.02], [9.0, -0.02])
    found = judged(drop, Kind.STOP)
    assert (found.outcome, found.depth) == ('fell', pytest.approx(0.02))
    assert judged(drop, Kind.CROSS, distance=0.5).outcome == 'over'
    deep = an_approach([-9.0, 0.0], [0.5, 0.0], [0.5, -0.2], [9.0, -0.2])
    assert judged(deep, Kind.CROSS, distance=0.5).outcome == 'fell'


def test_a_face_that_is_touched_is_a_hit_unless_it_is_crossed():
    step = an_approach([-9.0, 0.0], [0.6, 0.0], [0.6, 0.1], [9.0, 0.1])
    found = judged(step, Kind.STOP)
    assert found.outcome == 'hit' and 0.3 < found.hit_speed < 0.4
    # Of two edges only the one that is meant is taken.
    assert judged(step, Kind.CROSS, distance=0.3).outcome == 'hit'
    attempt, = judged(step, Kind.CROSS, distance=0.6).attempts
    assert attempt.over is False
    assert judged(replace(step, speed=0.09), Kind.STOP, limit=12.0).outcome != 'hit'


def test_a_ball_over_the_goal_is_over_and_its_attempt_succeeded():
    step = an_approach([-9.0, 0.0], [0.6, 0.0], [0.6, 0.01], [9.0, 0.01], goal=0.6, speed=0.6)
    found = judged(step, Kind.CROSS, distance=0.6)
    assert found.outcome == 'over' and [one.over for one in found.attempts] == [True]


def test_a_ball_at_rest_has_stopped_with_its_gap():
    wall = an_approach([-9.0, 0.0], [0.6, 0.0], [0.6, 0.5], [9.0, 0.5], speed=0.0)
    found = judged(wall, Kind.STOP)
    assert found.outcome == 'stopped' and found.gap == pytest.approx(0.6 - 0.226, abs=1e-3)
    assert judged(wall, Kind.CROSS).outcome == 'idle'


def test_a_ball_that_rolls_back_over_unknown_ground_ran_away():
    flat = an_approach([-9.0, 0.0], [9.0, 0.0], speed=0.0)
    assert judged(flat, Kind.BACK_OFF, angle=-0.5).outcome == 'ran away'


def test_a_campaign_goes_on_where_it_was_killed(tmp_path):
    with ThreadPoolExecutor(1) as pool:
        whole = run_campaign(SMALL, tmp_path / 'whole', pool, 1)
        path = tmp_path / 'cut' / FILE
        path.parent.mkdir()
        lines = (tmp_path / 'whole' / FILE).read_text().splitlines(keepends=True)
        path.write_text(''.join(lines[:4]) + lines[4][:20])
        seen = []
        resumed = run_campaign(SMALL, tmp_path / 'cut', pool, 1, seen.append)
    assert seen[0] == 3 and seen[-1] == 6
    assert sorted(map(timeless, resumed)) == sorted(map(timeless, whole))
    assert len(read_rows(path)) == 6


def test_results_of_another_campaign_are_not_mixed_in(tmp_path):
    with ThreadPoolExecutor(1) as pool:
        run_campaign(replace(SMALL, parts=(('cubic', 'drawn', 1),)), tmp_path, pool, 1)
        with pytest.raises(ConfigurationError, match='another seed'):
            run_campaign(replace(SMALL, seed=1), tmp_path, pool, 1)
        (tmp_path / FILE).write_text('something else')
        with pytest.raises(ConfigurationError, match='damaged'):
            run_campaign(SMALL, tmp_path, pool, 1)


def test_a_replay_says_what_was_decided_and_what_came_of_it():
    lines, row = replay(SMALL, 'cubic', 'drawn', 2)
    text = '\n'.join(lines)
    assert 'true faces' in text and row['outcome'] in text and 'approach 2 of seed 0' in text
