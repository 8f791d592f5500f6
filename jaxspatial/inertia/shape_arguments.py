"""What the constructors of uniform bodies are given: sizes, masses, densities and axes, as arrays."""

from collections.abc import Callable, Container, Mapping
from typing import Any, TypeVar

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Amount, PrecisionName, Scalar, Vector, Vector3
from jaxspatial.inertia import shape_formulas
from jaxspatial.inertia.parts import Parts
from jaxspatial.rotation.matrices import expanded

_Inertia = TypeVar("_Inertia", bound=Parts)


def mass_or_density(name: str, mass: Amount, density: Amount) -> tuple[str, Any]:
    """("mass", mass) or ("density", density), of which exactly one is given."""
    if (mass is None) == (density is None):
        came = "neither" if mass is None else "both"
        raise TypeError(f"{name}: expected either mass or density, got {came}")
    return ("density", density) if mass is None else ("mass", mass)


def made(
    cls: type[_Inertia],
    name: str,
    precision: PrecisionName,
    mass: Amount,
    density: Amount,
    lengths: Mapping[str, Vector | Scalar],
    axis: Vector3 | None = None,
    may_be_zero: Container[str] = (),
    n: int = 1,
) -> _Inertia:
    """The inertia that the formula of this name gives for lengths, or vectors of n lengths, and an axis."""
    kind, amount = mass_or_density(name, mass, density)
    dtype = dtype_of(*lengths.values(), amount, axis)
    given = {kind: expanded(number(amount, f"{name}: {kind}", dtype, may_be_zero=True))}
    for key, x in lengths.items():
        given[key] = _lengths(x, f"{name}: {key}", dtype, n, key in may_be_zero)
    if "inner_radius" in given:
        _require_order(name, given["inner_radius"], given["outer_radius"])
    if axis is not None:
        given["axis"] = check.as_vectors(axis, f"{name}: axis", dtype)
    return cls(*computed(getattr(shape_formulas, name), precision, given, by=kind))


def dtype_of(*values: Any) -> np.dtype | None:
    """That of the first of the values that has one, for all Python numbers; None if none has."""
    leaves = jax.tree.leaves(values, is_leaf=lambda x: isinstance(x, check.StandIn))
    return next((np.dtype(x.dtype) for x in leaves if isinstance(x, check.ARRAYS) and not isinstance(x, float)), None)


def number(x: Scalar, name: str, dtype: np.dtype | None, may_be_zero: bool = False) -> jax.Array:
    return _positive(check.as_float_array(x, name, dtype, held=True), name, may_be_zero)


def _lengths(x: Any, name: str, dtype: np.dtype | None, n: int, may_be_zero: bool) -> jax.Array:
    if n == 1:
        return expanded(number(x, name, dtype, may_be_zero))
    return _positive(check.as_vectors(x, name, dtype, size=n, held=True), name, may_be_zero)


def _positive(x: jax.Array, name: str, may_be_zero: bool) -> jax.Array:
    """Raises ValueError for numbers known to be none; nothing is asked of arrays that may be traced."""
    if isinstance(x, np.ndarray) and ((x < 0).any() or (not may_be_zero and (x == 0).any())):
        expected = "no negative number" if may_be_zero else "a positive number"
        raise ValueError(f"{name}: expected {expected}, got {x}")
    return x


def _require_order(name: str, inner: jax.Array, outer: jax.Array) -> None:
    if isinstance(inner, np.ndarray) and isinstance(outer, np.ndarray) and (inner > outer).any():
        raise ValueError(f"{name}: inner_radius: expected at most outer_radius {outer[..., 0]}, got {inner[..., 0]}")


def computed(
    formula: Callable[..., Any], precision: PrecisionName, given: dict[str, jax.Array], **static: Any
) -> tuple[jax.Array, Any, jax.Array]:
    """(mass, com, central) that a formula gives; without a com of its own zeros, known while tracing."""
    check.require_same_dtype(**given)
    batch = check.common_batch_shape(**{name: x.shape[:-1] for name, x in given.items()})
    if "axis" in given:
        (given["axis"],) = known(shape_formulas.direction, None, given["axis"])
    m, *com, central = known(formula, precision, *given.values(), **static)
    return m.reshape(batch), com[0] if com else np.zeros((*batch, 3), central.dtype), central


def known(formula: Callable[..., Any], precision: PrecisionName, *arrays: jax.Array, **static: Any) -> Any:
    """The formula; of what is known its results are known too, while tracing as well."""
    if not all(isinstance(a, np.ndarray) for a in arrays):
        return formula(precision, *arrays, **static)
    with jax.ensure_compile_time_eval():
        return [np.asarray(x) for x in formula(precision, *arrays, **static)]
