"""The recipes of the page on wrench sensors, against truth that is written down by hand, over many draws of noise."""

import ast
import functools
import pathlib
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

PAGES = pathlib.Path(js.__file__).parent.parent / "notebooks"
DRAWS = 400
SIGMA = np.repeat([0.02, 0.2], 3)
G = np.array([0.0, 0.0, -9.81])


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def recipes(**names):
    """The functions of the page, over other names."""
    text = "\n".join(re.findall(r"```python\n(.*?)```", (PAGES / "sensors.md").read_text(), re.S))
    functions = [x for x in ast.parse(text).body if isinstance(x, ast.FunctionDef)]
    scope = {"jax": jax, "jnp": jnp, "js": js, **names}
    exec(compile(ast.Module(functions, []), "sensors.md", "exec"), scope)
    return scope


@functools.cache
def robot():
    """Three hinges, the last with a sensor that is turned and off its origin."""
    mech = js.testing.random_mechanism(8, 3, ["revolute"], is_chain=True, dtype=np.float64)
    X = js.RigidTransform(js.Rotation.exp(np.array([0.3, -0.5, 0.8])), np.array([0.1, 0.2, -0.1]))
    return js.add_frames(mech, [js.Frame("sensor", "body2", X)])


MASS, COM = 1.3, np.array([0.05, -0.1, 0.2])
CENTRAL = np.array([[0.02, 0.001, 0.0], [0.001, 0.03, 0.002], [0.0, 0.002, 0.025]])
BIAS = np.array([0.3, -0.2, 0.1, 2.0, -3.0, 1.0])


def readings(q, v, vdot):
    """What the robot does to the load: by Newton and Euler about the centre of mass, whose acceleration is a difference
    of its positions in time, in the axes of the world; then about So, in the axes of S."""
    mech, h = robot(), 1e-4
    ahead, behind = (js.integrate(mech, q, s * h * v + h * h / 2 * vdot) for s in (1, -1))

    def placed(q):
        X = js.forward_kinematics(mech, q, "sensor")
        return np.asarray(X.rotation.to_matrix()), np.asarray(X.translation)

    (R1, p1), (R, p), (R0, p0) = (placed(x) for x in (ahead, q, behind))
    a = ((p1 + R1 @ COM) - 2 * (p + R @ COM) + (p0 + R0 @ COM)) / h**2
    w1, w0 = (_vee((x - R) @ R.swapaxes(-1, -2)) * s / h for x, s in ((R1, 1), (R0, -1)))
    w, alpha = (w1 + w0) / 2, (w1 - w0) / h
    inertia = R @ CENTRAL @ R.swapaxes(-1, -2)
    spin = np.einsum("nij,nj->ni", inertia, w)
    f = MASS * (a - G)
    tau = np.einsum("nij,nj->ni", inertia, alpha) + np.cross(w, spin) + np.cross(R @ COM, f)
    return np.concatenate([np.einsum("nji,nj->ni", R, x) for x in (tau, f)], -1)


def _vee(m):
    m = (m - m.swapaxes(-1, -2)) / 2
    return np.stack([m[:, 2, 1], m[:, 0, 2], m[:, 1, 0]], -1)


def states(n=20):
    rng = np.random.default_rng(0)
    return rng.uniform(-3, 3, (n, 3)), 2 * rng.standard_normal((n, 3)), 9 * rng.standard_normal((n, 3))


def assert_errors_are_those_of_theory(Y, clean, truth):
    """Of estimates from many draws of noise: the squares of errors, divided by their covariance, have the mean k of a
    chi-squared distribution of k degrees of freedom, the mean error is zero, and each component has its deviation."""
    least_squares = recipes(noise=SIGMA)["least_squares"]
    drawn = clean + SIGMA * np.random.default_rng(1).standard_normal((DRAWS, *clean.shape))
    with jax.numpy_rank_promotion("allow"):
        found, covariance, *_ = jax.jit(jax.vmap(least_squares, (None, 0)))(Y, drawn)
    errors, covariance, k = np.asarray(found) - truth, np.asarray(covariance)[0], len(truth)
    squares = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(covariance), errors)
    assert abs(squares.mean() - k) < 4 * np.sqrt(2 * k / DRAWS)
    deviation = np.sqrt(np.diagonal(covariance))
    assert (abs(errors.mean(0)) < 4.5 * deviation / np.sqrt(DRAWS)).all()
    assert (abs(errors.std(0) / deviation - 1) < 4.5 / np.sqrt(2 * DRAWS)).all()


