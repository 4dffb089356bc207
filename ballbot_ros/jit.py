# SPDX-License-Identifier: Apache-2.0
"""
Compile the inner loops with numba if it is installed; otherwise run the same source.

The numerical kernels are written in the subset of Python that numba supports and are
marked ``@compiled``.  Set ``BALLBOT_UNCOMPILED=1``, or ``NUMBA_DISABLE_JIT=1`` of numba itself,
to run them as plain Python, to debug or to compare: both give the same numbers to rounding.

Machine code is cached in ``$XDG_CACHE_HOME/ballbot_ros`` (``~/.cache/ballbot_ros``), so that
only the first run after a change compiles.  If that takes more than a few seconds, the logger
``ballbot_ros`` logs a warning, which Python prints.  By itself, numba recompiles a kernel after
any change of its file, but not after a change of the files of the kernels that it calls; so the
folder is named after a digest of all files with kernels and of the files that they import, without
their docstrings and comments.

A kernel that another kernel calls becomes a part of the caller: it is lowered to LLVM IR once, and
is optimized and translated as a part of the kernels that Python calls.  All accesses to internals
of numba are in this module.
"""
import ast
from contextlib import suppress
import fcntl
import gc
import hashlib
from inspect import signature
import json
import os
from pathlib import Path
import shutil
import sys
import tempfile
from types import FunctionType
from typing import Any, Callable, cast, Dict, get_type_hints, Iterable, List, Tuple, Type, TypeVar

from ballbot_ros.compile_notice import CompileNotice

F = TypeVar('F', bound=Callable[..., Any])
T = TypeVar('T')

try:
    if os.environ.get('BALLBOT_UNCOMPILED', '0') not in ('', '0'):
        raise ImportError('compilation switched off by BALLBOT_UNCOMPILED')
    from llvmlite import binding as llvm, ir
    import numba
    from numba.core import (
        cgutils, compiler as numba_compiler, config as numba_config, typed_passes, untyped_passes)
    from numba.core.caching import IndexDataCacheFile
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler_machinery import PassManager
    from numba.core.targetconfig import ConfigStack
    from numba.core.types.functions import BaseFunction
    from numba.extending import intrinsic

    COMPILED = not numba_config.DISABLE_JIT
except ImportError:
    COMPILED = False

KEPT_CACHES = 4
# Modules with fused multiply-add and without signed zeros: a run has hundreds of thousands of such
# products.  Not the filters: tests compare them with their matrices to the last digits.
FUSED = ('ballbot_ros.physics.', 'ballbot_ros.crossing.')
# The folders that contain kernels.
KERNELS = ('physics', 'crossing', 'control', 'estimation', 'decision', 'navigation',
           'studies/evaluation')

_notice = CompileNotice()


def compile_time() -> float:
    """Return the time that this process has spent compiling so far [s]."""
    return _notice.spent


def _cache_folder() -> str:
    """Return the folder for the machine code of this source; create it if needed."""
    base = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'ballbot_ros'
    digest = hashlib.sha256(numba.__version__.encode())
    for line in _kernel_sources(base / 'sources.json'):
        digest.update(line.encode())
    folder = base / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.touch()
        if not os.access(folder, os.W_OK):
            raise PermissionError(f'{folder} is not writable')
        for old in sorted(base.glob(16 * '[0-9a-f]'), key=os.path.getmtime)[:-KEPT_CACHES]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:
        # Without a writable home folder, every run compiles but does not fail.
        return tempfile.mkdtemp(prefix='ballbot_ros_')
    return str(folder)


