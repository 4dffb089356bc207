# SPDX-License-Identifier: Apache-2.0
"""Mutation testing, on a toy: what is drawn, what is told, and that no file is changed."""
import importlib
import json
from pathlib import Path
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
SOURCE = '''"""A toy."""
__all__ = ['LIMIT' + '']
LIMIT: int | None = 10


def double(value: int) -> int:
    """Twice 1 + 1."""
    if value is None:
        raise ValueError(f'not {1 + 1}')
    return value + value


def untested(value):
    return value - 3
'''
TEST = """from toy.inner.sums import double


def test_double():
    assert double(2) == 4 and double(3) == 6
"""
TABLE = json.dumps({'toy': ['toy/inner', ['tests']]})


@pytest.fixture
def modules(monkeypatch):
    """Return a way to import the modules of mutants/, which are no package."""
    monkeypatch.syspath_prepend(ROOT / 'mutants')
    before = set(sys.modules)
    yield importlib.import_module
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], '__file__', None) or '/').parent == ROOT / 'mutants':
            del sys.modules[name]


@pytest.fixture
def toy(tmp_path):
    """Return a checkout with one package and one test."""
    root = tmp_path / 'checkout'
    for name, text in (('toy/__init__.py', ''), ('toy/inner/__init__.py', ''),
                       ('toy/inner/sums.py', SOURCE), ('tests/test_sums.py', TEST)):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def run(toy, *options):
    """Run the mutants of the toy; return the exit code and what is said."""
    done = subprocess.run(
        [sys.executable, ROOT / 'mutants' / 'run.py', '--root', toy, '--table', TABLE, '--out',
         toy.parent / 'out', '--equivalents', toy.parent / 'equivalents.yaml', '--count', '0',
         *options], capture_output=True, text=True)
    assert not done.stderr, done.stderr
    return done.returncode, done.stdout


def equivalent(module, line):
    """Return an entry for the survivor of the toy."""
    return {'package': 'toy', 'module': module, 'function': 'untested', 'line': line,
            'to': 'return value + 3', 'reason': 'nobody calls it'}


def mutant(module):
    """Return that survivor, as far as the list of equivalents looks at it."""
    return SimpleNamespace(**equivalent(module, 'return value - 3'))


def test_an_equivalent_mutant_is_known_after_its_file_has_moved(modules, tmp_path):
    (tmp_path / 'list.yaml').write_text(yaml.safe_dump(
        [equivalent('sums.py', 'return value - 3'), equivalent('sums.py', 'gone')]))
    known = modules('records').Equivalents(tmp_path / 'list.yaml')
    assert known.reason(mutant('sums.py'), {'sums.py'})
    assert known.reason(mutant('moved/all.py'), {'moved/all.py'})
    assert not known.reason(mutant('other.py'), {'sums.py', 'other.py'}), 'the same line elsewhere'
    for module in ('sums.py', 'moved/all.py'):
        lines = [(module, 'untested', 'return value - 3')]
        assert known.unused('toy', lines) == ['toy: sums.py untested: gone']


def test_an_equivalent_mutant_without_a_reason_is_refused(modules, tmp_path):
    entry = {**equivalent('sums.py', 'return value - 3'), 'reason': ' '}
    (tmp_path / 'list.yaml').write_text(yaml.safe_dump([entry]))
    with pytest.raises(ValueError, match='reason'):
        modules('records').Equivalents(tmp_path / 'list.yaml')


def test_outcomes_outlive_a_line_that_was_cut(modules, tmp_path):
    name = ('untested', 'return value - 3', 'return value + 3')
    one = SimpleNamespace(**vars(mutant('sums.py')), path='sums.py', number=14, name=name)
    modules('records').Outcomes(tmp_path / 'all').add('digest', one, 'survived', '')
    with (tmp_path / 'all').open('a') as file:
        file.write('{"package": "to')
    again = modules('records').Outcomes(tmp_path / 'all')
    assert again.get('digest', one) == 'survived' and again.survived('toy') == {name}
    assert again.get('of other tests', one) is None


def test_a_sample_is_repeatable_and_stays_when_its_file_moves(modules, toy):
    sample = modules('sample')
    everything = [mutant.name for mutant in sample.draw(toy, 'toy', 'toy/inner', 1, None)]
    drawn = sample.draw(toy, 'toy', 'toy/inner', 1, 3)
    assert drawn == sample.draw(toy, 'toy', 'toy/inner', 1, 3)
    assert [mutant.name for mutant in drawn] == everything[:3]
    others = [[mutant.name for mutant in sample.draw(toy, 'toy', 'toy/inner', seed, 3)]
              for seed in range(2, 6)]
    assert any(other != everything[:3] for other in others)
    (toy / 'toy/moved').mkdir()
    shutil.move(toy / 'toy/inner/sums.py', toy / 'toy/moved/all.py')
    moved = sample.draw(toy, 'toy', 'toy/moved', 1, 3)
    assert [mutant.name for mutant in moved] == everything[:3]


