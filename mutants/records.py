# SPDX-License-Identifier: Apache-2.0
"""The outcomes that are kept from run to run, and the mutants known to be equivalent."""
import json

import yaml


class Outcomes:
    """A file of outcomes, one in a line; it is added to as each comes."""

    def __init__(self, path):
        self._path, self._known, self._latest = path, {}, {}
        if path.exists():
            for line in path.read_text(encoding='utf-8').splitlines():
                try:
                    self._take(json.loads(line))
                except (ValueError, KeyError):  # a line that an interruption cut
                    continue

    def get(self, digest, mutant):
        """Return the outcome of a mutant with the same sources and tests, or None."""
        return self._known.get((digest, mutant.path, mutant.number) + mutant.name)

    def survived(self, package):
        """Name the mutants of a package whose latest outcome is that they survived."""
        return {key[1:] for key, outcome in self._latest.items()
                if key[0] == package and outcome == 'survived'}

    def add(self, digest, mutant, outcome, killer):
        """Keep an outcome."""
        said = {'digest': digest, 'package': mutant.package, 'path': mutant.path,
                'number': mutant.number, 'function': mutant.function, 'line': mutant.line,
                'to': mutant.to, 'outcome': outcome, 'killer': killer}
        self._take(said)
        with self._path.open('a', encoding='utf-8') as file:
            file.write(json.dumps(said) + '\n')

    def _take(self, said):
        name = said['function'], said['line'], said['to']
        self._known[(said['digest'], said['path'], said['number']) + name] = said['outcome']
        self._latest[(said['package'],) + name] = said['outcome']


class Equivalents:
    """
    Mutants that no test can kill, each with the reason.

    An entry holds for the function, the line and what is put there.  Its module must be the same
    too, but only as long as the package has a module of that name: a file may move.
    """

    def __init__(self, path):
        text = path.read_text(encoding='utf-8') if path.exists() else ''
        self._entries = yaml.safe_load(text) or []
        for entry in self._entries:
            missing = {'package', 'module', 'function', 'line', 'to', 'reason'} - set(entry)
            if missing or not str(entry['reason']).strip():
                raise ValueError(f'{path}: {sorted(missing) or "reason"} is missing in {entry}')

    def reason(self, mutant, modules):
        """Return why a mutant is equivalent, or an empty string; with the modules there are."""
        for entry in self._entries:
            same = all(str(entry[key]).strip() == getattr(mutant, key)
                       for key in ('package', 'function', 'line', 'to'))
            if same and (entry['module'] == mutant.module or entry['module'] not in modules):
                return entry['reason']
        return ''

    def unused(self, package, lines):
        """List the entries of a package whose line is in none of its functions any more."""
        lines = set(lines)
        modules = {module for module, _, _ in lines}
        anywhere = {(function, line) for _, function, line in lines}
        unused = []
        for entry in self._entries:
            name = entry['function'], str(entry['line']).strip().split('\n')[0].strip()
            there = (entry['module'], *name) in lines if entry['module'] in modules \
                else name in anywhere
            if entry['package'] == package and not there:
                unused.append(f'{package}: {entry["module"]} {name[0]}: {name[1]}')
        return unused
