"""Rotations from quaternions, axes and angles, roll-pitch-yaw, and back, against 160 digits, and round trips.

In NumPy (`interpreted`); the table of operations holds the bits of compiled programs.
"""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from scipy.spatial import transform

import jaxspatial as js
from jaxspatial.numerics import linear
from jaxspatial.numerics.formula import formula
from jaxspatial.rotation import rotation as bounds
from tests.helpers import exact_rotation as exact
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow_but
from tests.helpers.rotation_cases import allowed, of_dtype, wide_dtypes

CASES = [
    ("bfloat16", "reproducible"),
    ("float32", "reproducible"),
    ("float32", "compensated"),
    ("float32", "faithful"),
    ("float64", "fast"),
    ("float64", "compensated"),
]
USUAL = [("float32", "reproducible"), ("float32", "compensated")]
cases = pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, CASES))


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def matrix_errors(R, references):
    """Relative to the size of a rotation, in the Frobenius norm."""
    return np.linalg.norm(exact.differences(R.entries, references), axis=1).max() / np.sqrt(3)


def quaternions(dtype, count=20):
    rng = np.random.default_rng(0)
    q = rng.standard_normal((count, 4))
    q[:4] = np.eye(4)
    q[4:8] += 1e3 * np.eye(4)
    return of_dtype(q, dtype)


@pytest.mark.parametrize(("dtype", "precision"), slow_but([*USUAL, ("float64", "compensated")], CASES))
def test_from_quaternion(dtype, precision):
    q = quaternions(dtype)
    found = evaluated(precision, lambda q: js.Rotation.from_quaternion(q, precision=precision))(q)
    assert matrix_errors(found, [exact.from_quaternion(exact.vector(x)) for x in q]) <= allowed(
        dtype, precision, bounds.FROM_QUATERNION
    )


@pytest.mark.parametrize("precision", js.Precision)
def test_quaternions_of_any_length(precision):
    q = quaternions("float32")
    entries = evaluated(precision, lambda q: js.Rotation.from_quaternion(q, precision=precision).entries)
    scaled = [q * np.float32(2.0**power) for power in (0, -90, -30, 90, 110)]
    bad = np.float32([[0, 0, 0, 0], [np.inf, 1, 0, 0], [1, 0, np.nan, 0]])
    expected, *found, of_bad = np.split(np.asarray(entries(np.concatenate([*scaled, bad]))), 20 * np.arange(1, 6))
    for same in found:
        np.testing.assert_array_equal(same, expected)
    assert np.isnan(of_bad).all() and of_bad.shape == (3, 9)


@cases
def test_to_quaternion(dtype, precision):
    """The unit quaternion of a matrix as rounded: the row of 4 q q^T with the largest diagonal, normalised."""
    R = interpreted(lambda q: js.Rotation.from_quaternion(q, precision="compensated"))(quaternions(dtype))
    found = evaluated(precision, lambda R: R.to_quaternion(precision=precision))(R)
    assert (np.asarray(found[:, 0], float) >= 0).all()
    wrong = exact.differences(found, [exact_quaternion(x) for x in R.entries])
    assert np.linalg.norm(wrong, axis=1).max() <= allowed(dtype, precision, bounds.TO_QUATERNION)


def exact_quaternion(entries):
    q = exact.proportional_to_quaternion(entries)
    return [x / exact.length(q) for x in q]


@wide_dtypes
def test_quaternions_return(dtype):
    """q -> R -> q, also where the row of the largest diagonal changes, and where w is 0."""
    rng = np.random.default_rng(2)
    q = rng.standard_normal((4000, 4))
    q[:1000] = rng.choice([-1, 0, 1], (1000, 4)) + 1e-7 * rng.standard_normal((1000, 4))
    q = q[np.linalg.norm(q, axis=1) > 0.5]
    q = (q / np.linalg.norm(q, axis=1)[:, None] * np.where(q[:, :1] < 0, -1, 1)).astype(dtype)
    back = interpreted(lambda q: js.Rotation.from_quaternion(q).to_quaternion())(q)
    wrong = np.minimum(*(np.linalg.norm((back - s * q).astype(float), axis=1) for s in (1, -1)))
    assert wrong.max() <= 4 * jnp.finfo(dtype).eps
    assert (np.abs(q[:, 0]) < 1e-6)[np.linalg.norm((back - q).astype(float), axis=1) > 1].all()