def test_a_survivor_is_drawn_again_whatever_the_seed_was(modules, toy):
    sample = modules('sample')
    for seed in range(6):
        survivor = sample.draw(toy, 'toy', 'toy/inner', seed, 1)[0].name
        again = sample.draw(toy, 'toy', 'toy/inner', seed + 1, None, again={survivor})
        assert [mutant.name for mutant in again] == [survivor]


def test_nothing_of_annotations_docstrings_and_texts_of_errors_is_drawn(modules, toy):
    drawn = modules('sample').draw(toy, 'toy', 'toy/inner', 1, None)
    lines = SOURCE.splitlines()
    assert sorted({lines[mutant.number - 1].strip() for mutant in drawn}) == [
        'LIMIT: int | None = 10', 'if value is None:', 'return value + value', 'return value - 3']
    assert all(mutant.to.startswith('LIMIT: int | None = ') for mutant in drawn
               if mutant.line.startswith('LIMIT'))


@pytest.mark.parametrize('line, expected', [
    ('x = a - b', ['x = a + b']),
    ('x = -a', ['x = +a']),
    ("x = f'{a * b} %'", ["x = f'{a / b} %'"]),
    ('x = f(*a, **b)', []),
    ('x = a if b else c', ['x = a if not b else c']),
    ('x = 1.5', ['x = 0.5', 'x = 2.5']),
    ('x = not a', ['x =  a']),
    ('x = a is not b', ['x = a is b']),
    ('x += a', ['pass']),
    ('f(a)', ['pass']),
    ('for x in a: f = 0', ['for x in []: f = 0', 'for x in a: f = -1', 'for x in a: f = 1']),
    ('while a < b: break', ['while a < b: continue', 'while a <= b: break',
                            'while a >= b: break', 'while not a < b: break'])])
def test_a_line_is_changed_in_each_of_these_ways(modules, line, expected):
    operators = modules('operators')
    text = line + '\n'
    assert sorted(way.apply(text).strip() for way in operators.ways(text)) == expected


def test_each_exception_of_a_handler_is_changed_alone(modules):
    text = 'try:\n    f = a\nexcept (m.A, B) as error:\n    f = b\n'
    changed = sorted(way.apply(text).split('\n')[2] for way in modules('operators').ways(text))
    assert changed == ['except (StopAsyncIteration, B) as error:',
                       'except (m.A, StopAsyncIteration) as error:']


def test_what_stands_in_for_a_device_is_left_alone(modules, toy):
    shutil.move(toy / 'toy/inner/sums.py', toy / 'toy/inner/emulated.py')
    assert modules('sample').draw(toy, 'toy', 'toy/inner', 1, None) == []


def test_killed_survived_and_equivalent_are_told_and_no_file_is_changed(toy):
    before = {path: path.read_bytes() for path in toy.rglob('*') if path.is_file()}
    code, said = run(toy)
    assert code == 1
    killed = [line for line in said.splitlines() if ' killed ' in line]
    assert any('sums.py:10 + -> -  test_sums.py::test_double' in line
               for line in killed)
    assert ('survived: toy/inner/sums.py:14 in untested  [- -> +]\n'
            '    - return value - 3\n    + return value + 3\n') in said
    (toy.parent / 'equivalents.yaml').write_text(yaml.safe_dump(
        [equivalent('sums.py', 'return value - 3'), equivalent('sums.py', 'gone')]))
    _, said = run(toy)
    assert 'equivalent toy/inner/sums.py:14' in said and '(from before)' in said
    assert 'no such mutant: toy: sums.py untested: gone' in said
    assert {path: path.read_bytes() for path in toy.rglob('*') if path.is_file()} == before


def test_a_mutant_that_hangs_is_killed_by_its_time(modules, toy):
    runner, drawn = modules('runner'), modules('sample').draw(toy, 'toy', 'toy/inner', 1, 1)
    hanging = SimpleNamespace(**{
        **vars(drawn[0]), 'source': SOURCE.replace('return value + value', 'while True: pass')})
    package = runner.Package(toy, 'toy/inner', ['tests'], toy.parent / 'work')
    package.limits, told = {'tests/test_sums.py': 0.3}, []
    package.run([hanging], 1, lambda _, *outcome: told.append(outcome[:2]))
    assert told == [('timeout', 'tests/test_sums.py::test_double')]
