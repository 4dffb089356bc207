# SPDX-License-Identifier: Apache-2.0
"""
Compile the inner loops with numba where it is installed; run the same source where not.

The numerical kernels are written in the part of Python that numba understands and are
marked ``@compiled``.  Set ``BALLBOT_UNCOMPILED=1``, or ``NUMBA_DISABLE_JIT=1`` as numba has it,
to run them as plain Python, to debug or to compare: both give the same numbers to rounding.

Machine code is kept in ``$XDG_CACHE_HOME/ballbot_ros`` (``~/.cache/ballbot_ros``), so that
only the first run after a change pays for it.  Where that takes longer than a moment, a warning
is logged by the logger ``ballbot_ros``, which Python prints.  numba by itself notices a change in
the file of a kernel, but not in the files of the kernels that it calls; so the folder is named
after a digest of all folders that hold kernels.
"""
from contextlib import suppress
import fcntl
import hashlib
import os
from pathlib import Path
import shutil
import sys
import tempfile
from types import FunctionType
from typing import Any, Callable, cast, get_type_hints, List, Tuple, Type, TypeVar

from ballbot_ros.compile_notice import CompileNotice

F = TypeVar('F', bound=Callable[..., Any])
T = TypeVar('T')

try:
    if os.environ.get('BALLBOT_UNCOMPILED', '0') not in ('', '0'):
        raise ImportError('compilation switched off by BALLBOT_UNCOMPILED')
    import numba
    from numba.core import config as numba_config

    COMPILED = not numba_config.DISABLE_JIT
except ImportError:
    COMPILED = False

KEPT_CACHES = 4
# Modules with fused multiply-add and without signed zeros: a run has hundreds of thousands of such
# products.  The filters are compared with their matrices to the last digits.
FUSED = ('ballbot_ros.physics.', 'ballbot_ros.crossing.')
# The folders that contain kernels.
KERNELS = ('physics', 'crossing', 'control', 'estimation', 'decision')

# Receives the name of a kernel, and whether its machine code was cached.
OnFirstCall = Callable[[str, bool], None]
_callbacks: List[OnFirstCall] = []


def on_first_call(callback: OnFirstCall) -> None:
    """
    Call a function when a kernel is called for the first time, or with other types than before.

    The call comes before the compilation, or after loading cached machine code.
    """
    _callbacks.append(callback)


_notice = CompileNotice()


def compile_time() -> float:
    """Return the time that this process has spent compiling so far [s]."""
    return _notice.spent


def _cache_folder() -> str:
    """Return the folder for the machine code of this source; create it if needed."""
    here = Path(__file__).resolve().parent
    digest = hashlib.sha256(numba.__version__.encode())
    kernels = (path for folder in KERNELS for path in (here / folder).rglob('*.py'))
    for source in [Path(__file__), *sorted(kernels)]:
        digest.update(source.read_bytes())
    base = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'ballbot_ros'
    folder = base / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.touch()
        if not os.access(folder, os.W_OK):
            raise PermissionError(f'{folder} is not writable')
        for old in sorted(base.iterdir(), key=os.path.getmtime)[:-KEPT_CACHES]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:
        # Without a writable home every run compiles, but does not fail.
        return tempfile.mkdtemp(prefix='ballbot_ros_')
    return str(folder)


_FOLDER = _cache_folder() if COMPILED else ''


def compiled(function: F) -> F:
    """
    Mark a kernel for compilation.

    Operations are not reordered, and numbers may be infinite or NaN; see `FUSED` for the
    exceptions.
    """
    return _compile(function, inline='never')


def unlocked(function: F) -> F:
    """
    Mark a long-running kernel for compilation that lets other threads of Python run meanwhile.

    Concurrent threads must each pass their own work arrays.  Kernels call it instead of inlining
    it, which saves compile time.
    """
    return _compile(function, inline='never', nogil=True, forceinline=False)


def outlined(function: F) -> F:
    """
    Mark a kernel that is compiled once and called, not inlined into its callers.

    For large kernels with several callers.
    """
    return _compile(function, inline='never', forceinline=False)


def inlined(function: F) -> F:
    """
    Mark a kernel that is inlined into its callers.

    In the innermost calls, passing the arguments takes longer than the computation.
    """
    return _compile(function, inline='always')


def in_python(kernel: F) -> F:
    """Return a kernel as the Python function that it is compiled from."""
    return cast(F, getattr(kernel, 'py_func', kernel))


def row_reader(cls: Type[T]) -> Callable[[Any, int], T]:
    """Return a kernel ``read(row, first)`` of the fields of a NamedTuple of numbers in a row."""
    kinds = get_type_hints(cls)
    items = ', '.join(f'int(row[first + {place}])' if kinds[name] is int else
                      f'row[first + {place}]' for place, name in enumerate(_fields(cls)))
    return cast(Callable[[Any, int], T], _generated(
        cls, 'read', f'read(row, first): return {cls.__name__}({items})', [cls]))


def unpacker(cls: Type[T]) -> Callable[[Any], T]:
    """Return a kernel that makes a NamedTuple of plain tuples, nested as its fields are."""
    return cast(Callable[[Any], T], _generated(
        cls, 'unpack', f'unpack(plain): return {_unpacking(cls, "plain")}', _nested(cls)))