def _kernel_sources(known: Path) -> List[str]:
    """
    Return a digest of each file with kernels, and of each file that these import.

    The result for a file is cached in the file `known` until size or time of the former change:
    parsing all files takes a second.  All copies of the package on a machine share `known`.
    """
    here = Path(__file__).resolve().parent
    try:
        before = json.loads(known.read_text(encoding='utf-8'))
    except (OSError, ValueError):
        before = {}
    files: Dict[str, Any] = {}
    for path in [Path(__file__).resolve(), *(
            path for folder in KERNELS for path in sorted((here / folder).rglob('*.py')))]:
        stamp = [path.stat().st_mtime_ns, path.stat().st_size]
        kept = before.get(str(path), {})
        files[str(path)] = kept if kept.get('stamp') == stamp else {
            'stamp': stamp, **_kernel_source(path)}
    if {**before, **files} != before:
        others = {name: before[name] for name in before if os.path.exists(name)}
        with suppress(OSError):
            known.parent.mkdir(parents=True, exist_ok=True)
            new = known.with_name(f'{known.name}.{os.getpid()}')
            new.write_text(json.dumps({**others, **files}), encoding='utf-8')
            new.replace(known)
    wanted, found = [name for name in files if files[name]['kernels']], set()
    while wanted:
        name = wanted.pop()
        if name in files and name not in found:
            found.add(name)
            wanted += [str(here / item) for item in files[name]['imports']]
    return [files[name]['digest'] for name in sorted(found)]


def _kernel_source(path: Path) -> Dict[str, Any]:
    """Return whether a file has kernels, what it imports, and a digest of its code."""
    tree, imports = ast.parse(path.read_bytes()), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('ballbot_ros.'):
            inside = str(node.module).split('.')[1:]
            for parts in (inside, *([*inside, item.name] for item in node.names)):
                imports |= {f'{"/".join(parts)}.py', f'{"/".join(parts)}/__init__.py'}
        body = getattr(node, 'body', None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr) and isinstance(
                body[0].value, ast.Constant):
            del body[0]  # a docstring
    return {'kernels': any('ballbot_ros.jit' == getattr(node, 'module', '') for node in tree.body),
            'imports': sorted(imports),
            'digest': hashlib.sha256(ast.dump(tree).encode()).hexdigest()}


_FOLDER = _cache_folder() if COMPILED else ''


def compiled(function: F) -> F:
    """
    Mark a kernel for compilation.

    Operations are not reordered, and numbers may be infinite or NaN; see `FUSED` for the
    exceptions.
    """
    return _compile(function)


def unlocked(function: F) -> F:
    """
    Mark a long-running kernel that Python calls, to release the GIL while it runs.

    Concurrent threads must each pass their own work arrays.
    """
    return _compile(function, nogil=True, forceinline=False)


def outlined(function: F) -> F:
    """
    Mark a kernel that is compiled once and called, not inlined into its callers.

    For large kernels with several callers.
    """
    return _compile(function, forceinline=False)


def in_python(kernel: F) -> F:
    """Return the Python function that a kernel is compiled from."""
    return cast(F, getattr(kernel, 'py_func', kernel))


def row_reader(cls: Type[T]) -> Callable[[Any, int], T]:
    """Return a kernel ``read(row, first)`` that reads a NamedTuple of numbers from a row."""
    kinds = get_type_hints(cls)
    items = ', '.join(f'int(row[first + {place}])' if kinds[name] is int else
                      f'row[first + {place}]' for place, name in enumerate(_fields(cls)))
    return cast(Callable[[Any, int], T], _generated(
        cls, 'read', f'read(row, first): return {cls.__name__}({items})', [cls]))


def unpacker(cls: Type[T]) -> Callable[[Any], T]:
    """Return a kernel that converts plain tuples, nested like the fields, to a NamedTuple."""
    return cast(Callable[[Any], T], _generated(
        cls, 'unpack', f'unpack(plain): return {_unpacking(cls, "plain")}', _nested(cls)))


def packer(cls: Type[T]) -> Callable[[T], Any]:
    """Return a kernel that converts a NamedTuple to plain tuples, nested like its fields."""
    return cast(Callable[[T], Any], _generated(
        cls, 'pack', f'pack(value): return {_packing(cls, "value")}', []))


