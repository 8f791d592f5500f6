"""The parts of JAX that may change without notice: all that the library uses of them is imported here.

What reads traces, `engine.graph`, depends in addition on the names and parameters of operations.
"""

from jax.core import ShapedArray as ShapedArray
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