ANGLES = (0, 1e-30, 1e-8, 1e-3, 0.5, 1.57, 1.5708, 2, 3, 3.14159, 3.1416, -0.7, -2.5, 5, 12.5, -100, 1000)


@cases
def test_axis_and_angle(dtype, precision):
    rng = np.random.default_rng(3)
    axis, angle = (
        of_dtype(rng.standard_normal((len(ANGLES), 3)) * 10 ** rng.uniform(-4, 4, (len(ANGLES), 1)), dtype),
        of_dtype(ANGLES, dtype),
    )
    axis[0] = [0, -1, 0]
    of_axis = evaluated(precision, lambda axis, angle: js.Rotation.from_axis_angle(axis, angle, precision=precision))
    found = of_axis(axis, angle)
    exact_ones = []
    for n, a in zip(map(exact.vector, axis), map(exact.vector, angle), strict=True):
        exact_ones.append(exact.exp([x * a[0] / exact.length(n) for x in n]))
    assert matrix_errors(found, exact_ones) <= allowed(dtype, precision, bounds.FROM_AXIS_ANGLE)
    assert np.isnan(of_axis(0 * axis, angle).entries).all()


@cases
@pytest.mark.parametrize("k", [0, 1, 2])
def test_about_a_coordinate_axis(k, dtype, precision):
    angle = of_dtype(ANGLES, dtype)
    about = evaluated(precision, lambda angle: getattr(js.Rotation, f"about_{'xyz'[k]}")(angle, precision=precision))
    exact_ones = [exact.exp([a if i == k else 0 for i in range(3)]) for (a,) in map(exact.vector, angle)]
    wrong = exact.differences(about(angle).entries, exact_ones)
    assert np.abs(wrong).max() <= allowed(dtype, precision, bounds.SINE)
    assert not np.isfinite(np.asarray(about(of_dtype(np.inf, dtype)).entries, float)).all()


_unit = formula(linear.unit)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_unit_vectors_of_any_length_have_the_bits_of_numpy(dtype):
    """Scaled by the power of two of the largest component, divided by the length."""
    info = np.finfo(dtype)
    lengths = 2.0 ** np.linspace(info.minexp + info.nmant + 2, info.maxexp - 1, 400).round()
    v = (np.random.default_rng(4).uniform(-1, 1, (400, 4)) * lengths[:, None]).astype(dtype)
    w, x, y, z = np.ldexp(v, -np.frexp(abs(v).max(-1, keepdims=True))[1]).T
    length = np.sqrt(((w * w + x * x) + y * y) + z * z)
    bad = np.array([[0, 0, 0, 0], [1, 0, np.nan, 0], [1, 0, np.inf, 0]], dtype)
    found = np.asarray(jax.jit(lambda v: _unit("reproducible", v))(np.concatenate((v, bad))))
    np.testing.assert_array_equal(found[:400], np.stack([w, x, y, z], -1) / length[:, None])
    assert np.isnan(found[400:]).all()


def test_a_unit_vector_takes_one_multiplication_to_scale_a_component():
    """Three made normalising twice as slow, and a rotation by a quaternion slower than what one would write by hand."""
    text = jax.jit(lambda v: _unit("fast", v)).lower(jnp.ones((8, 4), "float32")).as_text()
    # Scaled, squared, and in quotients the half of the divisor that stands in where the dividend is infinite.
    assert text.count("stablehlo.multiply") == 4 + 4 + 4


@pytest.mark.parametrize("precision", ["fast", "reproducible"])
def test_angles_of_many_turns(precision):
    """In proportion to the angle beyond 2048."""
    angles = np.random.default_rng(9).uniform(1, 2, 4000) * np.repeat([1.0, 1e3, 1e4, 1e5, 1e6], 800)
    angles = angles.astype(np.float32)
    entries = np.asarray(js.Rotation.about_x(jnp.asarray(angles), precision=precision).entries, float)
    u, wide = 2.0**-24, angles.astype(float)
    limit = bounds.SINE.allowed(precision, u, np.where(wide <= 2048, 1, wide))
    known = np.isfinite(entries[:, 4])
    assert known[wide < 1e6].all()
    for found, exactly in ((entries[:, 4], np.cos(wide)), (entries[:, 7], np.sin(wide))):
        assert (abs(found - exactly) <= limit)[known].all()


