"""What a caller passes to an algorithm, checked in one place: a mechanism, and what goes with it, by its name."""

from collections.abc import Iterable
from typing import Any, cast

import jax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers.components import as_array, is_components, is_zero
from jaxspatial.dynamics.along import Array
from jaxspatial.mechanism import Mechanism
from jaxspatial.spatial import SpatialForce

# SpatialForces by name of a frame, see `inverse_dynamics`.
ExternalForces = dict[str, SpatialForce] | None
Wrenches = dict[int, tuple[Array | None, Array | None]]  # (tau, f) by the number of a frame, None for a known zero
Frames = int | tuple[int, ...] | None  # by number, None for all bodies


def checked_mechanism(operation: str, mechanism: object) -> Mechanism:
    if not isinstance(mechanism, Mechanism):
        raise TypeError(f"{operation}: expected a Mechanism first, got {type(mechanism).__name__}")
    return mechanism


def checked(operation: str, mechanism: object, **given: Any) -> tuple[Any, ...]:
    """What is given, by name: q, q0 and q1 as arrays (*batch, nq), v, vdot and tau as (*batch, nv), a time dt as
    (*batch, 1), with a dtype in common and batch shapes that broadcast; external_forces as Wrenches, frames by their
    numbers. Others, and None for an array, as they are."""
    mechanism = checked_mechanism(operation, mechanism)
    arrays = _arrays(operation, mechanism, {name: x for name, x in given.items() if x is not None})
    forces = _by_frame(operation, mechanism, given.get("external_forces") or {})
    named = {f"external_forces[{mechanism.frame_names[i]!r}]": F for i, F in forces.items()}
    data = mechanism.first_data
    check.require_same_dtype(**arrays, **named, **({} if data is None else {"mechanism": data}))
    batches = {name: F.batch_shape for name, F in named.items()}
    check.common_batch_shape(**{name: x.shape[:-1] for name, x in arrays.items()}, **batches)
    wrenches = {i: tuple(_none_if_zero(x, F.batch_shape) for x in F.vectors) for i, F in forces.items()}
    found: dict[str, Any] = {"external_forces": wrenches} if "external_forces" in given else {}
    if given.get("frames") is not None:
        found["frames"] = _frame_numbers(f"{operation}: frames", mechanism, given["frames"])
    return tuple({**given, **arrays, **found}.values())


def _arrays(operation: str, mechanism: Mechanism, given: dict[str, Any]) -> dict[str, jax.Array]:
    sizes = dict.fromkeys(("q", "q0", "q1"), mechanism.nq) | dict.fromkeys(("v", "vdot", "tau"), mechanism.nv)
    # Lists of numbers take the dtype of an array beside them.
    dtype = check.floating_dtype(*(x for name, x in given.items() if name in sizes), mechanism.first_data)
    found = {
        name: check.as_vectors(x, f"{operation}: {name}", dtype, sizes[name])
        for name, x in given.items()
        if name in sizes
    }
    if "dt" in given:
        dtype = next(iter(found.values())).dtype
        found["dt"] = check.as_float_array(given["dt"], f"{operation}: dt", dtype)[..., None]
    return found


def _by_frame(operation: str, mechanism: Mechanism, forces: Any) -> dict[int, SpatialForce]:
    what = f"{operation}: external_forces"
    if not isinstance(forces, dict):
        raise TypeError(f"{what}: expected SpatialForces in a dict by name of a frame, got {type(forces).__name__}")
    by_name = cast(dict[str, Any], forces)
    found = {_frame_number(what, mechanism, name): F for name, F in by_name.items()}
    for i, F in found.items():
        if not isinstance(F, SpatialForce):
            name = mechanism.frame_names[i]
            raise TypeError(f"{what}[{name!r}]: expected a SpatialForce, got {type(F).__name__}")
    return check.narrowed(found)


def _none_if_zero(x: Any, batch_shape: tuple[int, ...]) -> Any:
    """An array, but for Components of zeros, of which nothing is to be left in a program."""
    return None if is_components(x) and is_zero(x) else as_array(x, batch_shape)


def _frame_number(what: str, mechanism: Mechanism, name: str) -> int:
    return mechanism.topology.index(mechanism.frame_names, name, what)


def _frame_numbers(what: str, mechanism: Mechanism, names: Any) -> int | tuple[int, ...]:
    if isinstance(names, str):
        return _frame_number(what, mechanism, names)
    if not isinstance(names, Iterable):
        raise TypeError(f"{what}: expected the name of a frame, or a sequence of names, got {names!r}")
    found = tuple(_frame_number(what, mechanism, name) for name in cast(Iterable[str], names))
    if not found:
        raise ValueError(f"{what}: expected at least one name, got none")
    return found
