"""Programs without loops: the same bits as with them, but for sums over all bodies."""

import functools

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

ALGORITHMS = {
    "inverse dynamics": js.inverse_dynamics,
    "forward dynamics": js.forward_dynamics,
    "mass matrix": lambda m, q, v, a: js.mass_matrix(m, q),
    "kinematics": lambda m, q, v, a: js.forward_kinematics(m, q),
    "accelerations": js.body_accelerations,
    "Jacobian": lambda m, q, v, a: js.jacobian(m, q, m.body_names[-1]),
    "reactions": js.joint_reactions,
    "step": lambda m, q, v, a: js.semi_implicit_step(m, q, v, a, 0.01),
    "derivatives": js.forward_dynamics_derivatives,
    "gradient": lambda m, q, v, a: jax.vjp(lambda *x: js.forward_dynamics(m, *x), q, v, a)[1](v),
    "energy": js.kinetic_energy,
}
SUMS = ("energy",)
# Gradients are JAX's, of a program that is held here itself.
CASES = [slow(name, False) if name == "gradient" else (name, False) for name in ALGORITHMS] + [
    ("forward dynamics", True),
    ("mass matrix", True),
]


@functools.cache
def both(is_chain, dtype):
    """With loops along and across chains, and the same written out."""
    kinds = ["free", "revolute", "revolute", "revolute"] if is_chain else ["revolute", "ball"]
    mech = js.testing.random_mechanism(0, 4 if is_chain else 6, kinds, is_chain, dtype=dtype)
    looped, straight = ([bundle.bodies.shape[0] for bundle in m.topology.bundles] for m in (mech, mech.written_out()))
    assert max(looped) == (3 if is_chain else 2) and max(straight) == 1
    return mech, mech.written_out()


def state(mech, *batch):
    """q, v and accelerations."""
    q = np.asarray(js.random_configuration(mech, jax.random.key(0), batch))
    return q, *np.random.default_rng(0).standard_normal((2, *batch, mech.nv)).astype(q.dtype)


@pytest.mark.parametrize(("name", "is_chain"), CASES)
def test_the_same_bits(name, is_chain):
    with jax.enable_x64(True):
        mechs = both(is_chain, np.float64)
        at = state(mechs[0])[: 2 if name in SUMS else 3]
        found = [interpreted(lambda *x, m=m: ALGORITHMS[name](m, *x))(*at) for m in mechs]
    for x, y in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_allclose(x, y, rtol=2.0**-50 if name in SUMS else 0)


@pytest.mark.parametrize("name", ["accelerations", slow("forward dynamics")])
def test_compiled_the_same_bits(name):
    """As the formula with loops, in NumPy."""
    mech, written_out = both(True, np.float32)
    at = state(mech, 5)
    expected = interpreted(functools.partial(ALGORITHMS[name], mech))(*at)
    jax.tree.map(np.testing.assert_array_equal, ALGORITHMS[name](written_out, *at), expected)


def test_stays_with_what_is_made_of_a_mechanism():
    mech = js.testing.random_mechanism(3, 6, ["revolute"], is_chain=True, dtype=np.float32)
    out = mech.written_out()
    made = [
        out.as_data(), out.as_static(), out.astype(np.float64), out.replace(gravity=out.gravity), out.as_known(),
        js.subtree(out, out.body_names[1]), js.lock_joints(out, {out.joint_names[0]: 0.1}), js.add_frames(out, []),
    ]  # fmt: skip
    assert all(x.topology.is_written_out for x in made)
    assert out.written_out(False).topology == mech.topology != out.topology
