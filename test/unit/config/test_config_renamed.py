# SPDX-License-Identifier: Apache-2.0
"""An old name is refused with the new one, and the new one is there."""
from importlib import import_module
from importlib.util import find_spec

import pytest

from ballbot_ros import physics, renamed
from ballbot_ros.cli import main
from ballbot_ros.cli.command import VERBS
from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import BallbotError, RenamedError

FACADES = [f'ballbot_ros.{name}' for name in (
    'control', 'decision', 'drives', 'estimation', 'physics', 'plant')]


def there(name):
    """Return whether a dotted name can be imported, as a module or out of one."""
    module, _, last = name.rpartition('.')
    try:
        return hasattr(import_module(module), last) or find_spec(name) is not None
    except ModuleNotFoundError:
        return False


@pytest.mark.parametrize('old, new', renamed.PYTHON.items())
def test_an_old_python_name_is_refused_with_a_new_one_that_is_there(old, new):
    module, _, name = old.rpartition('.')
    assert there(new.split(',')[0])
    with pytest.raises(RenamedError, match=new):
        exec(f'from {module} import {name}', {})


@pytest.mark.parametrize('statement, new', [
    ('from ballbot_ros.physics import load_robot, max_step', 'crossing.max_step_height'),
    ('import ballbot_ros.laboratory', 'ballbot_ros.studies'),
    ('from ballbot_ros.hardware.drivers import open_driver', 'ballbot_ros.drives'),
])
def test_what_users_had_written_is_refused_as_both_kinds_of_error(statement, new):
    with pytest.raises(ImportError, match=new):
        exec(statement, {})
    with pytest.raises(BallbotError, match=new):
        exec(statement, {})


@pytest.mark.parametrize('old', [
    old for old in renamed.PYTHON if old.rpartition('.')[0] in FACADES])
def test_an_old_attribute_of_a_facade_is_refused_with_the_new_one(old):
    package, _, name = old.rpartition('.')
    with pytest.raises(RenamedError, match=renamed.PYTHON[old]):
        getattr(import_module(package), name)


@pytest.mark.parametrize('package', FACADES)
def test_a_name_that_never_was_is_missing_as_anywhere_else(package):
    assert not hasattr(import_module(package), 'never_was')
    with pytest.raises(ModuleNotFoundError):
        import_module(f'{package}.never_was')


@pytest.mark.parametrize('old, new', renamed.VERBS.items())
def test_an_old_verb_is_refused_with_the_new_one(capsys, old, new):
    assert new in VERBS and old not in VERBS
    assert main([old]) == 2
    assert f'now {new!r}' in capsys.readouterr().err


def test_an_old_option_is_refused_with_the_new_one(capsys, monkeypatch):
    monkeypatch.setitem(renamed.OPTIONS, '--once', '--today')
    assert main(['scenes', '--once=3']) == 2
    assert "--once: it is now '--today'" in capsys.readouterr().err


def test_an_old_word_is_suggested_only_where_the_new_one_belongs(monkeypatch):
    monkeypatch.setitem(renamed.KEYS, 'dent', 'penetration')
    assert suggestion('dent', ['penetration', 'density']) == "; it is now 'penetration'"
    assert 'penetration' not in suggestion('dent', ['density'])


def test_a_choice_that_is_gone_says_why(capsys):
    assert main(['simulate', 'flat', '--models', 'reduced']) == 2
    assert renamed.GONE['reduced'] in capsys.readouterr().err
    assert renamed.GONE['reduced'] in suggestion('reduced', ['auto', 'full'], listing=False)


@pytest.mark.parametrize('value, old, new', [
    (physics.Actuation(), 'drive', 'actuator'),
    (physics.load_scene('flat').model, 'numbers', 'parameters'),
    (physics.Trajectory(physics.load_scene('flat').model, []).effort, 'refused', 'rejected'),
])
def test_an_old_attribute_names_the_new_one(value, old, new):
    with pytest.raises(AttributeError, match=f"'{old}'; it is now '{new}'"):
        getattr(value, old)
    assert hasattr(value, new) and not hasattr(value, 'never_there')
