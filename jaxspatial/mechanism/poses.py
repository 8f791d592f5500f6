"""Known poses and numbers of parts, in float64: exact where frames coincide."""

from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.parts import Body, Frame, Joint
from jaxspatial.spatial import RigidTransform, act


def known(x: Any):
    if isinstance(x, Tracer):
        raise TypeError(
            "Mechanism.build: expected known numbers (NumPy), got data that is traced; build with known ones, and put "
            "data in their place with Mechanism.replace (results within jax.ensure_compile_time_eval() are known)"
        )
    return np.asarray(x, np.float64)


def identity():
    return RigidTransform.identity(dtype=np.float64)


def or_identity(part: Joint | Frame, name: str) -> RigidTransform:
    X = getattr(part, name)
    if X is None:
        return identity()
    check_single(part, name, RigidTransform)
    return jax.tree.map(known, X)


def check_single(part: Body | Joint | Frame, name: str, kind: type[RigidTransform | SpatialInertia]):
    x = getattr(part, name)
    if not isinstance(x, kind) or x.batch_shape:
        came = f"a batch of shape {x.batch_shape}" if isinstance(x, kind) else type(x).__name__
        raise TypeError(f"{type(part).__name__} {part.name!r}: {name}: expected a single {kind.__name__}, got {came}")


def is_identity(X: RigidTransform):
    return not X.translation.any() and (X.rotation.entries == np.eye(3).ravel()).all()


def composed(X_AB: RigidTransform, X_BC: RigidTransform) -> RigidTransform:
    if is_identity(X_AB) or is_identity(X_BC):
        return X_BC if is_identity(X_AB) else X_AB
    return jax.tree.map(known, X_AB @ X_BC)


def act_unless_identity(X_AB: RigidTransform, M_BBo_B: SpatialInertia) -> SpatialInertia:
    """M_BAo_A of M_BBo_B, in float64: bit for bit what it was where A is B."""
    M = jax.tree.map(known, M_BBo_B)
    return M if is_identity(X_AB) else jax.tree.map(known, act(X_AB, M))
