# SPDX-License-Identifier: Apache-2.0
"""Records that are logged before a node can log are forwarded once it can."""
import logging

from ballbot_ros.ros.logs import DeferredLogs


def test_log_records_from_the_creation_of_a_node_are_not_lost():
    above, name = logging.getLogger('deferred'), 'deferred.below'
    taken = []

    class Taking(logging.Handler):
        """A handler that stores all records."""

        def emit(self, record):
            taken.append(record.getMessage())
    deferred = DeferredLogs(name)  # `above` accepts only warnings yet, as the root does
    logging.getLogger(f'{name}.module').info('compiled in 2.5 s')
    above.handlers = [Taking()]
    above.setLevel(logging.INFO)
    assert not taken
    deferred.forward()
    assert taken == ['compiled in 2.5 s']
