# SPDX-License-Identifier: Apache-2.0
"""The command as tests call it."""
import pytest

from ballbot_ros.cli import main


@pytest.fixture
def error_of(capsys):
    """Return a function that returns the one line of a call that is refused."""
    def call(*words):
        assert main(words) == 2
        out, err = capsys.readouterr()
        assert out == '' and err.startswith('ballbot: error: ') and err.count('\n') == 1
        return err
    return call
