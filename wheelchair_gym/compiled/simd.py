"""Many beams at once against one line, as vectors; and the bits of numbers, for loops over them."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.compiled.kernel import inlined

SIMD_WIDTH = 32  # beams that are compared at once


@intrinsic
def _rasterize_block(
    typingctx: Any, out: Any, cosine: Any, sine: Any, a: Any, b: Any, start: Any, i0: Any, i1: Any
) -> Any:
    """out[i] = max(out[i], a cos[i] + b sin[i]) for LANES beams from start on, if i0 <= i < i1.

    Written as vectors, since intervals are short: a loop would spend its time in its remainder.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        number = ir.IntType(32)
        floats = ir.VectorType(ir.FloatType(), SIMD_WIDTH)
        numbers = ir.VectorType(number, SIMD_WIDTH)

        def place(k: int) -> Any:
            array = context.make_array(signature.args[k])(context, builder, args[k])
            return builder.bitcast(builder.gep(array.data, [args[5]]), floats.as_pointer())

        def spread(value: Any, kind: Any) -> Any:
            blank = ir.Constant(kind, ir.Undefined)
            one = builder.insert_element(blank, value, ir.Constant(number, 0))
            return builder.shuffle_vector(one, blank, ir.Constant(numbers, [0] * SIMD_WIDTH))

        def count(k: int) -> Any:
            return spread(builder.trunc(builder.sub(args[k], args[6]), number), numbers)

        old, cos, sin = (builder.load(place(k), align=4) for k in (0, 1, 2))
        new = builder.fadd(
            builder.fmul(spread(args[3], floats), cos), builder.fmul(spread(args[4], floats), sin)
        )
        lane = builder.add(count(5), ir.Constant(numbers, list(range(SIMD_WIDTH))))
        inside = builder.icmp_unsigned("<", lane, count(7))  # a negative lane is a huge one
        better = builder.and_(inside, builder.fcmp_ordered(">", new, old))
        builder.store(builder.select(better, new, old), place(0), align=4)
        return context.get_dummy_value()

    index = types.int64
    return types.void(out, cosine, sine, types.float32, types.float32, index, index, index), codegen


_rasterize_vector = cast("Callable[..., None]", _rasterize_block)


@inlined
def rasterize_line(
    out: Floats, cosine: Floats, sine: Floats, a: np.float32, b: np.float32, i0: int, i1: int
) -> None:
    """Nearest of what beams i0..i1 saw and the line whose inverse range is a cos + b sin."""
    last = out.shape[0] - SIMD_WIDTH
    if last < 0:
        for i in range(i0, i1):
            inverse = a * cosine[i] + b * sine[i]
            out[i] = inverse if inverse > out[i] else out[i]
    else:
        for i in range(i0, i1, SIMD_WIDTH):
            _rasterize_vector(out, cosine, sine, a, b, min(i, last), i0, i1)


def _bitcast(kind: Any, to: Any) -> Any:
    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(to))

    return intrinsic(lambda typingctx, value: (to(kind), lower))


# The smallest of numbers that are not negative has the smallest bits, which vectors find.
bits_of_double = cast("Callable[[float], np.int64]", _bitcast(types.float64, types.int64))
double_of_bits = cast("Callable[[np.int64], float]", _bitcast(types.int64, types.float64))
bits_of_float = cast("Callable[[Any], np.uint32]", _bitcast(types.float32, types.uint32))