def packer(cls: Type[T]) -> Callable[[T], Any]:
    """Return a kernel that makes plain tuples of a NamedTuple, nested as its fields are."""
    return cast(Callable[[T], Any], _generated(
        cls, 'pack', f'pack(value): return {_packing(cls, "value")}', []))


def _fields(cls: Any) -> Tuple[str, ...]:
    return cast(Tuple[str, ...], getattr(cls, '_fields', ()))


def _nested(cls: Any) -> List[Any]:
    """Return a NamedTuple class with all that its fields are made of."""
    return [cls] + [item for kind in get_type_hints(cls).values() if _fields(kind)
                    for item in _nested(kind)]


def _unpacking(cls: Any, source: str) -> str:
    kinds = get_type_hints(cls)
    return f'{cls.__name__}(' + ', '.join(
        _unpacking(kinds[name], f'{source}[{place}]') if _fields(kinds[name])
        else f'{source}[{place}]' for place, name in enumerate(_fields(cls))) + ')'


def _packing(cls: Any, source: str) -> str:
    kinds = get_type_hints(cls)
    return '(' + ', '.join(
        _packing(kinds[name], f'{source}.{name}') if _fields(kinds[name])
        else f'{source}.{name}' for name in _fields(cls)) + ',)'


def _generated(cls: Any, verb: str, source: str, names: List[Any]) -> Any:
    """Return a kernel of one line of source that belongs to a class; cached with its module."""
    name = f'{verb}_{cls.__name__}'
    space = {'__name__': cls.__module__, **{item.__name__: item for item in names}}
    file = sys.modules[cls.__module__].__file__
    exec(compile(f'def {name}{source[len(verb):]}', str(file), 'exec'), space)
    return compiled(cast(Any, space[name]))


def with_globals(function: F, owner: Callable[..., Any], **names: Any) -> F:
    """
    Return a copy of a function, still to be compiled, that reads other global names.

    numba caches no kernel that receives another one as an argument or in a closure.

    Parameters
    ----------
    function : function
    owner : kernel
        The copy belongs to its module.
    names
        Added to the globals of the function.

    """
    made = FunctionType(function.__code__, {
        **function.__globals__, '__name__': owner.__module__, **names}, function.__name__)
    made.__qualname__ = f'{owner.__module__.rpartition(".")[2]}{function.__name__}'
    made.__doc__ = function.__doc__
    return cast(F, made)


def direct(kernel: F) -> F:
    """
    Return the machine code of a kernel, for calls with the types that it was compiled for.

    This skips the type dispatch of numba, which takes longer than passing the arguments.  Returns
    the kernel itself before its first call, if it was called with several sets of types, and if
    nothing is compiled.
    """
    compiled_for = getattr(kernel, 'overloads', {})
    if len(compiled_for) != 1:
        return kernel
    # The view of an OrderedDict looks each key up; the hash of these types takes 12 us.
    return cast(F, next(iter(dict.values(compiled_for))).entry_point)


def _compile(function: F, inline: str,
             nogil: bool = False, forceinline: bool = True) -> F:
    if not COMPILED:
        return function
    fused = {'contract', 'nsz'} if function.__module__.startswith(FUSED) else False
    before = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = _FOLDER  # read only while decorating; restored below
    try:
        # Without numba's reference counting (_nrt): kernels neither create nor keep arrays,
        # callers hold the references, and the counting took twice as long as the mechanics.
        kernel: Any = numba.njit(
            cache=True, error_model='numpy', forceinline=forceinline, _nrt=False, inline=inline,
            nogil=nogil, fastmath=fused)(function)
    finally:
        numba_config.CACHE_DIR = before
    cache = kernel._cache
    cache.load_overload = _reported(f'{function.__module__}.{function.__qualname__}', cache)
    cache.save_overload = _one_at_a_time(cache.save_overload)
    return cast(F, kernel)


def _reported(name: str, cache: Any) -> Callable[..., Any]:
    """
    Return a function that loads cached machine code of a kernel and calls each `OnFirstCall`.

    numba itself first initializes its compiler, which takes longer than loading and is needed only
    without cached machine code.
    """
    prepare_and_load = cache.load_overload
    load = getattr(cache, '_load_overload', prepare_and_load)

    def load_and_report(signature: Any, target: Any) -> Any:
        try:
            found = load(signature, target)
        except Exception:  # noqa: BLE001 numba handles unreadable files
            found = None
        if found is None:
            found = prepare_and_load(signature, target)
        for callback in _callbacks:
            callback(name, found is not None)
        if found is None:
            _notice.begins(warns=not _callbacks)
        return found
    return load_and_report


def _one_at_a_time(save: Callable[..., None]) -> Callable[..., None]:
    """
    Allow one process at a time to write to the folder of the machine code.

    numba reads the index of a kernel, adds a file to it and writes it back.  Two concurrent
    processes may use the same file name, and later run the code of the other.
    """
    def save_alone(*arguments: Any) -> None:
        _notice.ends()
        # With a full disk, or one without locks, every run compiles, but does not fail.
        with suppress(OSError), open(os.path.join(_FOLDER, 'lock'), 'w') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            save(*arguments)
    return save_alone
