# SPDX-License-Identifier: Apache-2.0
"""The parser of ``ballbot`` with all its verbs, for the reference of the command line."""
from ballbot_ros.cli.command import load_verb, VERBS
from ballbot_ros.cli.verb import Parser


def parser():
    """Return the parser; `main` itself imports the module of the given verb only."""
    whole = Parser(prog='ballbot', allow_abbrev=False)
    verbs = whole.add_subparsers(metavar='command', parser_class=Parser)
    for name, (_, text) in VERBS.items():
        load_verb(name).add_arguments(verbs.add_parser(
            name, help=text, description=f'{text[0].upper()}{text[1:]}.', allow_abbrev=False))
    return whole
