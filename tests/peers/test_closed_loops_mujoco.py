"""Closed loops against MuJoCo's mass matrix, bias forces and Jacobians of points, in one dense system in float64.

MuJoCo's own accelerations are of soft constraints: they differ by design.
"""

import jax
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import closed_loops
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def rows_of(model, data, kind):
    """(J, dJ/dt v) of the closure between the sites A and B, in world axes and along x and y of A."""
    J, of_J = [], []
    for site in (data.site("A"), data.site("B")):
        body, both = model.site_bodyid[site.id], np.zeros((2, 2, 3, model.nv))
        mujoco.mj_jac(model, data, *both[0], site.xpos, body)
        mujoco.mj_jacDot(model, data, *both[1], site.xpos, body)
        J.append(both[0])
        of_J.append(both[1])
    (p, w), (p_rate, w_rate) = J[1] - J[0], of_J[1] - of_J[0]
    bias, w_bias = p_rate @ data.qvel, w_rate @ data.qvel
    if kind == "ball":
        return p, bias
    if kind == "weld":
        return np.vstack([w, p]), np.concatenate([w_bias, bias])
    across = data.site("A").xmat.reshape(3, 3)[:, :2]
    # d/dt (x . w) = x . dw/dt + (w_A x x) . w
    turning = np.cross(J[0][1] @ data.qvel, across.T) @ (w @ data.qvel)
    return np.vstack([across.T @ w, p]), np.concatenate([across.T @ w_bias + turning, bias])


# A ball, a hinge and a weld.
@pytest.mark.parametrize("name", slow_but(["four-bar", "hinges", "arms"], closed_loops.BODIES))
def test_accelerations_and_forces(name):
    s = closed_loops.closed(name)
    found = closed_loops.constrained(name)
    data, M = mujoco.MjData(s.model), np.zeros((s.model.nv, s.model.nv))
    for i, (q, v, tau) in enumerate(zip(s.q, s.v, s.tau, strict=True)):
        data.qpos, data.qvel = q, v
        mujoco.mj_forward(s.model, data)
        mujoco.mj_fullM(s.model, data, M)
        J, bias = rows_of(s.model, data, closed_loops.CLOSURES[name][2])
        vdot, forces = closed_loops.kkt(M, data.qfrc_bias, tau, J, bias)
        assert abs(found.vdot[i] - vdot).max() <= 1e-11 * abs(vdot).max()
        ours = M @ found.vdot[i] + data.qfrc_bias - tau
        assert abs(ours - forces).max() <= 1e-11 * abs(forces).max()
        # The force on the tree is that of the wrenches on B, and of their opposites on A.
        (F,) = np.asarray(found.loop_wrenches.to_array()[i])
        of_sites = [np.zeros((2, 3, s.model.nv)) for _ in "AB"]
        for site, (p, w) in zip("AB", of_sites, strict=True):
            mujoco.mj_jac(s.model, data, p, w, data.site("B").xpos, s.model.site_bodyid[s.model.site(site).id])
        (p_A, w_A), (p_B, w_B) = of_sites
        assert abs((w_B - w_A).T @ F[:3] + (p_B - p_A).T @ F[3:] - forces).max() <= 1e-11 * abs(forces).max()


EQUALITY = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>
  <body name="a" pos=".1 .2 .3" quat="1 .2 .3 .4"><joint axis="0 1 .2"/><geom size=".1" mass="1"/>
    <body name="b" pos=".5 0 .1" quat="1 -.2 .3 .1"><joint axis="1 1 .2"/><geom size=".1" mass="1"/>
      <site name="sb" pos=".1 .2 .3" quat="1 .5 0 0"/></body></body>
  <body name="c" pos=".4 .3 .2"><freejoint name="float"/><geom size=".1" mass="1"/>
    <site name="c" pos=".3 .2 .1" quat="1 0 .5 0"/></body>
</worldbody><equality>{}</equality></mujoco>"""
WRITTEN = {
    "point": ('<connect name="e" body1="b" body2="c" anchor=".1 .2 .3"/>', ("e/a", "e/b", "ball")),
    "point in the world": ('<connect body1="b" anchor=".1 .2 .3"/>', ("eq_0/a", "eq_0/b", "ball")),
    "points of sites": ('<connect site1="sb" site2="c"/>', ("sb", "c/c", "ball")),
    "weld": ('<weld name="w" body1="b" body2="c"/>', ("w/a", "w/b", "weld")),
    "weld at an anchor": ('<weld body1="c" body2="b" anchor=".3 .1 -.2"/>', ("eq_0/a", "eq_0/b", "weld")),
    "weld at a pose": (
        '<weld body1="b" body2="c" relpose=".1 .2 .3 1 .2 .3 .4" anchor=".2 0 0"/>', ("eq_0/a", "eq_0/b", "weld"),
    ),
    "weld to the world": ('<weld body1="c"/>', ("eq_0/a", "eq_0/b", "weld")),
    "weld of sites": ('<weld site1="sb" site2="c"/>', ("sb", "c/c", "weld")),
}  # fmt: skip


@pytest.mark.parametrize(("element", "names"), WRITTEN.values(), ids=WRITTEN)
@pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")
def test_equalities_that_are_read(element, names):
    """Distances of anchors and angles of welds are MuJoCo's, at a random state, and its zeros are ours."""
    text = EQUALITY.format(element)
    model, mech = mujoco.MjModel.from_xml_string(text), js.Mechanism.from_mjcf(text, dtype=np.float64)
    (loop,) = mech.loops
    assert (loop.frame_a, loop.frame_b, loop.kind) == names and loop.distance is None
    data, q = mujoco.MjData(model), np.random.default_rng(0).standard_normal(9)
    q[5:] /= np.linalg.norm(q[5:])
    data.qpos = q
    mujoco.mj_forward(model, data)
    from_qpos = js.interop.mujoco.from_qpos
    error = interpreted(lambda q: js.constraint_error(mech, from_qpos(mech, q), mech.loops))(q)
    # MuJoCo's are in world axes, positions first; angles as sines of half of them.
    theirs = data.efc_pos[:3]
    assert abs(np.linalg.norm(error[-3:]) - np.linalg.norm(theirs)) <= 1e-14
    if loop.kind == "weld":
        sine = np.linalg.norm(data.efc_pos[3:6])
        assert abs(abs(np.sin(np.linalg.norm(error[:3]) / 2)) - sine) <= 1e-14
