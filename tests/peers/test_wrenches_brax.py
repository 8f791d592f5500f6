"""Generalized forces of wrenches on Brax's links, against J^T F of ours and what Brax's own step does with them."""

import functools
import warnings

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop
from tests.helpers.interpreted import interpreted
from tests.helpers.optional import needs

base, mjcf = needs("brax.base"), needs("brax.io.mjcf")
dynamics, pipeline = needs("brax.generalized.dynamics"), needs("brax.generalized.pipeline")
# Brax reads attributes that MJX has moved, and says that it is no longer developed.
pytestmark = [
    pytest.mark.filterwarnings("ignore:Accessing .* from `Data` is deprecated:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:Brax System, piplines:UserWarning"),
]
N, U = 512, 2.0**-24
MODEL = """
<mujoco><option timestep="0.002" gravity="0.3 -0.2 -9.81"/><worldbody><geom size=".01" contype="0" conaffinity="0"/>
  <body name="a" pos=".1 .2 2"><freejoint/>
    <inertial pos=".05 -.02 .03" quat=".8 .2 .3 -.1" mass="2" diaginertia=".04 .03 .02"/>
    <body name="b" pos=".2 0 .1" quat=".7 .1 .5 -.2"><joint axis=".2 .3 1" pos=".02 .01 -.03"/>
      <inertial pos=".02 .05 -.04" mass="1.3" fullinertia=".03 .025 .02 .003 -.002 .001"/>
      <body name="c" pos="0 .3 .1"><joint axis="1 0 0" pos=".1 0 0"/><joint axis="0 1 0" pos=".1 0 0"/>
        <inertial pos="0 .01 0" mass=".7" diaginertia=".02 .02 .01"/>
        <body name="tool" pos="0 .1 .2"><geom size=".01" mass="0" contype="0" conaffinity="0"/></body>
      </body>
    </body>
    <body name="d" pos="-.2 0 .1"><joint axis="0 1 0"/>
      <inertial pos=".02 .05 -.04" mass="1.3" diaginertia=".03 .025 .02"/></body>
  </body>
  <body name="e" pos="0 2 1"><joint axis="0 1 0"/><inertial pos="0 0 -.3" mass="1" diaginertia=".02 .02 .01"/></body>
</worldbody></mujoco>
"""


