"""The private parts of numba that kernels are compiled, kept and loaded with: nothing else in the package uses any.

`_numba_check` lists them, and refuses a numba that lacks one; then `_numba_public` stands in.
"""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property

import numpy as np
from llvmlite import binding, ir
from numba._dispatcher import compute_fingerprint
from numba.core import cgutils, event, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.typing.typeof import typeof
from numba.extending import intrinsic
from numba.np.numpy_support import from_dtype, map_layout

from dembrick import _file_locks, _kernel_cache
from dembrick._kernel_cache import WAITING, claims_in, renamed
from dembrick._kernel_sources import closure_hash
from dembrick._packaged_kernels import keeps, packaged_kernels


def target() -> tuple[str, str, str]:
    """numba's name of what it compiles for: system, processor, features."""
    return cpu_target.target_context.codegen().magic_tuple()


class _Beginning(event.Listener):
    """Listener that calls a function when something begins."""

    def __init__(self, begun: Callable[[], None]):
        self._begun = begun

    def on_start(self, event) -> None:
        """See numba."""
        self._begun()

    def on_end(self, event) -> None:
        """See numba."""


@contextmanager
def hearing(kinds: tuple[str, ...], begun: Callable[[], None]) -> Iterator[None]:
    """Context in which ``begun`` is called whenever an event of numba of one of these kinds begins."""
    listener = _Beginning(begun)
    for kind in kinds:
        event.register(kind, listener)
    try:
        yield
    finally:
        for kind in kinds:
            event.unregister(kind, listener)


class _Folder:
    """Where the machine code of a kernel is kept: found by its module and the sources of that, not by its path."""

    def __init__(self, function):
        self._stamp = closure_hash(function.__module__)
        self._name = f"{function.__module__}-{function.__code__.co_firstlineno}-{self._stamp}"
        self._py_file = function.__code__.co_filename  # where numba warns of a kernel that it cannot keep

    @classmethod
    def from_function(cls, function, _file):
        """See numba."""
        return cls(function)

    def ensure_cache_path(self):
        """The folder was made when its name was chosen."""

    def get_cache_path(self):
        """See numba."""
        return str(_kernel_cache.CACHE_FOLDER)

    def get_source_stamp(self):
        """Stamp of a source: an edit makes old machine code useless, and gives the file another name as well."""
        return self._stamp

    def get_disambiguator(self):
        """See numba."""
        return self._name


class CacheFile(IndexDataCacheFile):
    """numba's file of one kernel, whose index is read and written again by one process at a time.

    Two processes that compile the same kernel for other arguments would lose an entry, or give two the same number.
    What cannot be written, on a full disk for one, is compiled again by the next run.
    """

    def save(self, key, data):
        """See numba."""
        with suppress(OSError), open(_kernel_cache.CACHE_FOLDER / ".lock", "a") as lock:
            if _file_locks.known():
                with suppress(OSError):  # a disk without locks
                    _file_locks.lock(lock.fileno(), wait=True)  # until the file is closed
            super().save(key, data)


class _Kept(JITCodeLibrary):
    """Machine code out of the cache. What other kernels would take into their own code is parsed if one of them does:
    that took longer than all else that loading a kernel takes."""

    @classmethod
    def _unserialize(cls, codegen, state):
        name, _, (code, taken_in) = state
        self = codegen.create_library(name)
        self.enable_object_caching()
        self._set_compiled_object(code)
        self._taken_in = taken_in
        self._finalize_final_module()
        return self

    def _get_module_for_linking(self):
        if self._shared_module is None:
            self._shared_module = binding.parse_bitcode(self._taken_in)
        return self._shared_module


class _Impl(FunctionCache._impl_class):
    _locator_classes = [_Folder]

    def reduce(self, cres):
        """See numba. The names that the machine code defines are kept beside it."""
        module = cres._asdict()["library"]._get_module_for_linking()
        found = (*module.functions, *module.global_variables)
        return [one.name for one in found if not one.is_declaration], super().reduce(cres)

    def rebuild(self, target_context, kept):
        """See numba, of whose compiler lock nobody else has the code generator meanwhile."""
        (names, payload), codegen = kept, target_context.codegen()
        codegen._engine._defined_symbols.update(names)
        codegen._library_class = _Kept
        try:
            return super().rebuild(target_context, payload)
        finally:
            del codegen._library_class


