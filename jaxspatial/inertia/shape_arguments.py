"""What the constructors of uniform bodies are given: sizes, masses, densities and axes, as arrays."""

import inspect
from collections.abc import Callable, Container, Mapping
from typing import Any, TypedDict, TypeVar, Unpack

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Amount, PrecisionName, Scalar, Vector, Vector3
from jaxspatial.inertia import shape_formulas
from jaxspatial.inertia.parts import Parts
from jaxspatial.rotation.matrices import expanded

_Inertia = TypeVar("_Inertia", bound=Parts)
_BY_NAME = inspect.Parameter.KEYWORD_ONLY


class Given(TypedDict, total=False):
    """
        mass: (*batch,) kg; exactly one of mass and density is given.
        density: (*batch,) kg/m3, of a shell kg/m2.
        precision: name of a precision; None takes the default.

    Returns:
        The inertia over the common batch; about the centre of mass, the origin P, where nothing else is said.

    Raises:
        TypeError: both or neither of mass and density are given, or dtypes differ.
        ValueError: a known number is negative, a length 0 that may not be, an inner radius above the outer one; or
            shapes do not fit.
    """

    mass: Amount
    density: Amount
    precision: PrecisionName


def completed(cls: type[_Inertia]) -> type[_Inertia]:
    """Says for `help`, in docstring and signature of each constructor, what all take and do alike: see `Given`."""
    named = [inspect.Parameter(name, _BY_NAME, default=None, annotation=x) for name, x in Given.__annotations__.items()]
    constructors: list[Any] = [x for x in vars(cls).values() if isinstance(x, classmethod)]
    for function in (x.__func__ for x in constructors):
        *own, last = inspect.signature(function).parameters.values()
        if last.kind is last.VAR_KEYWORD:
            told, _, error = inspect.cleandoc(function.__doc__ or "").partition("\n\nError: ")
            error = error or "as of all of `Shapes`."
            function.__doc__ = f"{told}\n{inspect.cleandoc(Given.__doc__ or '')}\n\nError: {error}"
            function.__signature__ = inspect.signature(function).replace(parameters=[*own, *named])
    return cls


def single_amount(
    name: str, mass: Amount = None, density: Amount = None, precision: PrecisionName = None
) -> tuple[str, Any, PrecisionName]:
    """("mass", mass) or ("density", density), of which exactly one is given, and the precision."""
    if (mass is None) == (density is None):
        came = "neither" if mass is None else "both"
        raise TypeError(f"{name}: expected either mass or density, got {came}")
    return ("density", density, precision) if mass is None else ("mass", mass, precision)


def made(
    cls: type[_Inertia],
    name: str,
    lengths: Mapping[str, Vector | Scalar],
    axis: Vector3 | None = None,
    may_be_zero: Container[str] = (),
    n: int = 1,
    **amounts: Unpack[Given],
) -> _Inertia:
    """The inertia that the formula of this name gives for lengths, or vectors of n lengths, and an axis."""
    kind, amount, precision = single_amount(name, **amounts)
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
    """That of the first array of floating point among the values, for all Python numbers; None where there is none."""
    leaves: list[Any] = jax.tree.leaves(values, is_leaf=lambda x: isinstance(x, check.StandIn))
    return check.floating_dtype(*leaves)


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
