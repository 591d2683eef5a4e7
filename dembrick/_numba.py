"""Use of numba's private API for compiling, caching and loading kernels; no other module of the package uses it.

`_numba_check` lists the private names and refuses a numba that lacks one; then `_numba_public` is used instead.
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
    """numba's description of its compilation target: system, processor, features."""
    return cpu_target.target_context.codegen().magic_tuple()


class _Beginning(event.Listener):
    """Listener that calls a function at the start of an event."""

    def __init__(self, begun: Callable[[], None]):
        self._begun = begun

    def on_start(self, event) -> None:
        """Overrides numba's method."""
        self._begun()

    def on_end(self, event) -> None:
        """Overrides numba's method."""


@contextmanager
def hearing(kinds: tuple[str, ...], begun: Callable[[], None]) -> Iterator[None]:
    """Context in which ``begun`` is called at the start of every numba event of one of these kinds."""
    listener = _Beginning(begun)
    for kind in kinds:
        event.register(kind, listener)
    try:
        yield
    finally:
        for kind in kinds:
            event.unregister(kind, listener)


class _Folder:
    """Location of a kernel's machine code, which depends on its module and sources, but not on its path."""

    def __init__(self, function):
        self._stamp = closure_hash(function.__module__)
        self._name = f"{function.__module__}-{function.__code__.co_firstlineno}-{self._stamp}"
        self._py_file = function.__code__.co_filename  # named in numba's warning about a kernel that it cannot cache

    @classmethod
    def from_function(cls, function, _file):
        """Overrides numba's method."""
        return cls(function)

    def ensure_cache_path(self):
        """No effect: the folder was made when its name was chosen."""

    def get_cache_path(self):
        """Overrides numba's method."""
        return str(_kernel_cache.CACHE_FOLDER)

    def get_source_stamp(self):
        """Stamp of a source: an edit invalidates old machine code, and also changes the name of the file."""
        return self._stamp

    def get_disambiguator(self):
        """Overrides numba's method."""
        return self._name


class CacheFile(IndexDataCacheFile):
    """numba's file of one kernel, with its index updated by one process at a time.

    Otherwise two processes that compile a kernel for different arguments could lose an entry, or use one number twice.
    If writing fails, as on a full disk, the next run compiles the kernel again.
    """

    def save(self, key, data):
        """Overrides numba's method."""
        with suppress(OSError), open(_kernel_cache.CACHE_FOLDER / ".lock", "a") as lock:
            if _file_locks.known():
                with suppress(OSError):  # a disk without locks
                    _file_locks.lock(lock.fileno(), wait=True)  # until the file is closed
            super().save(key, data)


class _Kept(JITCodeLibrary):
    """Machine code from the cache. Bitcode for inlining into other kernels is parsed only on demand: that took longer
    than everything else in loading a kernel."""

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
        """Overrides numba's method: also stores the names that the machine code defines."""
        module = cres._asdict()["library"]._get_module_for_linking()
        found = (*module.functions, *module.global_variables)
        return [one.name for one in found if not one.is_declaration], super().reduce(cres)

    def rebuild(self, target_context, kept):
        """Overrides numba's method; numba's compiler lock protects the code generator meanwhile."""
        (names, payload), codegen = kept, target_context.codegen()
        codegen._engine._defined_symbols.update(names)
        codegen._library_class = _Kept
        try:
            return super().rebuild(target_context, payload)
        finally:
            del codegen._library_class


