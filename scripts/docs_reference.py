# SPDX-License-Identifier: Apache-2.0
"""The pages of the site that are made from the code: command line, messages, Python."""
import argparse
from importlib import import_module
from pathlib import Path

from ballbot_ros.cli.command import Parser, VERBS

ROOT = Path(__file__).resolve().parent.parent
# What is for use from Python, and where it is described in words.
PUBLIC = {'physics': 'model.md', 'crossing': 'max_step_height.md', 'control': 'speed_law.md',
          'decision': 'decision.md', 'plant': '', 'estimation': 'hardware_estimate.md',
          'drives': 'hardware.md', 'results': '', 'studies': 'step_height.md', 'figures': '',
          'errors': ''}
COLUMNS = '99'  # in which the usage of a command is wrapped


def pages():
    """Return the text of each page by its name."""
    return {'cli.md': cli(), 'messages.md': messages(), 'python.md': python()}


def cli():
    """Return the page of the command line."""
    parts = ['# The command line\n', 'Made from the options that the commands read. '
             '`ballbot VERB --help` prints the same.\n']
    for verb, (module, help_text) in VERBS.items():
        parser = Parser(prog=f'ballbot {verb}', allow_abbrev=False,
                        formatter_class=lambda prog: argparse.HelpFormatter(prog, width=95))
        import_module(module).add_arguments(parser)
        usage = parser.format_usage().removeprefix('usage: ')
        rows = [f'* {signature(action)}: {explanation(parser, action)}'
                for action in parser._actions
                if action.dest != 'help' and action.help != argparse.SUPPRESS]
        parts += [f'## `{verb}`\n', f'{sentence(help_text)}\n', f'```text\n{usage}```\n',
                  '\n'.join(rows) + '\n']
    return '\n'.join(parts)


def sentence(text):
    """Return a text with a capital and a full stop."""
    return f'{text[0].upper()}{text[1:]}'.rstrip('.') + '.'


def signature(action):
    """Return an option, or the name of an argument, as it is typed."""
    if not action.option_strings:
        return f'`{action.metavar or action.dest}`'
    value = '' if action.nargs == 0 else ' ' + (
        action.metavar if isinstance(action.metavar, str) else ' '.join(action.metavar)
        if action.metavar else '|'.join(map(str, action.choices)) if action.choices
        else action.dest.upper())
    return ', '.join(f'`{option}{value}`' for option in action.option_strings)


def explanation(parser, action):
    """Return the help of an option, its default filled in, safe in Markdown."""
    text = parser._get_formatter()._expand_help(action) if action.help else ''
    return text.replace('<', '\\<').replace('*', '\\*').replace('_', '\\_')


def messages():
    """Return the page of messages, services and actions."""
    parts = ['# Messages, services and actions\n', 'The definitions as they are built, with '
             'their comments. Units are SI and stand in brackets.\n']
    for folder, kind in (('msg', 'Messages'), ('srv', 'Services'), ('action', 'Actions')):
        parts.append(f'## {kind}\n')
        for path in sorted((ROOT / folder).glob(f'*.{folder}')):
            text = path.read_text(encoding='utf-8')
            parts += [f'### {path.stem}\n', f'```text\n{text.rstrip()}\n```\n']
    return '\n'.join(parts)


def python():
    """Return the page of the Python packages, filled by autodoc."""
    parts = ['# Python\n', 'What is for use from Python, without ROS; its examples are run by the '
             'tests. `pip install .` is enough. Units are SI, angles in radians.\n',
             '[The scripts of examples/](readme.md#from-python-and-from-a-shell) are whole '
             'programs.\n']
    for name, document in PUBLIC.items():
        parts.append(f'## ballbot_ros.{name}\n')
        if document:
            parts.append(f'In words: [{document.removesuffix(".md").replace("_", " ")}]'
                         f'(../{document}).\n')
        parts.append('```{eval-rst}\n.. automodule:: ballbot_ros.' + name
                     + '\n   :members:\n```\n')
    return '\n'.join(parts)
