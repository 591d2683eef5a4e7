"""The one decorator of the compiled kernels (in four strengths)."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from types import FunctionType

import numba
import numpy as np
from llvmlite import ir
from numba import get_num_threads, prange
from numba._dispatcher import compute_fingerprint
from numba.core import cgutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.core.typing.typeof import typeof
from numba.extending import intrinsic
from numba.np.numpy_support import from_dtype, map_layout

from dembrick._kernel_cache import KernelCache, ParallelKernelCache

__all__ = [
    "address",
    "call_at",
    "compute_fingerprint",
    "get_num_threads",
    "jit",
    "jit_parallel",
    "jit_sum",
    "prange",
    "ready",
]

# A product and a sum may be rounded once instead of twice (a fused multiply-add): no result gets worse, what is not a
# number stays so, and the order of a sum is as written. All else that is called fast math is left alone: it reorders
# sums, or takes it that NaN and infinity never come, and a run lives by its NaN guard.
FLOATS = {"contract"}


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


def _compiled(function, cache=KernelCache, fastmath=FLOATS, **options):
    wanted = {"nopython": True, "boundscheck": None, "error_model": "numpy", "fastmath": fastmath, **options}
    kernel = _Called(function, targetoptions={"no_cfunc_wrapper": True, **wanted})
    if function.__module__.startswith(f"{__package__}.kernels."):  # what the name of the folder answers for
        kernel._cache = cache(function)  # what ``cache=True`` does
    return kernel


def renamed(function, name: str):
    """A copy of a Python function under another name: compiled in another way, it must not share a cache entry."""
    copy = FunctionType(function.__code__, function.__globals__, name, function.__defaults__, function.__closure__)
    copy.__qualname__, copy.__doc__, copy.__module__ = name, function.__doc__, function.__module__
    return copy


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
        """What Python calls."""
        return _compiled(self.py_func, **self._options)

    @cached_property
    def _numba_type_(self):
        """What other kernels see; a weak reference."""
        return numba.types.Dispatcher(self.called)

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

    def __init__(self, function, **options):
        super().__init__(function, **{"fastmath": FLOATS, **options})

    @cached_property
    def _part(self):
        wanted = {"nopython": True, "error_model": "numpy", "forceinline": True, **self._options}
        return _Parts(self.py_func, targetoptions=wanted, pipeline_class=_PartCompiler)

    @cached_property
    def _numba_type_(self):
        """What other kernels see; a weak reference."""
        return numba.types.Dispatcher(self._part)

    @cached_property
    def called(self):
        """What Python calls."""
        return _compiled(renamed(self.py_func, f"{self.py_func.__name__}_called"), **self._options)


def _inlined(function, **options):
    return function if numba.config.DISABLE_JIT else Inlined(function, nogil=True, _nrt=False, **options)


def jit(function):
    """Compile lazily, cached on disk.

    Without numba's memory runtime nothing can be allocated in a kernel, and no array is reference-counted in its inner
    loop; inlined, nothing is copied for a call. Together that made a step of the lab scene five times faster. Python's
    lock is let go of, so that threads can share a batch.
    """
    return _inlined(function)


def jit_sum(function):
    """The same for a sum whose terms may be added in any order, and so several at once; no block must move by it."""
    return _inlined(function, fastmath=FLOATS | {"reassoc"})


def entry(function):
    """The same for a loop that Python or a batch enters: compiled once, not inlined into every caller."""
    return function if numba.config.DISABLE_JIT else Kernel(function, nogil=True, _nrt=False)


def ready(kernel, *arguments) -> Callable:
    """The machine code of an `entry` for arguments of these types, compiled or out of the cache: what to call instead.

    Whoever calls the kernel itself has the types of all arguments found at every call, which takes 8 us for the 70
    arrays of a search, ten times as long as unpacking them. What is called here takes them for known: where an array
    has another data type, layout or number of dimensions it ends the process, or reads what is not there.
    """
    return kernel.ready(*arguments) if isinstance(kernel, Kernel) else kernel


def address(kernel, *arguments) -> int | Callable:
    """Where the machine code of an `entry` for arguments of these types lies in this process, for `call_at`."""
    return kernel.address(*arguments) if isinstance(kernel, Kernel) else kernel


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


def call_at(place, *arguments):
    """Call the `entry` of four arguments, and one integer that it returns, whose code lies at that `address`.

    Its code does not become part of the caller's: it is compiled once for all loops that call it. Nobody checks that
    the arguments are of the types for which the address was asked.
    """
    return place(*arguments)


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


def prefetch(array, index, byte) -> None:
    """Have the line of the cache with a byte of one entry of an array (one-dimensional) on its way before it is needed.

    It is no error if there is no such entry.
    """


if not numba.config.DISABLE_JIT:
    prefetch, call_at = intrinsic(_prefetch), intrinsic(_call_at)


def jit_parallel(function):
    """The same for a loop over threads (``prange``); it compiles for much longer, so only large scenes call for it."""
    return function if numba.config.DISABLE_JIT else Kernel(function, cache=ParallelKernelCache, parallel=True)
