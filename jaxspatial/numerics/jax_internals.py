"""The parts of JAX that may change without notice: all that the library uses of them is imported here.

Some files depend in addition on what stands behind these names:

- `engine.graph` and `engine.xla` on the names and parameters of the operations of a trace,
- `engine.cpu` on version 0.3 of XLA's foreign function interface, and on the attributes by which XLA splits calls over
  devices; `engine.cuda` on XLA's call for kernels in PTX,
- `engine.program`, `engine.derivatives`, `numerics.errorfree.primitives` and `numerics.numbers.rounded` on shardings
  and manual axes in types of arrays, on what a lowering rule is given, on the rule for dead code, and on the mark of
  functions that are operations.
"""

from collections.abc import Callable

import jax
from jax.core import ShapedArray as ShapedArray
from jax.core import eval_context as eval_context
from jax.experimental.custom_partitioning import custom_partitioning as custom_partitioning
from jax.experimental.xla_metadata import set_xla_metadata as set_xla_metadata  # pyright: ignore: it has no stub
from jax.extend.core import ClosedJaxpr as ClosedJaxpr
from jax.extend.core import Literal as Literal
from jax.extend.core import Primitive as Primitive
from jax.extend.core import jaxpr_as_fun as jaxpr_as_fun
from jax.extend.mlir import ir as ir
from jax.extend.mlir.dialects import stablehlo as stablehlo
from jax.interpreters import ad as ad
from jax.interpreters import batching as batching
from jax.interpreters import mlir as mlir
from jax.interpreters import partial_eval as partial_eval


def def_linearization(primitive, tangent: Callable) -> None:
    """How JAX linearizes a primitive of one result for a pull-back: tangent(result, primals, tangents) is linear.

    Without it JAX traces the jvp of each operation, and takes apart what is linear in it, so that pull-backs take about
    a tenth longer to trace. It does so in versions whose conventions are unknown here.
    """
    version = jax.__version_info__[:2]
    if not (0, 10) <= version <= (0, 12):
        return
    # From 0.11 on there are residuals of a second kind, of which there are none.
    more = () if version == (0, 10) else (None,)

    def linearized(_, is_moving, *primals):
        result = primitive.bind(*primals)

        def of_tangents(residuals, *tangents):
            return tangent(result, residuals, tangents[len(more) :])

        return result, any(is_moving), primals, *more, of_tangents

    from jax._src.interpreters.ad import primitive_linearizations

    primitive_linearizations[primitive] = linearized


def held_weakly(cls: type) -> None:
    """JAX keeps the last 2048 parameters of primitives that it traced; those of this class only as long as others do,
    in versions that can."""
    from jax._src import util

    getattr(util, "weakref_cache_key_types", set()).add(cls)
