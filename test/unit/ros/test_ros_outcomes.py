# SPDX-License-Identifier: Apache-2.0
"""The experience of a node: learned from its log, and empty without a valid log."""
from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.decision.learning.outcome_log import OutcomeLog
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.nodes.obstacle_decision.outcomes import Experience
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
KNOWLEDGE = Knowledge(
    GIMBALL, load_curve('gimball_down'), load_decision_tuning('decision_default'))


class Logger:
    """A logger that stores its messages."""

    def __init__(self):
        self.said = []

    def info(self, text):
        self.said.append(text)

    warning = info


def bias(particles):
    """Return the mean bias of the reported height [m]."""
    return float(particles.weights @ particles.column('height_bias'))


def stuck(stamp):
    """Return the outcome of a step that the robot unexpectedly failed to cross."""
    return Outcome(stamp=stamp, result='stuck', face=1, position=1.0, height=0.02,
                   height_sd=0.0005, touch_speed=0.8, touch_angle=0.0, held_angle=0.0, slope=0.0,
                   distance=1.0, robot=GIMBALL.digest)


def test_without_a_log_nothing_changes():
    logger = Logger()
    experience = Experience('', KNOWLEDGE, 'cubic', logger)
    experience.keep(stuck(1.0))
    experience.close()
    assert experience.knowledge is KNOWLEDGE and logger.said[1:] == [] and experience.problem == {}


def test_recorded_outcomes_are_learned_from_at_the_next_start(tmp_path):
    path = tmp_path / 'outcomes.jsonl'
    log = OutcomeLog(path, GIMBALL.digest)
    for stamp in (1.0, 20.0, 40.0):
        log.append(stuck(stamp))
    log.close()
    experience = Experience(str(path), KNOWLEDGE, 'cubic', Logger())
    before = Particles.of(GIMBALL, KNOWLEDGE.tuning.height_bias_sd)
    after = experience.knowledge.particles
    assert after.outcomes == 3
    # The steps are then estimated to be higher than measured.
    assert bias(after) < bias(before) - 0.001
    experience.close()


def test_a_file_that_is_not_a_log_is_reported_and_unchanged(tmp_path):
    path, logger = tmp_path / 'outcomes.jsonl', Logger()
    path.write_text('not an outcome\nnor this\n')
    experience = Experience(str(path), KNOWLEDGE, 'cubic', logger)
    experience.keep(stuck(1.0))
    experience.close()
    assert experience.knowledge is KNOWLEDGE
    assert 'outcome_log' in logger.said[1] and 'outcome_log' in experience.problem
    assert path.read_text() == 'not an outcome\nnor this\n'


def test_a_log_that_cannot_be_written_is_reported_at_the_start(tmp_path):
    path, logger = tmp_path / 'none' / 'outcomes', Logger()
    experience = Experience(str(path), KNOWLEDGE, 'cubic', logger)
    experience.close()
    assert 'does not exist' in logger.said[1] and str(path) in experience.problem['outcome_log']
