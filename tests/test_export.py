"""Programs that take and return any public type are exported, written to bytes, read and called again."""

import enum
import inspect

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics import closed_loops, composite_bodies, linearization
from jaxspatial.spatial import wrench


def _ones(*shape):
    return jnp.ones(shape, jnp.float32)


def _inertia():
    return js.SpatialInertia(_ones(2), _ones(2, 3), _ones(2, 6))


def _derivatives(kind):
    return kind(*(_ones(2, 2) * i for i in (1, 2, 3)))


# One of each type whose objects are data.
EXAMPLES = {
    "AppliedForces": lambda: js.AppliedForces(
        ["left", "right"], js.SpatialForce(_ones(4, 2, 3), _ones(4, 2, 3)), _ones(2, 3), "frame"
    ),
    "ArticulatedInertia": lambda: js.ArticulatedInertia.from_spatial_inertia(_inertia()),
    "CentralAxis": lambda: js.central_axis(js.SpatialForce(_ones(2, 3), _ones(2, 3))),
    "ConvexStep": lambda: js.ConvexStep(
        _ones(2), _ones(2), *(js.SpatialForce(_ones(n, 3), _ones(n, 3)) for n in (1, 2)), _ones(), _ones()
    ),
    "Compliance": lambda: js.Compliance(*(_ones(2) * i for i in (1, 2, 3))),
    "Components": lambda: js.Components(_ones(2), 0.0, 1.0),
    "DoubleWord": lambda: js.to_double_word(_ones(2, 3)),
    "ForwardDynamicsDerivatives": lambda: _derivatives(linearization.ForwardDynamicsDerivatives),
    "HalfSpace": lambda: js.HalfSpace(_ones(2, 3), _ones(2)),
    "InverseDynamicsDerivatives": lambda: _derivatives(linearization.InverseDynamicsDerivatives),
    "ClosedConfiguration": lambda: closed_loops.ClosedConfiguration(_ones(2, 3), _ones(2)),
    "ConstrainedDynamics": lambda: closed_loops.ConstrainedDynamics(
        _ones(2, 3), js.SpatialForce(_ones(2, 1, 3), _ones(2, 1, 3))
    ),
    "LoopClosure": lambda: js.LoopClosure("left", "right", "distance", _ones(2)),
    "MassMatrixFactor": lambda: composite_bodies.MassMatrixFactor(_ones(2, 2)),
    "Mechanism": lambda: js.testing.random_mechanism(0, n=2, dtype=np.float32),
    "MomentumObserver": lambda: js.MomentumObserver(*(_ones(2) * i for i in (1, 2, 3))),
    "PointContacts": lambda: js.PointContacts(
        ["left", "right"], _ones(2, 3), _ones(), stiffness=_ones(4, 2), relaxation_time=_ones(2), friction=_ones(2)
    ),
    "RigidTransform": lambda: js.RigidTransform(js.Rotation(_ones(2, 9)), _ones(2, 3)),
    "Rotation": lambda: js.Rotation(_ones(2, 9)),
    "SpatialAcceleration": lambda: js.SpatialAcceleration(_ones(2, 3), _ones(2, 3)),
    "SpatialForce": lambda: js.SpatialForce(js.Components(0.0, 0.0, _ones(2)), js.to_double_word(_ones(2, 3))),
    "SpatialInertia": _inertia,
    "SpatialMomentum": lambda: js.SpatialMomentum(_ones(2, 3), _ones(2, 3)),
    "SpatialVelocity": lambda: js.SpatialVelocity(_ones(2, 3), _ones(2, 3)),
    "StaticMechanism": lambda: js.testing.random_mechanism(0, n=2, dtype=np.float32).as_static(),
}
# Descriptions that a mechanism is built of, with names in them: nothing that a program takes.
DESCRIPTIONS = {"Body", "Frame", "Joint"}


def _is_data(cls):
    return not issubclass(cls, (enum.Enum, Warning))


# Those of the top level, and of results, which stand beside their functions.
MODULES = js, closed_loops, composite_bodies, linearization, wrench
PUBLIC_TYPES = {
    name: x
    for module in MODULES
    for name, x in vars(module).items()
    if not name.startswith("_")
    and inspect.isclass(x)
    and _is_data(x)
    and (module is js or x.__module__ == module.__name__)
}


@pytest.mark.parametrize("name", sorted(set(PUBLIC_TYPES) - DESCRIPTIONS))
def test_every_public_type_goes_through_export(name):
    x = EXAMPLES[name]()
    assert type(x) is PUBLIC_TYPES[name]
    doubled = jax.jit(lambda x: jax.tree.map(lambda leaf: leaf + leaf, x))
    blob = jax.export.export(doubled)(x).serialize()
    found = jax.export.deserialize(blob).call(x)
    assert type(found) is type(x)
    chex.assert_trees_all_equal(found, jax.tree.map(lambda leaf: 2 * leaf, x))


def test_descriptions_are_no_trees():
    for name in DESCRIPTIONS:
        x = {"Joint": lambda: js.Joint("j", "fixed", "world", "b"), "Frame": lambda: js.Frame("f", "b")}.get(
            name, lambda: js.Body("b")
        )()
        assert jax.tree.leaves(x) == [x]