def by_number(name: str, modules: Iterable[Any]) -> Callable[..., Any]:
    """
    Return a kernel that calls the kernel `name` of one of several modules.

    The index of the module is an additional first argument.
    """
    kernels = [getattr(module, name) for module in modules]
    words = list(signature(in_python(kernels[0])).parameters)
    calls = [f'kernel_{number}({", ".join(words)})' for number in range(len(kernels))]
    source = '\n'.join([f'def {name}({", ".join(["index", *words])}):', *(
        f'    if index == {number}:\n        return {call}'
        for number, call in enumerate(calls) if number), f'    return {calls[0]}'])
    owner = sys._getframe(1).f_globals
    space = {'__name__': owner['__name__'],
             **{f'kernel_{number}': kernel for number, kernel in enumerate(kernels)}}
    exec(compile(source, owner['__file__'], 'exec'), space)
    return cast(Callable[..., Any], compiled(cast(Any, space[name])))


def row_sum(numbers: int, width: int) -> Callable[..., None]:
    """
    Return a kernel that writes a sum of rows of an array into another row.

    ``sum_rows(work, out, start, scale, factors, first, rows, count)`` writes ``start + sum(scale
    * factors[first + k] * row k)`` over `count` rows.  The last row is added last: it has the
    longest latency.  `out`, `start` and `rows` are the offsets of the result, of the first
    summand, and of the first row in `work`; `first` is the index of the first factor.

    Parameters
    ----------
    numbers : int
        Length of the sums, a multiple of 4.
    width : int
        Offset from one row to the next.

    """
    def sum_rows(work: Any, out: int, start: int, scale: float, factors: Any, first: int,
                 rows: int, count: int) -> None:
        for i in range(numbers):
            total = work[start + i]
            for k in range(count):
                total += scale * factors[first + k] * work[rows + width * k + i]
            work[out + i] = total

    if not COMPILED:
        return sum_rows
    half = 4  # numbers per SIMD operation
    vector, once = ir.VectorType(ir.DoubleType(), half), ('contract',)  # rounded once

    def spread(builder: Any, number: Any) -> Any:
        one = builder.insert_element(ir.Constant(vector, ir.Undefined), number,
                                     ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), ir.Constant(
            ir.VectorType(ir.IntType(32), half), [0] * half))

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # The compiler would not vectorize the sums, because the result may alias the summands.
        work, out, start, scale, factors, first, rows, count = arguments
        data = context.make_array(signature.args[0])(context, builder, work).data
        weights = context.make_array(signature.args[4])(context, builder, factors).data
        parts = range(numbers // half)

        def place(offset: Any, part: int) -> Any:
            at = builder.add(offset, ir.Constant(offset.type, half * part))
            return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())
        totals = [cgutils.alloca_once_value(builder, builder.load(place(start, part), align=8))
                  for part in parts]
        with cgutils.for_range(builder, count) as loop:
            weight = spread(builder, builder.fmul(scale, builder.load(
                builder.gep(weights, [builder.add(first, loop.index)]))))
            row = builder.add(rows, builder.mul(loop.index, ir.Constant(rows.type, width)))
            for part, total in zip(parts, totals):
                term = builder.fmul(weight, builder.load(place(row, part), align=8), flags=once)
                builder.store(builder.fadd(builder.load(total), term, flags=once), total)
        for part, total in zip(parts, totals):
            builder.store(builder.load(total), place(out, part), align=8)
        return context.get_dummy_value()

    def types_of(_: Any, work: Any, out: Any, start: Any, scale: Any, factors: Any, first: Any,
                 rows: Any, count: Any) -> Any:
        place = numba.types.intp
        return numba.types.void(work, place, place, numba.types.float64, factors, place, place,
                                place), generate
    return cast(Callable[..., None], intrinsic(types_of))


def _fields(cls: Any) -> Tuple[str, ...]:
    return cast(Tuple[str, ...], getattr(cls, '_fields', ()))