def test_payload_from_poses_at_rest():
    q, v, vdot = states()
    with jax.numpy_rank_promotion("allow"):
        Y = interpreted(recipes(robot=robot())["static_regressor"])(q)
    R = np.asarray(js.forward_kinematics(robot(), q, "sensor").rotation.to_matrix())
    f = -MASS * np.einsum("nji,j->ni", R, G)
    clean = np.concatenate([np.cross(COM, f), f], -1) + BIAS
    assert_errors_are_those_of_theory(Y, clean, np.array([MASS, *(MASS * COM), *BIAS]))


def test_all_parameters_from_motion():
    q, v, vdot = states()
    with jax.numpy_rank_promotion("allow"):
        motion = recipes(robot=robot())["motion"]
        Y = interpreted(lambda *x: js.regressors.newton_euler_regressor(*motion(*x)))(q, v, vdot)
    Y = np.concatenate([Y, np.broadcast_to(np.eye(6), (len(q), 6, 6))], -1)
    about_So = CENTRAL + MASS * (COM @ COM * np.eye(3) - np.outer(COM, COM))
    entries = [about_So[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    truth = np.array([MASS, *(MASS * COM), *entries, *BIAS])
    clean = readings(q, v, vdot) + BIAS
    np.testing.assert_allclose(Y @ truth, clean, rtol=0, atol=1e-5 * abs(clean).max())
    assert_errors_are_those_of_theory(Y, clean, truth)


@pytest.mark.parametrize("is_singular", [False, True])
def test_a_contact_wrench_from_torques(is_singular):
    """Without noise it is what the resolution says; noise s is at most s / (2 damping), of the covariance of theory."""
    rng, s, damping, length = np.random.default_rng(2), 0.05, 0.02, 0.1
    J, x = rng.standard_normal((6, 7)), rng.standard_normal(6)
    if is_singular:
        J[:3], J[5] = 0, J[4] + 1e-4 * J[5]
    scale = np.repeat([length, 1.0], 3)
    tau = J.T @ (scale * x)
    drawn = np.vstack([tau, tau + s * rng.standard_normal((4000, 7))])
    with jax.numpy_rank_promotion("allow"):
        F, resolution = jax.jit(jax.vmap(recipes()["wrench_from_torques"], (None, 0)))(J, drawn)
    found, resolution = np.asarray(F.to_array()) / scale, np.asarray(resolution)[0]
    np.testing.assert_allclose(found[0], resolution @ x, atol=1e-9)
    A = J.T * scale
    inverse = np.linalg.solve(A.T @ A + damping**2 * np.eye(6), A.T)
    np.testing.assert_allclose(resolution, inverse @ A, atol=1e-9)
    covariance = s**2 * inverse @ inverse.T
    deviation = np.sqrt(np.diagonal(covariance))
    assert (deviation <= s / (2 * damping)).all()
    seen = deviation > 1e-9
    assert seen.sum() == (3 if is_singular else 6)
    np.testing.assert_allclose(found[1:].std(0)[seen], deviation[seen], rtol=4 / np.sqrt(2 * 4000))


@pytest.mark.parametrize("joint", ['<joint axis="1 0 0"/>', ""], ids=["hinge", "weld"])
def test_forces_of_an_mjcf_sensor_are_those_of_mujoco(joint):
    """Also where the body of the site is welded to another."""
    mujoco = pytest.importorskip("mujoco")
    hand = f'<body name="hand" pos=".4 0 0">{joint}<geom type="box" size=".1 .05 .02" pos=".1 .05 0"/>'
    site = '<site name="wrist" pos=".02 0 0" euler="0 40 0"/></body></body></worldbody>'
    arm = '<body name="arm"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .4 0 0" size=".05"/>'
    sensors = '<sensor><force name="force" site="wrist"/><torque name="torque" site="wrist"/></sensor>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{arm}{hand}{site}{sensors}</mujoco>")
    mech, data = js.Mechanism.from_mjcf(model, dtype=np.float64), mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = [0.4, -0.7][: model.nq], [2.0, -3.0][: model.nq]
    mujoco.mj_forward(model, data)
    sensed = recipes(mujoco=mujoco)["sensed"]
    for name in ("force", "torque"):
        found = interpreted(lambda *x, name=name: sensed(mech, model, name, *x))(data.qpos, data.qvel, data.qacc)
        np.testing.assert_allclose(found, data.sensor(name).data, atol=1e-10)


def test_the_picture_can_be_drawn_again(tmp_path):
    """In the size of the one beside the page, and of few bytes."""
    pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    from tests.helpers import sensor_picture

    sensor_picture.save(tmp_path / "again.png")
    assert imread(tmp_path / "again.png").shape == imread(sensor_picture.FILE).shape
    assert sensor_picture.FILE.stat().st_size < 100_000
