# SPDX-License-Identifier: Apache-2.0
"""The command, refused; nothing here needs ROS."""
import pytest


@pytest.fixture
def refusal(capsys, monkeypatch):
    """Return a function that calls a verb and returns the error with which it refuses."""
    from ballbot_ros.cli import command, main
    caught = []
    monkeypatch.setattr(command, 'print_refusal', caught.append)

    def call(*words):
        assert main([str(word) for word in words]) == 2
        assert capsys.readouterr().out == ''
        return caught.pop()
    return call


@pytest.fixture
def refuses(refusal):
    """Return a function that checks with which reason and field a call is refused."""
    def call(reason, field, *words):
        error = refusal(*words)
        assert (error.reason, error.field) == (reason, field), error
    return call
