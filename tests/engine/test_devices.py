"""Batches of states that are split over devices: nothing is sent between them, and the bits are those of one device."""

import functools
import re
import sys

import jax
import numpy as np
import pytest
from jax.sharding import AxisType
from jax.sharding import PartitionSpec as P

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.processes import python
from tests.helpers.soon import compiled_soon

COLLECTIVES = "all-reduce|all-gather|all-to-all|reduce-scatter|collective"
N_DEVICES = 4
# States of a device: more than are computed at once, and not a multiple of that; few.
MANY, FEW = 2148, 40


def _map(function, mesh):
    return jax.shard_map(function, mesh=mesh, in_specs=P("batch"), out_specs=P("batch"))


def _inverse(mech, q, v, vdot):
    return js.inverse_dynamics(mech, q, v, vdot)


def _mapped(mech, q, v, vdot):
    return jax.vmap(functools.partial(_inverse, mech))(q, v, vdot)


def _gradient(mech, q, v, vdot):
    return jax.grad(lambda q: js.gravity_forces(mech, q).sum())(q)


def _contact(mech, q, v, tau):
    law = {"stiffness": np.float32(1e4), "relaxation_time": np.float32(0.01), "friction": np.float32(0.5)}
    tip = js.PointContacts([mech.body_names[-1]], None, np.float32(0.1), **law)
    return js.convex_step(mech, q, v, tau, np.float32(5e-3), contacts=tip).v


# (function, whether the robot is data, how many states a device has, kind of axis, whether in a shard_map)
CASES = (
    (_inverse, False, MANY, AxisType.Auto, False),
    (_mapped, True, MANY, AxisType.Explicit, False),
    (_gradient, False, MANY, AxisType.Auto, True),
)
MORE_CASES = (
    (_inverse, True, MANY, AxisType.Explicit, False),
    (_inverse, False, FEW, AxisType.Explicit, False),
    (_mapped, False, MANY, AxisType.Explicit, False),
    (_inverse, False, MANY, AxisType.Auto, True),
    (_gradient, False, MANY, AxisType.Auto, False),
)

CONTACT_CASES = (
    (_contact, False, FEW, AxisType.Auto, True),
    (_contact, False, FEW, AxisType.Explicit, False),
)


@pytest.mark.slow
@pytest.mark.parametrize("cases", ["CASES", "MORE_CASES", "CONTACT_CASES"])
def test_states_stay_on_their_device(cases):
    done = python(__file__, cases, n_devices=N_DEVICES)
    assert done.stdout.split() == ["True"] * (len(globals()[cases]) + 1 + (cases == "CASES"))


def _check(function, is_data, n_each, axis_type, is_map):
    mech = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=np.float32)
    function = functools.partial(function, mech.as_data() if is_data else mech)
    rng = np.random.default_rng(0)
    states = [rng.standard_normal((N_DEVICES * n_each, 2)).astype(np.float32) for _ in range(3)]
    mesh = jax.make_mesh((N_DEVICES,), ("batch",), axis_types=(axis_type,))
    split = [jax.device_put(x, jax.NamedSharding(mesh, P("batch"))) for x in states]
    compiled = jax.jit(_map(function, mesh) if is_map else function).lower(*split).compile()
    assert re.findall(COLLECTIVES, compiled.as_text()) == []
    result = compiled(*split)
    assert [x.data.shape for x in result.addressable_shards] == [(n_each, 2)] * N_DEVICES
    np.testing.assert_array_equal(result, jax.jit(function)(*states))
    print(True)


def _check_gradients_by_what_devices_share():
    """Inside of a shard_map they are summed over the devices, as those of operations of JAX are."""
    mech = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=np.float32)
    q = np.random.default_rng(0).standard_normal((2 * N_DEVICES, 2)).astype(np.float32)
    mesh = jax.make_mesh((N_DEVICES,), ("batch",), axis_types=(AxisType.Auto,))

    def own(w, q):
        return (js.gravity_forces(mech.replace(gravity=mech.gravity * w), q) ** 2).sum()

    def of_jax(w, q):
        return (jax.numpy.sin(w * q) ** 2).sum()

    for cost in (own, of_jax):
        gradient = jax.grad(lambda w, q, cost=cost: jax.lax.psum(cost(w, q), "batch"))
        inside = jax.shard_map(gradient, mesh=mesh, in_specs=(P(), P("batch")), out_specs=P())
        whole = jax.shard_map(
            lambda w, q, cost=cost: jax.lax.psum(cost(w, q), "batch"),
            mesh=mesh,
            in_specs=(P(), P("batch")),
            out_specs=P(),
        )
        w = np.float32(1.1)
        expected = jax.grad(cost)(w, q)
        np.testing.assert_allclose(jax.jit(inside)(w, q), expected, rtol=1e-5)
        np.testing.assert_allclose(jax.jit(jax.grad(whole))(w, q), expected, rtol=1e-5)
    print(True)


def _check_distances_of_cylinders():
    """Whose rims are found by bisection: one after the other in a scan, on each device its own."""

    def distances(p, w):
        def one(_, at):
            X = js.RigidTransform.exp(js.SpatialVelocity(at[1], at[0]))
            capsule, cylinder = js.Capsule(*np.float32([0.1, 0.8])), js.Cylinder(*np.float32([0.3, 1.0]), X)
            return None, js.distance(capsule, cylinder)

        return jax.lax.scan(one, None, (p, w))[1]

    rng = np.random.default_rng(0)
    p, w = rng.standard_normal((2, 2 * N_DEVICES, 3)).astype(np.float32)
    mesh = jax.make_mesh((N_DEVICES,), ("batch",), axis_types=(AxisType.Auto,))
    with compiled_soon():
        compiled = jax.jit(_map(distances, mesh)).lower(p, w).compile()
    assert re.findall(COLLECTIVES, compiled.as_text()) == []
    expected = interpreted(distances)(p, w)
    assert (expected > 0).any() and (expected < 0).any()
    np.testing.assert_array_equal(compiled(p, w), expected)
    print(True)


if __name__ == "__main__":
    _check_gradients_by_what_devices_share()
    if sys.argv[1] == "CASES":
        _check_distances_of_cylinders()
    for case in globals()[sys.argv[1]]:
        _check(*case)