def _nested(cls: Any) -> List[Any]:
    """Return a NamedTuple class and those of its fields, recursively."""
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
    """Return a kernel from one line of source; it is cached with the module of the class."""
    name = f'{verb}_{cls.__name__}'
    space = {'__name__': cls.__module__, **{item.__name__: item for item in names}}
    file = sys.modules[cls.__module__].__file__
    exec(compile(f'def {name}{source[len(verb):]}', str(file), 'exec'), space)
    return compiled(cast(Any, space[name]))


def direct(kernel: F) -> F:
    """
    Return the machine code of a kernel, for calls with the types that it was compiled for.

    This skips the type dispatch of numba, which takes longer than passing the arguments.  Returns
    the kernel itself before its first call, if it was called with several sets of types, or if
    nothing is compiled.
    """
    compiled_for = getattr(kernel, 'overloads', {})
    if len(compiled_for) != 1:
        return kernel
    # The view of an OrderedDict looks up each key; the hash of these types takes 12 us.
    return cast(F, next(iter(dict.values(compiled_for))).entry_point)


def _compile(function: F, nogil: bool = False, forceinline: bool = True) -> F:
    """
    Return a kernel that has machine code of its own only if Python calls it.

    A kernel that calls it contains its code: that of a second kernel without wrappers, `_Linked`,
    which is neither optimized nor translated by itself.
    """
    if not COMPILED:
        return function
    kernel = _dispatcher(function, nogil, forceinline, pipeline_class=_Compiler)
    linked = FunctionType(function.__code__, function.__globals__, function.__name__,
                          function.__defaults__, function.__closure__)
    linked.__qualname__, linked.__module__ = f'{function.__qualname__}.linked', function.__module__
    linked.__annotations__ = function.__annotations__
    inner = _dispatcher(linked, nogil, forceinline, no_cpython_wrapper=True,
                        no_cfunc_wrapper=True, pipeline_class=_LinkedCompiler)
    inner._cache._impl.rebuild = _rebuild_linked
    # numba calls these two where another kernel calls this one.  It would compile the kernel for
    # each constant argument; LLVM propagates constants when it inlines the kernel.
    kernel.get_call_template = lambda arguments, named: inner.get_call_template(
        [numba.types.unliteral(item) for item in arguments], named)
    kernel.get_overload = inner.get_overload
    return cast(F, kernel)


def _dispatcher(function: Any, nogil: bool, forceinline: bool, **how: Any) -> Any:
    """Return numba's dispatcher of a function, with its machine code in our folder."""
    fused = {'contract', 'nsz'} if function.__module__.startswith(FUSED) else False
    before = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = _FOLDER  # read only while decorating; restored below
    try:
        # Without numba's reference counting (_nrt): kernels neither create nor keep arrays,
        # callers hold the references, and the counting took twice as long as the mechanics.
        kernel: Any = numba.njit(
            cache=True, error_model='numpy', forceinline=forceinline, _nrt=False, nogil=nogil,
            fastmath=fused, **how)(function)
    finally:
        numba_config.CACHE_DIR = before
    cache, name = kernel._cache, f'{function.__module__}.{function.__qualname__}'
    if function.__module__.startswith('ballbot_ros.'):
        # The folder name identifies the source; the line number of a kernel is irrelevant.
        cache._cache_file = IndexDataCacheFile(
            cache._cache_path, f'{name}-py{sys.version_info.major}{sys.version_info.minor}', '')
    cache.load_overload = _reported(name, cache)
    cache.save_overload = _one_at_a_time(cache.save_overload)
    return kernel


