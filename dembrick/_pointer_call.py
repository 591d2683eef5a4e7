"""Call a function by its address from a kernel: that of a law of the user's own, which no kernel is compiled with.

So one machine code serves all such laws, and the cache of the kernels never holds one. By public means of numba.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def _call_law(_, place, move, record, memory, answer):
    """`call_law` for numba: a call by the conventions of C."""

    def code(context, builder, signature, arguments):
        kinds = signature.args[1:]
        rows = [
            cgutils.create_struct_proxy(kind)(context, builder, value=row).data
            for kind, row in zip(kinds, arguments[1:], strict=True)
        ]
        kind = ir.FunctionType(ir.VoidType(), [row.type for row in rows])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), rows)
        return context.get_dummy_value()

    return types.void(place, move, record, memory, answer), code


compiled_call = intrinsic(_call_law)
