"""Sums of products in twice the digits, of float64 and over many items, as machine code on CPUs.

XLA has no fused multiply-add to ask for. It splits every factor to find the error of a product, which takes ten times
as many operations. The bits are the same, but where a factor is below tiny / eps: see `transforms.split`.
"""

import functools
import math
from collections.abc import Sequence

import jax
import numpy as np

from jaxspatial.engine import cpu, program
from jaxspatial.engine.program import Aval, Native, Program
from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree.primitives import lower_fun, unsharded
from jaxspatial.numerics.jax_internals import mlir
from jaxspatial.numerics.sums.evaluation import Plan, evaluate, is_simple
from jaxspatial.numerics.sums.primitive import lower_for_cpus, sums_p

# A call of machine code takes 0.3 us. In a loop, ns for an item of a shift and a power: of 32 items 14 and 16, 9 and 13
# as part of XLA's program; of 128 items 5 and 5, 9 and 14; of 1024 items 4 and 4, 7 and 11.
FEWEST = 128


class Sums(Program):
    """The results of a plan for one item. Its bits are those of XLA's way, which rounds each operation by itself."""

    is_wide = True

    @property
    def may_fuse(self) -> bool:
        return False

    def __init__(self, plan: Plan):
        self.plan = plan

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        return evaluate(*arrays, plan=self.plan)

    def outputs(self, avals: Sequence[Aval]) -> list[Aval]:
        limbs = range(1 + self.plan.is_pair)
        return [Aval((len(s.components),), np.float64) for s in self.plan.sums for _ in limbs]


_program_of = functools.lru_cache(maxsize=256)(Sums)


def _lower(context, *arrays, plan: Plan):
    is_double = plan.precision == "compensated" and context.avals_in[0].dtype == np.float64
    is_of_items = not plan.leading and not any(s.reduced for s in plan.sums)
    are_many = floats.is_sized(plan.batch) and math.prod(plan.batch) >= FEWEST
    native = Native.of(context, cpu) if is_double and is_of_items and are_many else None
    if native is None:
        return lower_for_cpus(context, *arrays, plan=plan)
    return unsharded(lower_fun(functools.partial(_run, plan, native), multiple_results=True), context, *arrays)


def _run(plan: Plan, native: Native, *arrays: jax.Array) -> list[jax.Array]:
    """The results, each by a call of its own: XLA leaves out those that nobody reads."""
    results = list[jax.Array]()
    # Also in a program without 64-bit types, which computes some numbers in float64.
    with jax.enable_x64(True):
        for s in plan.sums:
            alone = plan._replace(sums=(s,))
            if is_simple(plan, s, arrays):
                results += evaluate(*arrays, plan=alone)
            else:
                results += program.run(_program_of(alone._replace(batch=(1,))), len(plan.batch), native, *arrays)
    return results


mlir.register_lowering(sums_p, _lower, platform="cpu")