if COMPILED:
    class _Linked(JITCodeLibrary):  # type: ignore[misc]
        """Code of a kernel for the kernels that call it: not optimized, never loaded."""

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:
            self._ensure_finalized()
            return 0

        @property
        def codegen(self) -> Any:
            return self

        def set_env(self, name: str, environment: Any) -> None:
            """Do nothing: the kernel that contains this one sets it."""

        def serialize_using_object_code(self) -> Any:
            self._ensure_finalized()
            return self.name, self._get_module_for_linking().as_bitcode()

    _Function: Any = BaseFunction
    _find_call_type = _Function.get_call_type
    _call_types: Dict[Any, Any] = {}

    def _known_call_type(function: Any, context: Any, arguments: Any, named: Any) -> Any:
        """
        Return the signature of an operator or function for argument types, and cache it.

        numba looks through all overloads of an operator at each of its uses: when it infers types,
        and again when it generates code.
        """
        if named:
            return _find_call_type(function, context, arguments, named)
        key = function, tuple(arguments), bool(ConfigStack.top_or_none().fastmath)
        if key not in _call_types:
            _call_types[key] = _find_call_type(function, context, arguments, named)
        return _call_types[key]

    class _Compiler(numba_compiler.Compiler):  # type: ignore[misc]
        """The compiler of numba without the passes that change no kernel and take most time."""

        PASSES = (
            untyped_passes.TranslateByteCode, untyped_passes.FixupArgs,
            untyped_passes.GenericRewrites, untyped_passes.ReconstructSSA,
            typed_passes.NopythonTypeInference, typed_passes.PreLowerStripPhis,
            typed_passes.NativeLowering, typed_passes.NoPythonBackend)

        def compile_extra(self, function: Any) -> Any:
            # numba keeps all its objects; garbage collection would take a tenth of the time.
            collects, before = gc.isenabled(), _Function.get_call_type
            gc.disable()
            _Function.get_call_type = _known_call_type
            try:
                return super().compile_extra(function)
            finally:
                _Function.get_call_type = before
                if collects:
                    gc.enable()

        def define_pipelines(self) -> Any:
            lean = PassManager('lean')
            for item in self.PASSES:
                lean.add_pass(item, item.__name__)
            lean.finalize()
            return [lean]

    class _LinkedCompiler(_Compiler):
        """The compiler for a kernel that other kernels call."""

        def compile_extra(self, function: Any) -> Any:
            self.state.library = _Linked(self.state.targetctx.codegen(), function.__qualname__)
            return super().compile_extra(function)


def _rebuild_linked(target: Any, reduced: Any) -> Any:
    """Return the cached code of a kernel for the kernels that call it."""
    (name, bitcode), *rest = reduced
    library = _Linked(target.codegen(), name)
    library._final_module = llvm.parse_bitcode(bitcode)
    library._finalize_final_module()

    class Target:
        """A target that returns the library instead of reading it."""

        typing_context, get_executable = target.typing_context, target.get_executable

        def codegen(self) -> Any:
            return self

        def unserialize_library(self, _: Any) -> Any:
            return library
    found = numba_compiler.CompileResult._rebuild(Target(), None, *rest)
    return found._replace(target_context=target)


def _reported(name: str, cache: Any) -> Callable[..., Any]:
    """
    Return a function that loads cached machine code of a kernel and reports its first call.

    numba itself first initializes its compiler, which takes longer than loading and is needed only
    without cached machine code.
    """
    prepare_and_load = cache.load_overload
    load = getattr(cache, '_load_overload', prepare_and_load)

    def load_and_report(signature: Any, target: Any) -> Any:
        try:
            found = load(signature, target)
        except Exception:  # noqa: BLE001 numba handles unreadable files
            found = prepare_and_load(signature, target)
        _notice.first_call(name, found is not None)
        return found
    return load_and_report


def _one_at_a_time(save: Callable[..., None]) -> Callable[..., None]:
    """
    Allow one process at a time to write to the folder of the machine code.

    numba reads the index of a kernel, adds a file to it and writes it back.  Two concurrent
    processes may use the same file name, and later load each other's code.
    """
    def save_alone(*arguments: Any) -> None:
        _notice.ends()
        # On a full disk, or one without locks, every run compiles but does not fail.
        with suppress(OSError), open(os.path.join(_FOLDER, 'lock'), 'w') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            save(*arguments)
    return save_alone