class ParallelKernelCache(FunctionCache):
    """numba's cache in the package's own folder; what is not there is compiled by one process at a time."""

    _impl_class = _Impl

    def __init__(self, function):
        super().__init__(function)
        self._cache_file = CacheFile(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._claimed: dict = {}

    def load_overload(self, sig, target_context):
        """See numba. Where there is nothing this process has claimed it when it returns."""
        found = self._load(sig, target_context)
        if found is None:
            what = f"{self._impl.filename_base} {sig} {target_context.codegen().magic_tuple()}"
            byte = int.from_bytes(hashlib.sha256(what.encode()).digest()[:4], "big") & _file_locks.MOST
            self._claimed[sig] = byte
            claims = claims_in(_kernel_cache.CACHE_FOLDER)
            if not claims.take(byte):
                with event.trigger_event(WAITING):
                    claims.wait(byte)
            found = self._load(sig, target_context)
        return found

    def _load(self, sig, target_context):
        found = super().load_overload(sig, target_context)
        return self._from_package(sig, target_context) if found is None else found

    def _from_package(self, sig, target_context):
        """Machine code that came with the package, for any processor that has what it needs; None if there is none."""
        package = packaged_kernels()
        if package is None:
            return None
        key = arguments, _, *rest = self._index_key(sig, target_context.codegen())
        stamp, name = self._impl.locator.get_source_stamp(), self._impl.filename_base
        data = IndexDataCacheFile(str(package.folder), name, stamp).load((arguments, package.target, *rest))
        if data is not None and keeps():
            self._cache_file.save(key, data)
        return None if data is None else self._impl.rebuild(target_context, data)

    def _index_key(self, sig, codegen):
        """See numba. Machine code reads a named tuple by the places of its fields, numba's type has their names only
        by the class, which another version of the package may define otherwise."""
        return (*super()._index_key(sig, codegen), _fields(sig))

    def let_go(self, sig) -> None:
        """Let others compile it, or find what was compiled."""
        if sig in self._claimed:
            claims_in(_kernel_cache.CACHE_FOLDER).let_go(self._claimed.pop(sig))


class KernelCache(ParallelKernelCache):
    """The same, but machine code that is found there is loaded as it is.

    numba first prepares for all that could be compiled, which took longer than loading the kernels of a short run.
    A kernel without the memory runtime needs none of it, and where nothing is found the compiler prepares itself.
    """

    def _load(self, sig, target_context):
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
        return self._from_package(sig, target_context) if found is None else found


def _fields(kinds) -> tuple:
    """Names of the fields of all named tuples in numba's types of arguments, at any depth, in order."""
    named = [(kind.fields, _fields(kind.types)) for kind in kinds if isinstance(kind, types.BaseNamedTuple)]
    return (*named, *(_fields(kind.types) for kind in kinds if isinstance(kind, types.Tuple | types.UniTuple)))


def _type_of(value):
    """numba's type of an argument: of an array of numpy's own class, of tuples of them, or of what else there is."""
    if type(value) is np.ndarray:
        return types.Array(from_dtype(value.dtype), value.ndim, map_layout(value), readonly=not value.flags.writeable)
    if isinstance(value, tuple):
        return types.BaseTuple.from_types([_type_of(one) for one in value], type(value))
    return typeof(value)


@contextmanager
def _no_collection() -> Iterator[None]:
    """Within, nobody looks for garbage: a compiler keeps most of what it makes, and looking is a tenth of its work."""
    wanted = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if wanted:
            gc.enable()


class _Called(CPUDispatcher):
    """A function as Python calls it."""

    def typeof_pyval(self, value):
        """See numba, which loads masked arrays to see that an array is none."""
        if not isinstance(value, tuple | np.ndarray):
            return super().typeof_pyval(value)
        found = _type_of(value)
        self._types_active_call.add(found)
        return found

    def _compilation_chain_init_hook(self):
        """See numba, which looks through all installed packages for types that no kernel has."""

    def compile(self, sig):
        """See numba."""
        try:
            with _no_collection():
                return super().compile(sig)
        finally:
            if isinstance(self._cache, ParallelKernelCache):
                self._cache.let_go(sig)


def _compiled(function, cache=KernelCache, **options):
    wanted = {"nopython": True, "boundscheck": None, "error_model": "numpy", **options}
    kernel = _Called(function, targetoptions={"no_cfunc_wrapper": True, **wanted})
    if function.__module__.startswith(f"{__package__}.kernels."):  # what the name of the folder answers for
        kernel._cache = cache(function)  # what ``cache=True`` does
    return kernel


class _Part(JITCodeLibrary):
    """Code that only ever becomes part of other code: it is optimised, and made machine code, there and not by itself.

    numba does both for every function it compiles, together with all that it calls: what is called from a depth of ten
    was optimised ten times, and nobody ever ran nine of them.
    """

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True


class _PartCompiler(Compiler):
    def __init__(self, typingctx, targetctx, _, args, return_type, flags, locals):
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        super().__init__(typingctx, targetctx, _Part(targetctx.codegen(), "part"), args, return_type, flags, locals)


class _Parts(CPUDispatcher):
    """A function as other kernels see it."""

    def add_overload(self, cres):
        """See numba. What was compiled has no entry point, the name under which numba would find it: it gets one."""
        cres, part = cres._replace(entry_point=object()), cres._asdict()["library"]
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [part])
        self.overloads[tuple(cres.signature.args)] = cres