@cases
def test_to_axis_angle(dtype, precision):
    angles = np.array([1e-30, 1e-8, 1e-3, 0.5, 1.57, 2, 3, 3.14])
    rng = np.random.default_rng(4)
    n = rng.standard_normal((len(angles), 3))
    w = n / np.linalg.norm(n, axis=1)[:, None] * angles[:, None]
    R = js.Rotation(of_dtype(interpreted(js.Rotation.exp)(w).entries, dtype))
    axis, angle = evaluated(precision, lambda R: R.to_axis_angle(precision=precision))(R)
    q = [exact_quaternion(x) for x in R.entries]
    sines = [exact.length(x[1:]) for x in q]
    kept = [i for i, s in enumerate(sines) if s]
    exact_axes = [[x / sines[i] for x in q[i][1:]] for i in kept]
    assert np.linalg.norm(exact.differences(axis[np.array(kept)], exact_axes), axis=1).max() <= allowed(
        dtype, precision, bounds.TO_AXIS
    )
    exact_angles = [2 * mp.atan2(s, x[0]) for s, x in zip(sines, q, strict=True)]
    wrong = np.abs(exact.differences(angle, [[x] for x in exact_angles])[:, 0])
    assert (wrong <= allowed(dtype, precision, bounds.TO_ANGLE) * np.array(exact_angles, float)).all()


def test_axis_angle_of_the_identity():
    """The axis is x, derivatives are 0 (a subgradient): finite, in both modes."""
    identities = js.Rotation(np.tile(np.eye(3, dtype=np.float32).ravel(), (2, 1)))
    axis, angle = interpreted(js.Rotation.to_axis_angle)(identities)
    np.testing.assert_array_equal(axis, [[1, 0, 0]] * 2)
    np.testing.assert_array_equal(angle, [0, 0])
    for mode in (jax.jacfwd, jax.jacrev):
        for derivative in interpreted(mode(lambda e: js.Rotation(e).to_axis_angle()))(np.eye(3).ravel()):
            assert not derivative.any()


def rolls_pitches_yaws(dtype):
    rng = np.random.default_rng(5)
    rpy = rng.uniform(-np.pi, np.pi, (24, 3)) * [1, 0.5, 1]
    rpy[:8, 1] = np.sign(rpy[:8, 1]) * (np.pi / 2 - 10.0 ** np.array([-1, -2, -4, -6, -8, -12, -16, -30]))
    rpy[8] = 0
    rpy[9] = 1e-20
    return of_dtype(rpy, dtype)


@cases
def test_from_roll_pitch_yaw(dtype, precision):
    rpy = rolls_pitches_yaws(dtype)
    found = evaluated(precision, lambda rpy: js.Rotation.from_roll_pitch_yaw(rpy, precision=precision))(rpy)
    exact_ones = [exact.from_roll_pitch_yaw(*exact.vector(x)) for x in rpy]
    assert matrix_errors(found, exact_ones) <= allowed(dtype, precision, bounds.FROM_ROLL_PITCH_YAW)


@cases
def test_to_roll_pitch_yaw(dtype, precision):
    """Up to gimbal lock: the rotation stays, roll and yaw in proportion to 1 / cos(pitch)."""
    rpy = rolls_pitches_yaws(dtype)
    R = interpreted(lambda rpy: js.Rotation.from_roll_pitch_yaw(rpy, precision="compensated"))(rpy)
    found = evaluated(precision, lambda R: R.to_roll_pitch_yaw(precision=precision))(R)
    rebuilt = [exact.from_roll_pitch_yaw(*exact.vector(x)) for x in found]
    exact_ones = [exact.from_quaternion(exact_quaternion(x)) for x in R.entries]
    wrong = np.array(
        [[float(a - b) for a, b in zip(x, y, strict=True)] for x, y in zip(rebuilt, exact_ones, strict=True)]
    )
    assert np.linalg.norm(wrong, axis=1).max() / np.sqrt(3) <= allowed(dtype, precision, bounds.TO_ROLL_PITCH_YAW)
    back = np.asarray(found, float)
    assert (np.abs(back[:, 1]) <= np.pi / 2 + 1e-2).all() and (np.abs(back[:, (0, 2)]) <= np.pi + 1e-2).all()
    angles = [exact_angles(x) for x in exact_ones]
    apart, pitches = abs(exact.differences(found, angles)), np.array([float(x[1]) for x in angles])
    apart = np.minimum(apart, abs(apart - 2 * np.pi))
    sizes = 1 / np.maximum(np.cos(pitches), 1e-300)[:, None] ** [1, 0, 1]
    numbers, narrow = abs(np.array(angles, object).astype(float)), jnp.finfo(dtype).bits < 32
    u = float(jnp.finfo(dtype).eps) / 2
    limit = bounds.TO_ROLL.allowed("compensated" if narrow else precision, u, sizes, numbers)
    assert (apart <= limit).all()


