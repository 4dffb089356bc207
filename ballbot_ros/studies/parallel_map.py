# SPDX-License-Identifier: Apache-2.0
"""
A parallel map that stores every finished block on disk, so that an interrupted run resumes.

Sweeps and evaluations share it.  The blocks run in processes of this machine or on a Dask
cluster; this process writes the result of each block to a separate file atomically.
"""
from concurrent.futures import Executor, FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
import errno
import fcntl
from functools import lru_cache
import gc
import hashlib
from itertools import islice
import json
import logging
import multiprocessing
import os
from pathlib import Path
import signal
from threading import Thread
from time import sleep
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Set, Tuple

from ballbot_ros import __version__
from ballbot_ros.config.optional import load_optional
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.results.files import check_writable, write_text
from ballbot_ros.studies.progress import Progress

LOG = logging.getLogger(__name__)
QUEUED_PER_WORKER = 3  # blocks; results wait on disk, not in memory
INDEX_FILE = 'blocks.json'
# Folders of the package that the rows of an evaluation depend on.
SOURCES = ('control', 'crossing', 'decision', 'floors', 'navigation', 'physics', 'plant',
           'steering', 'studies')


def checkpointed_map(function: Callable[..., Any],
                     blocks: Mapping[str, Tuple[int, Tuple[Any, ...]]],
                     folder: Path, pool: Executor, workers: int,
                     write: Callable[[Any, Path], None], progress: Progress) -> int:
    """
    Call a function for each block whose file is missing, and write the file.

    The function is at the top level of a module, so that it can be pickled; `blocks` maps the name
    of a file in the folder to the number of cases in the block and the arguments of the function.
    The caller has `claimed` the folder.  `write` is called in this process with a result and the
    path of its file, which it must replace atomically.  `progress` receives the number of finished
    cases.

    Returns the number of cases that a previous, interrupted run had finished.
    """
    missing = {name: block for name, block in blocks.items() if not (folder / name).is_file()}
    found = done = sum(cases for name, (cases, _) in blocks.items() if name not in missing)
    progress(done)
    pending = iter(missing.items())
    running: Dict[Future[Any], Tuple[str, int]] = {}
    try:
        while True:
            for name, (cases, arguments) in islice(pending,
                                                   QUEUED_PER_WORKER * workers - len(running)):
                running[pool.submit(function, *arguments)] = name, cases
            if not running:
                return found
            ready: Set[Future[Any]] = wait(running, return_when=FIRST_COMPLETED)[0]
            for future in ready:
                name, cases = running[future]
                write(future.result(), folder / name)
                del running[future]
                done += cases
                progress(done)
    except KeyboardInterrupt:
        # The pool ends only after the blocks that its workers have started: store their results.
        started = {future: name for future, (name, _) in running.items() if not future.cancel()}
        if started:
            LOG.warning('interrupted: the workers finish the blocks that they have started')
        for future, name in started.items():
            write(future.result(), folder / name)
        raise


def checkpointed_rows(function: Callable[..., List[Any]],
                      blocks: Mapping[str, Tuple[int, Tuple[Any, ...]]],
                      folder: Path, digest: str, pool: Executor, workers: int,
                      progress: Progress) -> List[Any]:
    """Return the rows of all blocks, stored as JSON files; see `claimed`, `checkpointed_map`."""
    with claimed(folder, digest):
        checkpointed_map(function, blocks, folder, pool, workers,
                         lambda rows, path: write_text(json.dumps(rows), path), progress)
        return [row for name in blocks
                for row in json.loads((folder / name).read_text(encoding='utf-8'))]


@lru_cache(maxsize=1)
def source_digest() -> str:
    """Return a digest of the sources: rows of different versions of the code must not be mixed."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256(__version__.encode())
    for folder in SOURCES:
        for source in sorted((package / folder).rglob('*.py')):
            digest.update(source.read_bytes())
    return digest.hexdigest()


@contextmanager
def claimed(folder: Path, digest: str) -> Iterator[None]:
    """
    Lock a folder of blocks, and mark it with the digest of all inputs of their results.

    The lock ends with the context, or with this process.  Raises `ConfigurationError` if another
    process has locked the folder, or if the folder holds blocks of another run, is damaged, or
    cannot be written.
    """
    index = folder / INDEX_FILE
    check_writable(index)
    folder.mkdir(parents=True, exist_ok=True)
    with open(index, 'a+', encoding='utf-8') as stream:
        try:
            # Unlike those of flock, workers do not inherit this lock.
            fcntl.lockf(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            locked = error.errno in (errno.EACCES, errno.EAGAIN)
            reason = ('another run computes its blocks; wait for its end, or write'
                      if locked else f'its file system has no locks ({error.strerror}); write')
            raise ConfigurationError(
                f'{folder} cannot be locked: {reason} elsewhere with --out', 'unavailable',
                str(folder)) from error
        stream.seek(0)
        content = stream.read()
        if content:
            _check_digest(content, folder, digest)
        else:
            stream.write(json.dumps({'digest': digest}))
            stream.flush()
        yield


def _check_digest(content: str, folder: Path, digest: str) -> None:
    """Refuse a folder whose index has another digest."""
    try:
        known = json.loads(content)['digest']
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(
            f'{folder / INDEX_FILE}: damaged; remove {folder} to start again', 'unreadable',
            str(folder)) from error
    if known != digest:
        raise ConfigurationError(
            f'{folder} holds the unfinished blocks of a run with other settings or of another '
            'version of the code; finish that run, remove the folder, or write elsewhere with '
            '--out', 'inconsistent', str(folder))


@contextmanager
def worker_pool(workers: Optional[int],
                scheduler: Optional[str] = None) -> Iterator[Tuple[Executor, int]]:
    """
    Provide a pool of local processes or of a Dask cluster, and its number of workers.

    None is one local process per core; the address of a Dask scheduler, such as
    ``tcp://host:8786``, selects a cluster instead.  Raises `ConfigurationError` if Dask is not
    installed, no scheduler answers, or it has no workers.
    """
    if scheduler is None:
        number = (os.cpu_count() or 1) if workers is None else workers
        pool = ProcessPoolExecutor(
            number, multiprocessing.get_context('fork'), _start_worker, (os.getpid(),))
        try:
            yield pool, number
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return
    distributed = load_optional(
        'distributed', 'dask', 'pip install "dask[distributed]"', '--dask')
    try:
        client = distributed.Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f'--dask {scheduler}: no scheduler answers at this address: {error}', 'unreadable',
            'dask') from error
    with client:
        number = sum(client.nthreads().values())
        if number == 0:
            raise ConfigurationError(
                f'--dask {scheduler}: the cluster has no workers; start some with dask worker',
                'missing', 'dask')
        yield client.get_executor(), number


def _start_worker(parent: int) -> None:
    """Leave the signals of the terminal to the parent, and exit when it has ended."""
    # As in `ros.run`: garbage collection of all modules takes longer than a period.
    gc.freeze()
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # with which a broken pool ends its workers

    def watch() -> None:
        while os.getppid() == parent:
            sleep(0.5)
        os._exit(1)
    Thread(target=watch, daemon=True).start()
