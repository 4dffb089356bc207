# SPDX-License-Identifier: Apache-2.0
"""Compilation of the kernels before the first decision, and the log of outcomes."""
from dataclasses import replace
from pathlib import Path
import time
from typing import Dict, Optional

from ballbot_ros.decision import Knowledge
from ballbot_ros.decision.decider import warm_up
from ballbot_ros.decision.learning.learner import learned
from ballbot_ros.decision.learning.outcome_log import OutcomeLog
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.ros.rclpy_compat import RcutilsLogger

# Number of the latest outcomes from which the node learns at the start.
NEWEST = 100


class Experience:
    """A log of outcomes (none for an empty path), and the knowledge updated from it."""

    def __init__(self, path: str, knowledge: Knowledge, planner: str, logger: RcutilsLogger):
        """Compile the kernels of the decision, and update the particles from the log."""
        self.knowledge = knowledge
        start = time.monotonic()
        warm_up(knowledge, planner)
        logger.info(f'ready to decide after {time.monotonic() - start:.1f} s')
        self._log: Optional[OutcomeLog] = None
        if not path:
            return
        start = time.monotonic()
        self._log = OutcomeLog(Path(path).expanduser(), knowledge.robot.digest)
        if self._log.problem:
            logger.warning(f'outcome_log: {self._log.problem}')
        if self._log.reading.refusal:
            return
        outcomes = self._log.reading.outcomes[-NEWEST:]
        self.knowledge = replace(
            knowledge, particles=learned(knowledge.initial_particles, outcomes))
        logger.info(f'learned from {len(outcomes)} outcomes of {path} in '
                    f'{time.monotonic() - start:.1f} s')

    @property
    def problem(self) -> Dict[str, str]:
        """Return why requested outcomes are not logged, for /diagnostics; empty if they are."""
        problem = self._log.problem if self._log is not None else ''
        return {'outcome_log': problem} if problem else {}

    def keep(self, outcome: Optional[Outcome]) -> None:
        """Log the outcome of an attempt, if there is one."""
        if outcome is not None and self._log is not None:
            self._log.append(outcome)

    def close(self) -> None:
        """Write the pending outcomes."""
        if self._log is not None:
            self._log.close()