class Kernel:
    """A kernel that Python and other kernels call. numba's dispatcher of it is made when it is first asked for: a run
    that finds its kernels in the cache asks for few."""

    def __init__(self, function, **options):
        self.__name__, self.__qualname__ = function.__name__, function.__qualname__
        self.__module__, self.__doc__ = function.__module__, function.__doc__
        self.py_func = self.__wrapped__ = function
        self._options = options
        self._ready: dict[tuple[bytes, ...], Callable] = {}

    @cached_property
    def called(self):
        """The function as Python calls it."""
        return _compiled(self.py_func, **self._options)

    @cached_property
    def _numba_type_(self):
        """The function as other kernels see it; a weak reference."""
        return types.Dispatcher(self.called)

    def __call__(self, *arguments):
        """Call it from Python."""
        return self.called(*arguments)

    def ready(self, *arguments) -> Callable:
        """See `ready`."""
        prints = tuple(map(compute_fingerprint, arguments))
        if prints not in self._ready:
            self._ready[prints] = self.called.compile(tuple(map(self.called.typeof_pyval, arguments)))
        return self._ready[prints]

    def address(self, *arguments) -> int:
        """See `address`."""
        kinds = tuple(map(self.called.typeof_pyval, arguments))
        self.called.compile(kinds)
        code = self.called.overloads[kinds]._asdict()
        return code["library"].get_pointer_to_function(code["fndesc"].llvm_func_name)


class Inlined(Kernel):
    """A kernel that other kernels take into their own code, and that Python may call as well.

    Other kernels take it as `_Parts`, without the code by which Python calls it, which holds the whole body once more;
    a first run compiles in less than half the time. ``called`` is compiled if Python calls. Not so for a kernel that
    only Python calls, which is better an `entry`.
    """

    @cached_property
    def _part(self):
        wanted = {"nopython": True, "error_model": "numpy", "forceinline": True, **self._options}
        return _Parts(self.py_func, targetoptions=wanted, pipeline_class=_PartCompiler)

    @cached_property
    def _numba_type_(self):
        """The function as other kernels see it; a weak reference."""
        return types.Dispatcher(self._part)

    @cached_property
    def called(self):
        """The function as Python calls it."""
        return _compiled(renamed(self.py_func, f"{self.py_func.__name__}_called"), **self._options)


def _call_at(_, place, first, second, third, fourth):
    """`call_at` for numba: its own convention of a call, to an address."""
    kinds = (first, second, third, fourth)

    def code(context, builder, signature, arguments):
        convention = context.call_conv
        kind = convention.get_function_type(types.int64, kinds)
        callee = builder.inttoptr(arguments[0], kind.as_pointer())
        status, result = convention.call_function(builder, callee, types.int64, kinds, arguments[1:])
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return result

    return types.int64(place, *kinds), code


def _call_law(_, place, move, record, memory, answer):
    """`call_law` for numba: a call by the conventions of C, with the places of the rows."""

    def code(context, builder, signature, arguments):
        rows = [
            cgutils.create_struct_proxy(kind)(context, builder, value=row).data
            for kind, row in zip(signature.args[1:], arguments[1:], strict=True)
        ]
        kind = ir.FunctionType(ir.VoidType(), [row.type for row in rows])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), rows)
        return context.get_dummy_value()

    return types.void(place, move, record, memory, answer), code


def _prefetch(_, array, index, byte):
    """`prefetch` for numba: the instruction of the processor."""

    def code(context, builder, signature, arguments):
        place = builder.gep(context.make_array(signature.args[0])(context, builder, arguments[0]).data, [arguments[1]])
        byte, number = cgutils.voidptr_t, cgutils.int32_t
        place = builder.gep(builder.bitcast(place, byte), [arguments[2]])
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        instruction = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        read, keep, data = number(0), number(3), number(1)
        builder.call(instruction, [place, read, keep, data])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp), code


def inlined(function, **options) -> Inlined:
    """Kernel that other kernels take into their own code; without numba's memory runtime."""
    return Inlined(function, nogil=True, _nrt=False, **options)


def entry(function, **options) -> Kernel:
    """Kernel that Python or a batch enters; without numba's memory runtime."""
    return Kernel(function, nogil=True, _nrt=False, **options)


def parallel(function, **options) -> Kernel:
    """Kernel over threads."""
    return Kernel(function, cache=ParallelKernelCache, parallel=True, **options)


prefetch, call_at, call_law = intrinsic(_prefetch), intrinsic(_call_at), intrinsic(_call_law)
