"""What operations ask of their arguments."""

from collections.abc import Callable, Iterable
from typing import Any, NoReturn, TypeVar

import jax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.quantity import Quantity, require_alike
from jaxspatial.arithmetic.types import PrecisionName, Vector3

_Kind = TypeVar("_Kind", bound=Quantity)


def refuse(operation: str, expected: str, x: object) -> NoReturn:
    raise TypeError(f"{operation}: expected {expected}, got {type(x).__name__}")


def require_kind(x: object, kind: type, name: str, place: str = "") -> None:
    if not isinstance(x, kind):
        refuse(name, f"a {kind.__name__}{place}", x)


def require_no_w(X_P_E: Quantity, w: Vector3 | None, operation: str = "shift") -> None:
    """Only a SpatialAcceleration needs the angular velocity; anywhere else it is a mistake."""
    if w is not None:
        raise TypeError(f"{operation}: w is for a SpatialAcceleration, not for a {type(X_P_E).__name__}")


def require_w(A_P_E: Quantity, w: Vector3 | None, operation: str = "shift") -> jax.Array:
    """The angular velocity of the body, without which an acceleration does not move."""
    if w is None:
        raise TypeError(
            f"{operation}: expected w, the angular velocity of the body, (*batch, 3), for a SpatialAcceleration"
        )
    given = check.as_vectors(w, f"{operation}: w", A_P_E.dtype)
    require_alike(SpatialAcceleration=A_P_E, w=given)
    return given


def shift_by(law: Callable[..., Iterable[Any]], X_P_E: _Kind, precision: PrecisionName, **by: Vector3) -> _Kind:
    """A formula over the parts of X and the named vectors that shift it; the result of the kind of X."""
    given = {name: check.as_vectors(x, f"shift: {name}", X_P_E.dtype) for name, x in by.items()}
    require_alike(**{type(X_P_E).__name__: X_P_E, **given})
    return X_P_E.with_vectors(law(precision, *X_P_E.vectors, *given.values()))
