"""Primitives whose programs are written when they are lowered: then it is known for which machine."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax import Array
from jax.interpreters import mlir

from jaxspatial.arithmetic.errorfree import contraction

_NO_MESH = jax.sharding.AbstractMesh((), ())


def rule(function: Callable[..., Sequence[Array]]) -> Callable[..., Any]:
    """The lowering rule of a primitive: `function(*arrays, contracted, **parameters)` returns a list of arrays.

    contracted(dtype): whether errors of products may be left to contraction. Traced without shardings and manual axes
    in the types: the arithmetic is elementwise, for the compiler to split. (With them, every constant and index made on
    the way would have to be sharded by hand.)
    """
    lower = mlir.lower_fun(function, multiple_results=True)

    def lowered(context: Any, *arrays: Any, **parameters: Any) -> Any:
        contracted = functools.partial(contraction.is_used, context)
        with jax.sharding.use_abstract_mesh(_NO_MESH):
            plain = [jax.core.ShapedArray(a.shape, a.dtype) for a in context.avals_in]
            return lower(context.replace(avals_in=plain), *arrays, contracted=contracted, **parameters)

    return lowered
