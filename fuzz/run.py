# SPDX-License-Identifier: Apache-2.0
"""
Fuzz the serial protocols, guided by coverage; see targets.py for what counts as a failure.

    make fuzz                                 # ten million bytes for each, some minutes
    make fuzz ARGS='--bytes 1e5 --only "vesc host"'

An input that fails is written to fuzz/found and named.
"""
import argparse
from importlib.util import find_spec
import os
from pathlib import Path
import subprocess
import sys
import time

FOLDER = Path(__file__).resolve().parent
HOW_TO_INSTALL = 'make fuzz, or .venv/bin/python -m pip install -r requirements/fuzz.txt'


def main():
    """Fuzz all targets, each in a process of its own; fail if one fails."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--bytes', type=float, default=1e7, help='for each (default: %(default)g)')
    parser.add_argument('--only', metavar='TARGET', help='one target, such as "vesc host"')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--worker', action='store_true', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        work(arguments.only, int(arguments.bytes), arguments.seed)
    if find_spec('atheris') is None:  # said once, not by each worker
        sys.exit(f'atheris is not installed: {HOW_TO_INSTALL}')
    from targets import TARGETS  # not above: a worker must import it instrumented
    if arguments.only not in (None, *TARGETS):
        parser.error(f'--only must be one of {", ".join(TARGETS)}, got {arguments.only!r}')
    failed = []
    print(f'{"":16}{"bytes":>12}{"inputs":>10}{"messages":>10}{"covered":>9}{"time":>8}')
    for name in TARGETS if arguments.only is None else (arguments.only,):
        done = subprocess.run(
            [sys.executable, __file__, '--worker', '--only', name, '--bytes',
             str(arguments.bytes), '--seed', str(arguments.seed)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        line = [line for line in done.stdout.splitlines() if line.startswith(name)]
        if done.returncode or not line:
            failed.append(name)
            print(f'{name}: FAILED\n{done.stdout}{done.stderr[-4000:]}')
        else:
            covered = [word for word in done.stderr.split('\n') if ' cov: ' in word]
            edges = covered[-1].split(' cov: ')[1].split()[0] if covered else '?'
            print(line[0].replace('EDGES', f'{edges:>9}'), flush=True)
    sys.exit(f'failed: {", ".join(failed)}' if failed else 0)


def work(name, wanted, seed):
    """Fuzz one target in this process until it has seen enough bytes; does not return."""
    import atheris
    with atheris.instrument_imports(include=[
            'ballbot_ros.drives', 'ballbot_ros.emulator', 'ballbot_ros.imus']):
        import targets
    fuzz, protocol = targets.TARGETS[name]
    seen = {'bytes': 0, 'inputs': 0, 'messages': 0}
    begin = time.monotonic()

    def one(data):
        size, messages = fuzz(protocol, data)
        seen['bytes'] += size
        seen['inputs'] += 1
        seen['messages'] += messages
        if seen['bytes'] >= wanted:
            print(f'{name:16}{seen["bytes"]:12}{seen["inputs"]:10}{seen["messages"]:10}EDGES'
                  f'{time.monotonic() - begin:7.0f}s', flush=True)
            sys.stderr.flush()
            os._exit(0)

    found = FOLDER / 'found'
    found.mkdir(exist_ok=True)
    atheris.Setup([sys.argv[0], '-max_len=600', f'-seed={seed}', f'-artifact_prefix={found}/',
                   '-len_control=0'], one)
    atheris.Fuzz()


if __name__ == '__main__':
    main()
