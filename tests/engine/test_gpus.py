"""What XLA compiles, and what is lowered for GPUs: its bits are those of machine code, and no call is left.

`python -m jaxspatial --self-check` and tests/benchmarks/gpu.py look on a GPU itself.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.engine import cpu
from jaxspatial.numerics.errorfree import barrier

N, DT = 5, np.float32(1e-3)
MECH = js.testing.random_mechanism(3, 6, ["revolute", "prismatic", "ball"], dtype=np.float32)
CONTACTS = js.PointContacts(
    MECH.frame_names[-2:], None, np.float32(0.1),
    stiffness=np.float32(1e3), relaxation_time=np.float32(0.01), friction=np.float32(0.7),
)  # fmt: skip


def states():
    q = js.random_configuration(MECH, jax.random.key(0), N, np.float32)
    return q, *jnp.asarray(np.random.default_rng(0).standard_normal((2, N, MECH.nv)), np.float32)


def stepped(q, v, tau):
    return jax.tree.leaves(js.convex_step(MECH, q, v, tau, DT, contacts=CONTACTS))


OF_STATES = {
    "inverse dynamics": lambda q, v, a: js.inverse_dynamics(MECH, q, v, a),
    "forward dynamics": lambda q, v, tau: js.forward_dynamics(MECH, q, v, tau),
    "mass matrix": lambda q, v, a: js.mass_matrix(MECH, q),
    "gradient": jax.grad(lambda q, v, tau: js.forward_dynamics(MECH, q, v, tau).sum(), (0, 1, 2)),
    "contact": stepped,
}


def text(function, *arguments, platform="cuda"):
    return jax.jit(function).trace(*arguments).lower(lowering_platforms=(platform,)).as_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", OF_STATES)
def test_what_xla_compiles_has_the_bits_of_machine_code(name, monkeypatch):
    """Those of the algorithms; sums of cotangents are in another order, and contact solves to a tolerance."""
    function, arguments = OF_STATES[name], states()
    expected = jax.jit(function)(*arguments)
    monkeypatch.setattr(cpu, "is_available", lambda: False)
    found = jax.jit(lambda *x: function(*x))(*arguments)
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        most = 0 if name in list(OF_STATES)[:3] else 64 * 2.0**-24 * abs(np.asarray(y)).max()
        np.testing.assert_allclose(x, y, rtol=0, atol=most)


def test_no_call_is_left():
    """XLA fuses nothing inside of one on GPUs."""
    F, p = js.SpatialForce(*np.ones((2, N, 3), np.float32)), np.ones((N, 3), np.float32)
    shifted = lambda F, p: js.shift(F, p, precision="faithful")  # noqa: E731
    assert "inlineable" in text(shifted, F, p, platform="cpu") and "inlineable" not in text(shifted, F, p)
    assert "inlineable" not in text(OF_STATES["forward dynamics"], *states())


@pytest.mark.parametrize("name", ["quotient", "root"])
def test_quotients_and_roots_are_rounded_once(name):
    """Through float64, where that is told from float32 at all: subnormal results, next to ties, and at the ends."""
    function, operator = {
        "quotient": (barrier._in_float64(barrier._rounded_quotient), np.divide),
        "root": (barrier._in_float64(barrier._rounded_root), np.sqrt),
    }[name]
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 0x7F80_0000, (2, 200_000), np.uint32).view(np.float32)
    ends = np.float32([0, 1e-45, 1.1754944e-38, 1, 3.4028235e38, np.inf, np.nan])
    a, b = (np.concatenate([x, y.ravel()]) for x, y in zip(bits, np.meshgrid(ends, ends), strict=True))
    # XLA flushes subnormal numbers of float32 on CPUs.
    with np.errstate(all="ignore"):
        operands = (a, b) if name == "quotient" else (a,)
        expected = operator(*operands)
    is_kept = ~np.any([(abs(x) < np.finfo(np.float32).tiny) & (x != 0) for x in (*operands, expected)], 0)
    found = np.asarray(jax.jit(function)(*map(jnp.asarray, operands)))
    np.testing.assert_array_equal(found[is_kept], expected[is_kept])


def test_arithmetic_is_kept_apart_by_what_gpus_do_not_remove():
    """A rounding of a sum to the format it has, and one to float32 and back, are no operations to XLA there."""
    x = jnp.ones(4, jnp.float32)
    of_sum = {platform: text(barrier.no_reassociation, x, platform=platform) for platform in ("cpu", "cuda", "rocm")}
    assert "reduce_precision" in of_sum["cpu"] and "select" not in of_sum["cpu"]
    for platform in ("cuda", "rocm"):
        assert "reduce_precision" not in of_sum[platform] and "select" in of_sum[platform]
        for function, operation in ((lambda x: barrier.quotient(x, x), "divide"), (barrier.root, "sqrt")):
            found = text(function, x, platform=platform)
            (line,) = (line for line in found.splitlines() if f"stablehlo.{operation} " in line)
            assert "f64" in line
            first = next(line for line in found.splitlines() if "stablehlo.convert" in line)
            assert "f32" in first and found.index("stablehlo.select") < found.index(first)