class ParallelKernelCache(FunctionCache):
    """numba's cache in the package's own folder; a missing kernel is compiled by one process at a time."""

    _impl_class = _Impl

    def __init__(self, function):
        super().__init__(function)
        self._cache_file = CacheFile(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._claimed: dict = {}

    def load_overload(self, sig, target_context):
        """Overrides numba's method. If nothing is found, this process has the claim to compile on return."""
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
        """Machine code that came with the package and suits this processor; None if there is none."""
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
        """Overrides numba's method: adds field names of named tuples. Machine code accesses their fields by position,
        but the numba type has field names only through the class, which may differ in another version of the
        package."""
        return (*super()._index_key(sig, codegen), _fields(sig))

    def let_go(self, sig) -> None:
        """Release the claim, so that others can compile or find the result."""
        if sig in self._claimed:
            claims_in(_kernel_cache.CACHE_FOLDER).let_go(self._claimed.pop(sig))


class KernelCache(ParallelKernelCache):
    """The same, but machine code from the cache is loaded without preparation of the compiler.

    numba's preparation took longer than loading the kernels of a short run. A kernel without the memory runtime does
    not need it to be loaded, and if nothing is found the compiler prepares itself.
    """

    def _load(self, sig, target_context):
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
        return self._from_package(sig, target_context) if found is None else found


def _fields(kinds) -> tuple:
    """Field names of all named tuples in numba types of arguments, at any depth, in order."""
    named = [(kind.fields, _fields(kind.types)) for kind in kinds if isinstance(kind, types.BaseNamedTuple)]
    return (*named, *(_fields(kind.types) for kind in kinds if isinstance(kind, types.Tuple | types.UniTuple)))


def _type_of(value):
    """numba's type of an argument; fast for plain numpy arrays and tuples of them."""
    if type(value) is np.ndarray:
        return types.Array(from_dtype(value.dtype), value.ndim, map_layout(value), readonly=not value.flags.writeable)
    if isinstance(value, tuple):
        return types.BaseTuple.from_types([_type_of(one) for one in value], type(value))
    return typeof(value)


@contextmanager
def _no_collection() -> Iterator[None]:
    """Context without garbage collection, which took 10% of the compiler's time to free next to nothing."""
    wanted = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if wanted:
            gc.enable()


class _Called(CPUDispatcher):
    """Dispatcher of a kernel for calls from Python."""

    def typeof_pyval(self, value):
        """Overrides numba's method, which loads masked arrays to test for them."""
        if not isinstance(value, tuple | np.ndarray):
            return super().typeof_pyval(value)
        found = _type_of(value)
        self._types_active_call.add(found)
        return found

    def _compilation_chain_init_hook(self):
        """Overrides numba's method with nothing: it searches all installed packages for types that no kernel uses."""

    def compile(self, sig):
        """Overrides numba's method."""
        try:
            with _no_collection():
                return super().compile(sig)
        finally:
            if isinstance(self._cache, ParallelKernelCache):
                self._cache.let_go(sig)


def _compiled(function, cache=KernelCache, **options):
    wanted = {"nopython": True, "boundscheck": None, "error_model": "numpy", **options}
    kernel = _Called(function, targetoptions={"no_cfunc_wrapper": True, **wanted})
    if function.__module__.startswith(f"{__package__}.kernels."):  # modules covered by the hash in the folder's name
        kernel._cache = cache(function)  # as ``cache=True`` does
    return kernel


class _Part(JITCodeLibrary):
    """Code that is only inlined into other code; it is optimised and compiled there and not by itself.

    numba does both for every compiled function, including all that it calls: a function at a call depth of ten was
    optimised ten times, and nine results were never executed.
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
    """Dispatcher of a kernel for calls from other kernels."""

    def add_overload(self, cres):
        """Overrides numba's method. Parts have no entry point, by which numba finds them, so they are given one."""
        cres, part = cres._replace(entry_point=object()), cres._asdict()["library"]
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [part])
        self.overloads[tuple(cres.signature.args)] = cres


class Kernel:
    """A kernel that Python and other kernels call. Its numba dispatcher is made on first use: a run that finds its
    kernels in the cache uses few."""

    def __init__(self, function, **options):
        self.__name__, self.__qualname__ = function.__name__, function.__qualname__
        self.__module__, self.__doc__ = function.__module__, function.__doc__
        self.py_func = self.__wrapped__ = function
        self._options = options
        self._ready: dict[tuple[bytes, ...], Callable] = {}

    @cached_property
    def called(self):
        """The dispatcher for calls from Python."""
        return _compiled(self.py_func, **self._options)

    @cached_property
    def _numba_type_(self):
        """The type for calls from other kernels; a weak reference."""
        return types.Dispatcher(self.called)

    def __call__(self, *arguments):
        """Call the kernel from Python."""
        return self.called(*arguments)

    def ready(self, *arguments) -> Callable:
        """See `_jit.ready`."""
        prints = tuple(map(compute_fingerprint, arguments))
        if prints not in self._ready:
            self._ready[prints] = self.called.compile(tuple(map(self.called.typeof_pyval, arguments)))
        return self._ready[prints]

    def address(self, *arguments) -> int:
        """See `_jit.address`."""
        kinds = tuple(map(self.called.typeof_pyval, arguments))
        self.called.compile(kinds)
        code = self.called.overloads[kinds]._asdict()
        return code["library"].get_pointer_to_function(code["fndesc"].llvm_func_name)


class Inlined(Kernel):
    """A kernel that is inlined into other kernels, and that Python may call as well.

    Other kernels use it as `_Parts`, without the wrapper for Python, which contains the whole body again; this more
    than halves the compile time of a first run. ``called`` is compiled on a call from Python. A kernel that only Python
    calls should be an `entry` instead.
    """

    @cached_property
    def _part(self):
        wanted = {"nopython": True, "error_model": "numpy", "forceinline": True, **self._options}
        return _Parts(self.py_func, targetoptions=wanted, pipeline_class=_PartCompiler)

    @cached_property
    def _numba_type_(self):
        """The type for calls from other kernels; a weak reference."""
        return types.Dispatcher(self._part)

    @cached_property
    def called(self):
        """The dispatcher for calls from Python."""
        return _compiled(renamed(self.py_func, f"{self.py_func.__name__}_called"), **self._options)


def _call_at(_, place, first, second, third, fourth):
    """`call_at` for numba: a call with numba's calling convention, to an address."""
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
    """`call_law` for numba: a call with the C calling convention, with pointers to the rows."""

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
    """`prefetch` for numba: the processor's instruction."""

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
    """Kernel that is inlined into other kernels; without numba's memory runtime."""
    return Inlined(function, nogil=True, _nrt=False, **options)


def entry(function, **options) -> Kernel:
    """Kernel that is called from Python or by a batch; without numba's memory runtime."""
    return Kernel(function, nogil=True, _nrt=False, **options)


def parallel(function, **options) -> Kernel:
    """Kernel with a parallel loop."""
    return Kernel(function, cache=ParallelKernelCache, parallel=True, **options)


prefetch, call_at, call_law = intrinsic(_prefetch), intrinsic(_call_at), intrinsic(_call_law)