def exact_angles(entries):
    """Roll, pitch and yaw of a matrix."""
    R = list(entries)
    return [mp.atan2(R[7], R[8]), mp.atan2(-R[6], mp.sqrt(R[7] ** 2 + R[8] ** 2)), mp.atan2(R[3], R[0])]


@wide_dtypes
def test_scipy_agrees(dtype):
    rng = np.random.default_rng(6)
    q = rng.standard_normal((50, 4)).astype(dtype)
    theirs = transform.Rotation.from_quat(q[:, [1, 2, 3, 0]].astype(float))
    R = interpreted(js.Rotation.from_quaternion)(q)
    log, rpy = interpreted(lambda R: (R.log(), R.to_roll_pitch_yaw()))(R)
    near = 20 * float(jnp.finfo(dtype).eps)
    np.testing.assert_allclose(np.asarray(R.to_matrix(), float), theirs.as_matrix(), rtol=0, atol=near)
    np.testing.assert_allclose(np.asarray(log, float), theirs.as_rotvec(), rtol=0, atol=near)
    np.testing.assert_allclose(np.asarray(rpy, float), theirs.as_euler("xyz"), rtol=0, atol=100 * near)
    back = interpreted(js.Rotation.exp)(of_dtype(theirs.as_rotvec(), dtype))
    np.testing.assert_allclose(np.asarray(back.to_matrix(), float), theirs.as_matrix(), rtol=0, atol=near)


def conversions():
    """(what to differentiate, its formula in 160 digits, where): at the identity, at gimbal lock from below."""
    rng = np.random.default_rng(8)
    return {
        "from_quaternion": (
            lambda x: js.Rotation.from_quaternion(x).entries,
            lambda x: list(exact.from_quaternion(x)),
            rng.standard_normal((5, 4)),
        ),
        "from_roll_pitch_yaw": (
            lambda x: js.Rotation.from_roll_pitch_yaw(x).entries,
            lambda x: list(exact.from_roll_pitch_yaw(*x)),
            np.array([[0.0, 0, 0], [0.1, np.pi / 2, 1], [1, 2, 3], [np.pi, np.pi, np.pi / 4], [1e-30, 1e-8, -7]]),
        ),
        "from_axis_angle": (
            lambda x: js.Rotation.from_axis_angle(x[:3], x[3]).entries,
            lambda x: list(exact.exp([c * x[3] / exact.length(x[:3]) for c in x[:3]])),
            np.array([[1.0, 2, 3, 0], [1, 0, 0, 3], [-1, 2, 0.1, 1e-20], [1, 1, 1, 20]]),
        ),
        "roll, pitch, yaw there and back": (
            lambda x: js.Rotation.from_roll_pitch_yaw(x).to_roll_pitch_yaw(),
            lambda x: x,
            np.array([[0.0, 0, 0], [1, 1, 1], [-3, -1.3, 2.9], [1.6, 0.1, -1.6]]),
        ),
    }  # fmt: skip


CONVERSIONS = conversions()


@pytest.mark.parametrize("name", slow_but(["from_quaternion"], CONVERSIONS))
def test_derivatives_of_conversions(name):
    """Against the exact ones: of a quaternion of any length, of angles."""
    f, formula, x = CONVERSIONS[name]
    expected = np.array([exact.first_derivatives(formula, exact.vector(v)) for v in x]).astype(float)
    for mode in (jax.jacfwd, jax.jacrev):
        found = interpreted(jax.vmap(mode(f)))(x)
        np.testing.assert_allclose(found, expected, rtol=0, atol=100 * 2.0**-52)
