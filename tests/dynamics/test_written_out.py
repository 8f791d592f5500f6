"""Programs without loops: the same bits as with them, but for sums over all bodies."""

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

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
CASES = [(name, False) for name in ALGORITHMS] + [("forward dynamics", True), ("mass matrix", True)]


@pytest.mark.parametrize(("name", "is_chain"), CASES)
def test_the_same_bits(name, is_chain):
    mech, rng = js.testing.random_mechanism(0, 9, is_chain=is_chain, dtype=np.float64), np.random.default_rng(0)
    with jax.enable_x64(True):
        q = np.asarray(js.random_configuration(mech, jax.random.key(0)))
        at = (q, *rng.standard_normal((2, mech.nv)))[: 2 if name in SUMS else 3]
        both = [interpreted(lambda *x, m=m: ALGORITHMS[name](m, *x))(*at) for m in (mech, mech.written_out())]
    for x, y in zip(*map(jax.tree.leaves, both), strict=True):
        np.testing.assert_allclose(x, y, rtol=2.0**-50 if name in SUMS else 0)


def test_compiled_the_same_bits():
    mech, rng = js.testing.random_mechanism(0, 9, dtype=np.float32), np.random.default_rng(0)
    q = np.asarray(js.random_configuration(mech, jax.random.key(0), 5))
    v, a = rng.standard_normal((2, 5, mech.nv)).astype(np.float32)
    for function in (js.inverse_dynamics, js.forward_dynamics):
        np.testing.assert_array_equal(function(mech, q, v, a), function(mech.written_out(), q, v, a))


def test_stays_with_what_is_made_of_a_mechanism():
    mech = js.testing.random_mechanism(3, 6, ["revolute"], is_chain=True, dtype=np.float32)
    out = mech.written_out()
    made = [
        out.as_data(), out.as_static(), out.astype(np.float64), out.replace(gravity=out.gravity), out.as_known(),
        js.subtree(out, out.body_names[1]), js.lock_joints(out, {out.joint_names[0]: 0.1}), js.add_frames(out, []),
    ]  # fmt: skip
    assert all(x.topology.is_written_out for x in made)
    assert out.written_out(False).topology == mech.topology != out.topology
