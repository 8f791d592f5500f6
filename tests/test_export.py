"""Programs that take and return any public type are exported, written to bytes, read and called again."""

import enum
import functools
import inspect

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.contact import closed_loops
from jaxspatial.dynamics import composite_bodies, linearization
from jaxspatial.numerics.sums.pairwise import pairwise_sum
from jaxspatial.spatial import wrench
from tests.helpers import marks
from tests.helpers.algorithms import ALGORITHMS, mechanism, state
from tests.helpers.operations import OPERATIONS


def _ones(*shape):
    return jnp.ones(shape, jnp.float32)


def _inertia():
    return js.SpatialInertia(_ones(2), _ones(2, 3), _ones(2, 6))


def _derivatives(kind):
    return kind(*(_ones(2, 2) * i for i in (1, 2, 3)))


# One of each type whose objects are data.
EXAMPLES = {
    "Actuators": lambda: js.Actuators(["x", "y"], ["a", ("b", "c")], _ones(3), gain=_ones(2), damping=_ones(4, 2)),
    "AppliedForces": lambda: js.AppliedForces(
        ["left", "right"], js.SpatialForce(_ones(4, 2, 3), _ones(4, 2, 3)), _ones(2, 3), "frame"
    ),
    "ArticulatedInertia": lambda: js.ArticulatedInertia.from_spatial_inertia(_inertia()),
    "Box": lambda: js.Box(_ones(2, 3), js.RigidTransform(js.Rotation(_ones(2, 9)), _ones(2, 3))),
    "Capsule": lambda: js.Capsule(_ones(2), _ones(2)),
    "CentralAxis": lambda: js.central_axis(js.SpatialForce(_ones(2, 3), _ones(2, 3))),
    "ClosestPoints": lambda: js.closest_points(js.Sphere(_ones(2)), js.HalfSpace(_ones(3), _ones())),
    "ContactReport": lambda: js.ContactReport(*(_ones(2, 3) for _ in range(6)), None),
    "ConvexStep": lambda: js.ConvexStep(
        _ones(2), _ones(2), *(js.SpatialForce(_ones(n, 3), _ones(n, 3)) for n in (1, 2)), _ones(), _ones()
    ),
    "Compliance": lambda: js.Compliance(*(_ones(2) * i for i in (1, 2, 3))),
    "Components": lambda: js.Components(_ones(2), 0.0, 1.0),
    "Cylinder": lambda: js.Cylinder(_ones(2), _ones(2)),
    "DoubleWord": lambda: js.to_double_word(_ones(2, 3)),
    "ForwardDynamicsDerivatives": lambda: _derivatives(linearization.ForwardDynamicsDerivatives),
    "HalfSpace": lambda: js.HalfSpace(_ones(2, 3), _ones(2)),
    "HeightField": lambda: js.HeightField(_ones(4, 2, 3), _ones(2)),
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
    "ShapeContacts": lambda: js.ShapeContacts(
        ["left", "right"], js.Sphere(_ones(2)), stiffness=_ones(4, 2), relaxation_time=_ones(2), friction=_ones(2)
    ),
    "Sphere": lambda: js.Sphere(_ones(2)),
    "Stairs": lambda: js.Stairs(3, _ones(2), _ones(2)),
    "StaticMechanism": lambda: js.testing.random_mechanism(0, n=2, dtype=np.float32).as_static(),
    "Union": lambda: js.Union([js.Sphere(_ones(2)), js.HalfSpace(_ones(3), _ones())]),
    "Tendon": lambda: js.Tendon("line", ["a", "b"], _ones(2), _ones(), _ones(), _ones(2), _ones(), -_ones(), _ones()),
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


# Functions of Python are not written to a file.
OF_FUNCTIONS = {"SignedDistance"}


@pytest.mark.parametrize("name", sorted(set(PUBLIC_TYPES) - DESCRIPTIONS - OF_FUNCTIONS))
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


# -- symbolic batches -------------------------------------------------------------------------------------------------

ARM = js.testing.random_mechanism(0, 2, ["revolute", "prismatic"], is_chain=True, dtype=np.float32)


def _symbolic(arrays, names="b"):
    """Their shapes with symbols for the leading axes."""
    sizes = jax.export.symbolic_shape(names)
    return [jax.ShapeDtypeStruct((*sizes, *np.shape(x)[len(sizes) :]), x.dtype) for x in arrays]


def _of_operation(name, precision=None):
    operation = OPERATIONS[name]
    return operation.on_arrays(precision), lambda batch: operation.arrays(batch, np.float32)


def _of_states(function, mech=ARM):
    def arrays(batch):
        rng = np.random.default_rng(0)
        return [rng.standard_normal((*batch, n)).astype(np.float32) for n in (mech.nq, mech.nv, mech.nv)]

    return functools.partial(function, mech), arrays


def _pulled():
    """The cotangent of an offset that all share."""

    def pulled(tau, f, p):
        def energy(p):
            return js.shift(js.SpatialForce(tau, f), p, precision="compensated").tau.sum()

        return jax.grad(energy)(p[0])

    return pulled, _of_operation("shift_force")[1]


SYMBOLIC = {
    "shift": _of_operation("shift_force"),
    "shift of numbers that all share": (
        lambda tau, f: jax.tree.leaves(js.shift(js.SpatialForce(tau, f), np.ones(3, np.float32))),
        lambda batch: _of_operation("shift_force")[1](batch)[:2],
    ),
    "axis of a wrench, compensated": _of_operation("central_axis", "compensated"),
    "quotient": _of_operation("divide"),
    "shape with a known center": _of_operation("solid_box"),
    "cotangent of what all share": _pulled(),
    "inverse dynamics": _of_states(js.inverse_dynamics),
    "pull-back of inverse dynamics": _of_states(
        lambda mech, *x: jax.vjp(functools.partial(js.inverse_dynamics, mech), *x)[1](x[2])
    ),
    "step": _of_states(lambda mech, *x: js.semi_implicit_step(mech, *x, 0.01)),
}


# Others compile for seconds.
QUICK = [
    name for name in SYMBOLIC if name not in ("axis of a wrench, compensated", "pull-back of inverse dynamics", "step")
]


@pytest.mark.parametrize("name", marks.slow_but(QUICK, SYMBOLIC))
def test_a_symbolic_batch(name):
    """The exported program has the bits of the call for every size."""
    function, arrays = SYMBOLIC[name]
    blob = jax.export.export(jax.jit(function))(*_symbolic(arrays((2,)))).serialize()
    exported = jax.export.deserialize(blob)
    for n in (1, 5):
        chex.assert_trees_all_equal(exported.call(*arrays((n,))), jax.jit(function)(*arrays((n,))))


def _with_a_mimic():
    """(a step of one joint that another follows, with a sphere on the ground, its arrays)."""
    ball = js.SpatialInertia.solid_sphere(np.float32(0.1), mass=np.float32(1))
    out = js.RigidTransform(js.Rotation.identity(), np.array([0.3, 0, 0], np.float32))
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0)),
        js.Joint("k", "revolute", "a", "b", out, axis=(0, 1, 0), mimic=("j", -1.5, 0.1)),
    ]
    mech = js.Mechanism.build([js.Body(x, ball) for x in "ab"], joints, dtype=np.float32)
    k, tau_d, mu, radius = (np.float32(x) for x in (1e3, 0.01, 0.5, 0.5))
    contacts = js.PointContacts(["b"], out.translation[None], radius, stiffness=k, relaxation_time=tau_d, friction=mu)

    def step(mech, q, v, tau):
        return jax.tree.leaves(js.convex_step(mech, q, v, tau, np.float32(0.01), contacts=contacts))

    return _of_states(step, mech)


