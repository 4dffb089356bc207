# SPDX-License-Identifier: Apache-2.0
"""The page starts before the demo, ends with it, and reports why it cannot start."""
import os
import sys

import pytest
from refusals import refused

from ballbot_ros.demo import page
from ballbot_ros.demo.page import page_beside


@pytest.fixture
def server(tmp_path, monkeypatch):
    """Replace the page by a script; return the file in which the script records its state."""
    script, note = tmp_path / 'page', tmp_path / 'note'
    script.write_text(
        f'#!{sys.executable}\nimport os, signal, sys, time\n'
        f'note = open({str(note)!r}, "w", buffering=1)\n'
        'def end(*_):\n    note.write("ended")\n    sys.exit()\n'
        'signal.signal(signal.SIGINT, end)\n'
        'note.write(f"{sys.argv[3:]} in {os.environ[\'ROS_DOMAIN_ID\']}\\n")\n'
        'print("http://127.0.0.1:8080", flush=True)\ntime.sleep(60)\n')
    script.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(script))
    monkeypatch.setenv('ROS_DOMAIN_ID', '17')
    return note


def test_the_page_runs_during_the_demo_and_ends_with_it(server, capsys):
    with page_beside():
        assert 'http://127.0.0.1:8080' in capsys.readouterr().out
        assert server.read_text() == "['view', '--live'] in 17\n"
    assert server.read_text().endswith('ended')


def test_the_page_ends_when_the_demo_fails(server):
    with pytest.raises(KeyboardInterrupt), page_beside(quiet=True):
        raise KeyboardInterrupt
    assert server.read_text().endswith('ended')


def test_without_a_domain_page_and_demo_share_a_new_one(server, monkeypatch):
    monkeypatch.delenv('ROS_DOMAIN_ID')
    with page_beside(quiet=True):
        assert f'in {os.environ["ROS_DOMAIN_ID"]}\n' in server.read_text()


def test_a_page_that_does_not_start_is_reported(server, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'executable', '/bin/false')
    with refused('unavailable', '--view'), page_beside():
        pass


def test_without_viser_the_page_is_refused_with_the_remedy(monkeypatch):
    monkeypatch.setattr(page, 'find_spec', lambda _: None)
    with refused('not_installed', 'viser'), page_beside():
        pass