@pytest.fixture(autouse=True)
def relaxed():
    """Brax mixes dtypes and ranks."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


@functools.cache
def case():
    """(Brax's system, our mechanism, N configurations, velocities, forces, the states of Brax)."""
    sys = mjcf.loads(MODEL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", interop.ModelFileWarning)
        mech = js.Mechanism.from_mjcf(MODEL)
    q = js.random_configuration(mech, jax.random.key(0), N)
    rng = np.random.default_rng(0)
    v = jnp.asarray(rng.normal(size=(N, mech.nv)), jnp.float32)
    frames = ("a", "tool", "c", "d", "e", "tool")
    F = js.SpatialForce(*rng.normal(size=(2, N, len(frames), 3)).astype(np.float32))
    forces = js.AppliedForces(frames, F, rng.normal(size=(N, len(frames), 3)).astype(np.float32), axes="frame")
    qpos, qvel = interop.mujoco.to_qpos(mech, q), interop.mujoco.to_qvel(mech, q, v)
    states = interpreted(jax.vmap(functools.partial(pipeline.init, sys)))(qpos, qvel)
    return sys, mech, q, v, forces, states


def expected_tau(mech, q, forces):
    """J^T F, in the coordinates of Brax, which are those of MuJoCo."""
    rest = jnp.zeros((N, mech.nv), jnp.float32)

    def pulled(q, F):
        without, with_them = (js.bias_forces(mech, q, rest, F) for F in (None, F))
        return interop.mujoco.to_qfrc(mech, q, without - with_them)

    return interpreted(pulled)(q, forces)


@pytest.mark.slow
def test_as_the_transposed_jacobian():
    sys, mech, q, _, forces, states = case()
    wrenches = interpreted(functools.partial(js.applied_wrenches, mech))(q, forces)
    assert set(wrenches) == set("acde")
    found = interpreted(lambda s, F: interop.brax.to_tau(sys, s, F))(states, wrenches)
    J = interpreted(lambda q: {name: js.jacobian(mech, q, name) for name in wrenches})(q)
    of_each = [jnp.einsum("bij,bi->bj", J[name], F.to_array(), precision="highest") for name, F in wrenches.items()]
    expected = interpreted(functools.partial(interop.mujoco.to_qfrc, mech))(q, sum(of_each))
    np.testing.assert_allclose(found, expected, rtol=0, atol=64 * U * abs(expected).max())
    np.testing.assert_allclose(found, expected_tau(mech, q, forces), rtol=0, atol=512 * U * abs(expected).max())
    each = jax.jit(jax.vmap(lambda s, F: interop.brax.to_tau(sys, s, F)))(states, wrenches)
    np.testing.assert_allclose(each, found, rtol=0, atol=16 * U * abs(expected).max())


def with_forces_of_all_joints(sys):
    """The system with an actuator of gain 1 on every degree of freedom, behind its own."""
    n = sys.qd_size()
    zero, one, range_ = jnp.zeros(n), jnp.ones(n), jnp.tile(jnp.array([-jnp.inf, jnp.inf]), (n, 1))
    added = base.Actuator(
        q_id=jnp.zeros(n, int), qd_id=jnp.arange(n), ctrl_range=range_, force_range=range_,
        gain=one, gear=one, bias_q=zero, bias_qd=zero,
    )  # fmt: skip
    actuator = jax.tree.map(lambda *x: jnp.concatenate(x), sys.actuator, added)
    return sys.replace(actuator=actuator, nu=sys.nu + n)


@pytest.mark.slow
def test_the_step_of_brax_has_our_accelerations():
    sys, mech, q, v, forces, states = case()
    pushed = with_forces_of_all_joints(sys)

    @functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
    @jax.vmap
    def step(state, q, forces):
        tau = interop.brax.to_tau(sys, state, js.applied_wrenches(mech, q, forces))
        return pipeline.step(pushed, state, tau).qdd

    def ours(q, v, forces):
        return interop.mujoco.to_qacc(mech, q, v, js.forward_dynamics(mech, q, v, jnp.zeros_like(v), forces))

    expected = interpreted(ours)(q, v, forces)
    np.testing.assert_allclose(step(states, q, forces), expected, rtol=0, atol=2.0**-15 * abs(expected).max())


@pytest.mark.slow
def test_the_world_does_not_move_and_other_names_are_refused():
    sys, *_, states = case()
    F = js.SpatialForce(np.ones((N, 3), np.float32), np.ones((N, 3), np.float32))
    assert not interop.brax.to_tau(sys, states, {"world": F}).any()
    assert not interop.brax.to_tau(sys, states, {}).any()
    with pytest.raises(KeyError, match="no link 'A'; did you mean 'a'"):
        interop.brax.to_tau(sys, states, {"A": F})


SLIDING = """
<mujoco><worldbody><geom size=".01" contype="0" conaffinity="0"/>
  <body name="a"><joint axis="0 1 0"/><inertial pos="0 0 .1" mass="1" diaginertia=".1 .1 .1"/>
    <body name="b"><joint type="slide" axis="0 0 1"/><inertial pos="0 0 .1" mass="1" diaginertia=".1 .1 .1"/></body>
</body></worldbody></mujoco>
"""


@pytest.mark.slow
def test_brax_leaves_the_axis_of_a_slide_unturned():
    """What the docstring says of it: its own dynamics are those of another robot than MuJoCo's."""
    sys = mjcf.loads(SLIDING)
    model = mujoco.MjModel.from_xml_string(SLIDING)
    data, q = mujoco.MjData(model), np.array([np.pi / 2, 0.3])
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    state = jax.jit(pipeline.init)(sys, jnp.asarray(q, jnp.float32), jnp.zeros(2))
    theirs, ours = state.cdof.vel[1], data.cdof[1, 3:]
    np.testing.assert_allclose(ours, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(theirs, [0, 0, 1], atol=1e-6)
    weight = -dynamics.inverse(sys, state)[1]
    assert abs(weight) > 9 and abs(data.qfrc_bias[1]) < 1e-12