def test_a_step_is_lowered_over_a_symbol():
    """One program of several algorithms."""
    function, arrays = SYMBOLIC["step"]
    jax.export.export(jax.jit(function))(*_symbolic(arrays((2,))))


@pytest.mark.slow
@pytest.mark.parametrize("sizes", [(1, 3), (0, 3)])
def test_a_step_of_mimics_over_a_symbol(sizes):
    """JAX takes a symbol for at least one: a batch that may be empty has one less than a symbol."""
    step, arrays = _with_a_mimic()
    exported = jax.export.export(jax.jit(step))(*_symbolic(arrays((2,)), "b - 1" if 0 in sizes else "b"))
    assert [str(x.shape[0]) for x in exported.out_avals] == [str(exported.in_avals[0].shape[0])] * 6
    for n in sizes:
        found, expected = exported.call(*arrays((n,))), jax.jit(step)(*arrays((n,)))
        # Nothing promises the bits of what elimination finds.
        chex.assert_trees_all_close(found, expected, rtol=1e-5, atol=1e-5)
        chex.assert_trees_all_equal(found[5], expected[5])
        assert n == 0 or abs(np.asarray(found[3])).max() > 10


def test_two_symbols():
    function, arrays = _of_operation("shift_velocity")
    exported = jax.export.export(jax.jit(function))(*_symbolic(arrays((2, 3)), "a, b"))
    chex.assert_trees_all_equal(exported.call(*arrays((3, 1))), jax.jit(function)(*arrays((3, 1))))


@pytest.mark.parametrize("n", [1, 7, 33])
def test_sums_over_a_symbol_are_halved_alike(n):
    """Of any number of terms, in the order that a sum of so many has."""
    x = np.random.default_rng(0).standard_normal((2, n)).astype(np.float32) * 2.0 ** np.arange(n, dtype=np.float32)
    exported = jax.export.export(jax.jit(pairwise_sum))(*_symbolic([x], "a, n"))
    np.testing.assert_array_equal(exported.call(x), pairwise_sum(x))


@pytest.mark.parametrize("name", [name for name in OPERATIONS if not OPERATIONS[name].twin])
def test_every_operation_is_traced_over_a_symbol(name):
    function, arrays = _of_operation(name)
    given = _symbolic(arrays((2,)))
    found, like = jax.eval_shape(function, *given), jax.eval_shape(function, *arrays((2,)))
    size = given[0].shape[0]
    assert [x.shape for x in found] == [tuple(size if k == 0 else n for k, n in enumerate(x.shape)) for x in like]


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_algorithm_is_traced_over_a_symbol(name):
    """And over no states."""
    function = functools.partial(ALGORITHMS[name], mechanism())
    given = _symbolic(state((2,)))
    traced = (jax.eval_shape(function, *x) for x in (given, state((2,)), state((0,))))
    for x, y, z in zip(*map(jax.tree.leaves, traced), strict=True):
        assert x.shape == (given[0].shape[0], *y.shape[1:]) and z.shape == (0, *y.shape[1:])


@pytest.mark.slow
@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_algorithm_is_exported_over_a_symbol(name):
    function = functools.partial(ALGORITHMS[name], mechanism())
    exported = jax.export.export(jax.jit(function))(*_symbolic(state((2,))))
    for n in (1, 3):
        chex.assert_trees_all_equal(exported.call(*state((n,))), jax.jit(function)(*state((n,))))


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
@pytest.mark.parametrize("name", OPERATIONS)
def test_every_operation_is_exported_over_a_symbol(name, precision):
    function, arrays = _of_operation(name, precision)
    exported = jax.export.export(jax.jit(function))(*_symbolic(arrays((2,))))
    chex.assert_trees_all_equal(exported.call(*arrays((3,))), jax.jit(function)(*arrays((3,))))


def test_every_public_function_of_a_mechanism_is_in_the_table():
    of_mechanisms = {
        name
        for name, x in vars(js).items()
        if inspect.isfunction(x)
        and "mechanism" in inspect.signature(x).parameters
        and x.__module__.startswith(("jaxspatial.dynamics.", "jaxspatial.contact."))
    }
    assert of_mechanisms - {"random_configuration"} <= set(ALGORITHMS)
