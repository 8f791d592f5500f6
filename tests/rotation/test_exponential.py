"""exp, log and their Jacobians against 160 digits, for every angle, with a translation that is not scaled along.

In NumPy (`interpreted`); `test_bits_do_not_depend_on_the_program` is about compiled programs.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.rotation import rotation as bounds
from jaxspatial.spatial import transform as motion_bounds
from tests.helpers import exact_rotation as exact
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.rotation_cases import allowed, eps, wide_dtypes

ANGLES = [
    0,
    1e-30,
    1e-20,
    1e-12,
    1e-8,
    1e-6,
    1e-4,
    1e-2,
    0.1,
    0.3,
    0.6,
    0.99,
    1.0,
    1.01,
    1.3,
    1.57,
    1.8,
    2.1,
    2.4,
    2.7,
    2.9,
]
NEAR_PI = [3.0, 3.1, 3.13, 3.14, 3.1415]
PRECISIONS = [str(p) for p in js.Precision]
DTYPES = ["float16", "bfloat16", "float32", "float64"]
precisions = pytest.mark.parametrize("precision", slow_but(["reproducible"], PRECISIONS))
# Every dtype, every precision, and every way to compute: float32, float64 and double words.
CASES = [
    ("float16", "reproducible"),
    ("bfloat16", "compensated"),
    ("float32", "fast"),
    ("float32", "reproducible"),
    ("float32", "compensated"),
    ("float64", "fast"),
    ("float64", "reproducible"),
    ("float64", "faithful"),
]
USUAL = [("float32", "reproducible"), ("float32", "compensated")]
cases = pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, CASES))
wide_cases = pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, CASES[2:]))


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@functools.cache
def motions(dtype, angles, count=2):
    """(w, v) as arrays of the dtype: random, perpendicular and parallel v, all of size 1."""
    rng = np.random.default_rng(5)
    d = exact.directions(count, rng)
    w = (d * np.array(angles)[:, None, None]).reshape(-1, 3)
    d = np.tile(d, (len(angles), 1))
    v = rng.standard_normal(w.shape)
    v[1::3] = np.cross(v[1::3], d[1::3])
    v[2::6] = d[2::6]
    return w.astype(jnp.dtype(dtype)), v.astype(jnp.dtype(dtype))


@functools.cache
def references(dtype, angles):
    """Lists of exp(w) and of its translation."""
    w, v = (list(map(exact.vector, x)) for x in motions(dtype, angles))
    return [exact.exp(x) for x in w], [exact.translation(x, y) for x, y in zip(w, v, strict=True)]


def moved(dtype, angles, precision):
    w, v = motions(dtype, angles)
    formula = functools.partial(js.RigidTransform.exp, precision=precision)
    X = evaluated(precision, formula)(js.SpatialVelocity(w, v))
    return X.rotation.entries, X.translation


def relative(differences, references):
    """Lengths of differences relative to those of the references."""
    sizes = np.array([float(exact.length(list(r))) for r in references])
    lengths = np.linalg.norm(differences, axis=1)
    return np.where(lengths == 0, 0, lengths / np.where(sizes == 0, 1e-300, sizes))


def matrix_errors(entries, exact_matrices):
    """In the largest singular value, and in the Frobenius norm relative to that of a rotation."""
    d = exact.differences(entries, exact_matrices)
    return np.linalg.norm(d.reshape(-1, 3, 3), 2, axis=(1, 2)), np.linalg.norm(d, axis=1) / np.sqrt(3)


@cases
def test_exp(dtype, precision):
    angles = (*ANGLES, *NEAR_PI, float(np.pi))
    entries, p = moved(dtype, angles, precision)
    assert entries.dtype == p.dtype == jnp.dtype(dtype)
    matrices, translations = references(dtype, angles)
    largest, frobenius = matrix_errors(entries, matrices)
    assert frobenius.max() <= allowed(dtype, precision, bounds.EXP)
    if precision in ("fast", "reproducible"):
        assert largest.max() <= max(allowed(dtype, precision, bounds.EXP), 1.7 * eps(dtype) / 2)
    sizes = np.linalg.norm(np.asarray(motions(dtype, angles)[1], float), axis=1)
    errors = np.linalg.norm(exact.differences(p, translations), axis=1) / sizes
    assert errors.max() <= allowed(dtype, precision, motion_bounds.EXP_TRANSLATION)


@wide_cases
def test_exp_of_more_than_half_a_turn(dtype, precision):
    """The angle itself has an error of u |w|."""
    angles = (np.pi + 1e-3, 3.17, 4.0, 5.0, 2 * np.pi - 1e-3, 2 * np.pi, 7.0, 20.0, 63.0, 1000.0, 1e4)
    entries, p = moved(dtype, angles, precision)
    matrices, translations = references(dtype, angles)
    w, v = (np.asarray(x, float) for x in motions(dtype, angles))
    lengths = np.linalg.norm(w, axis=1)
    growth = bounds.TURNS.allowed(precision, eps(dtype) / 2, lengths)
    spectral, frobenius = matrix_errors(entries, matrices)
    assert (frobenius <= allowed(dtype, precision, bounds.EXP) + growth).all()
    assert (spectral <= max(allowed(dtype, precision, bounds.EXP), 1.7 * eps(dtype) / 2) + growth).all()
    errors = np.linalg.norm(exact.differences(p, translations), axis=1)
    assert (
        errors <= (allowed(dtype, precision, motion_bounds.EXP_TRANSLATION) + growth) * np.linalg.norm(v, axis=1)
    ).all()


def rounded_once(found, references, dtype, bound):
    """Whether every number is off by u |r|, and by u^2 of the size of the whole as the record says."""
    u = eps(dtype) / 2
    whole = np.array([float(exact.length(list(r))) for r in references])[:, None]
    numbers = np.array([[abs(float(x)) for x in r] for r in references])
    return (abs(exact.differences(found, references)) <= u * numbers + bound.u2 * u * u * whole).all()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_every_entry_is_rounded_once(dtype):
    """Not the matrix in its largest singular value, which is off by more than 1.01 u where all entries are by u."""
    angles = (1e-6, 0.1, 1.0, 2.1, 3.1)
    w, _ = motions(dtype, angles)
    q = interpreted(lambda w: js.Rotation.exp(w).to_quaternion())(w)
    matrices, _ = references(dtype, angles)
    from_angles, found = interpreted(
        lambda w, q: [
            f(x, precision="compensated").entries for f, x in ((js.Rotation.exp, w), (js.Rotation.from_quaternion, q))
        ]
    )(w, q)
    assert rounded_once(from_angles, matrices, dtype, bounds.EXP)
    assert rounded_once(found, [exact.from_quaternion(exact.vector(x)) for x in q], dtype, bounds.FROM_QUATERNION)


def test_what_rounding_takes_of_the_squared_angle_is_made_up_for():
    """Near half a turn, where it is largest: in the root mean square 1.3 u next to float64, beyond 1.4 u without."""
    rng = np.random.default_rng(0)
    d = rng.standard_normal((4000, 3))
    w = (d / np.linalg.norm(d, axis=1)[:, None] * rng.uniform(2.5, 3.1, (4000, 1))).astype(np.float32)
    found, exact_ones = (interpreted(lambda w: js.Rotation.exp(w).entries)(x) for x in (w, w.astype(float)))
    errors = np.linalg.norm(found - exact_ones, axis=1) / np.sqrt(3)
    assert np.sqrt((errors**2).mean()) <= 1.3 * 2.0**-24


def rounded_references(dtype, angles):
    matrices, translations = references(dtype, angles)
    entries = np.array([list(m) for m in matrices], object).astype(float)
    # From the nearest float64: for float16 and bfloat16 rounded twice, by far less than their roundoff.
    p = np.array([list(t) for t in translations], object).astype(float)
    return (x.astype(jnp.dtype(dtype)) for x in (entries, p))


@wide_cases
def test_log(dtype, precision):
    """Of the exact motion, rounded: what rounding does to the motion is part of the error, also in "compensated"."""
    angles = (*ANGLES, *NEAR_PI)
    entries, p = rounded_references(dtype, angles)
    X = js.RigidTransform(js.Rotation(entries), p)
    V = evaluated(precision, functools.partial(js.RigidTransform.log, precision=precision))(X)
    w, v = ([exact.vector(x) for x in vs] for vs in motions(dtype, angles))
    assert relative(exact.differences(V.w, w), w).max() <= 8 * eps(dtype) / 2
    assert relative(exact.differences(V.v, v), v).max() <= 8 * eps(dtype) / 2


def exact_log(entries):
    """The rotation vector of the quaternion proportional to the row of 4 q q^T with the largest diagonal, as it is."""
    w, *v = exact.proportional_to_quaternion(entries)
    s = exact.length(v)
    return [x * (2 * mp.atan2(s, w) / s if s else 2 / w) for x in v]


@cases
def test_log_of_the_matrix_as_it_is(dtype, precision):
    angles = (*ANGLES, *NEAR_PI)
    entries, p = rounded_references(dtype, angles)
    X = js.RigidTransform(js.Rotation(entries), p)
    V = evaluated(precision, functools.partial(js.RigidTransform.log, precision=precision))(X)
    w = [exact_log(x) for x in entries]
    v = [exact.left_jacobian(x) ** -1 * mp.matrix(exact.vector(y)) for x, y in zip(w, p, strict=True)]
    assert relative(exact.differences(V.w, w), w).max() <= allowed(dtype, precision, bounds.LOG)
    assert relative(exact.differences(V.v, v), v).max() <= allowed(dtype, precision, motion_bounds.LOG_TRANSLATION)


@wide_dtypes
def test_log_undoes_exp(dtype):
    angles = (*ANGLES, *NEAR_PI)
    w, v = motions(dtype, angles)
    V = interpreted(lambda V: js.RigidTransform.exp(V).log())(js.SpatialVelocity(w, v))
    for computed, given in ((V.w, w), (V.v, v)):
        given = [exact.vector(x) for x in given]
        assert relative(exact.differences(computed, given), given).max() <= 10 * eps(dtype) / 2


@wide_dtypes
def test_at_half_a_turn(dtype):
    """The logarithm jumps to its negative: at exactly pi its largest component is positive."""
    d = exact.directions(20, np.random.default_rng(1))
    q = np.concatenate((np.zeros((len(d), 1)), d), 1).astype(dtype)
    entries = np.array([list(exact.from_quaternion(exact.vector(x))) for x in q], object).astype(float).astype(dtype)
    m = entries.reshape(-1, 3, 3)
    symmetric = js.Rotation(((m + m.transpose(0, 2, 1)) / 2).reshape(-1, 9))
    w = np.asarray(interpreted(js.Rotation.log)(symmetric), float)
    there_and_back = interpreted(lambda w: js.Rotation.exp(w).log())
    largest = np.take_along_axis(w, np.abs(w).argmax(1)[:, None], 1)
    assert (largest > 0).all()
    assert np.abs(np.linalg.norm(w, axis=1) - np.pi).max() <= 4 * eps(dtype) * np.pi
    for sign in (1, -1):
        for step in (1, 4, 100):
            a = (np.pi - sign * step * 4 * eps(dtype)) * d
            back = np.asarray(there_and_back(a.astype(dtype)), float)
            there = a.astype(dtype).astype(float) if sign > 0 else a - 2 * np.pi * d
            wrong = np.minimum(*(np.linalg.norm(back - s * there, axis=1) for s in (1, -1)))
            assert wrong.max() <= 8 * eps(dtype) * np.pi
            if step == 100:
                assert np.linalg.norm(back - there, axis=1).max() <= 8 * eps(dtype) * np.pi


@precisions
@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan, 1e30])
def test_what_is_no_angle_is_nan(bad, precision):
    w = np.array([[bad, 0, 0], [0.3, bad, -1], [bad, bad, bad]])
    exp = evaluated(precision, functools.partial(js.Rotation.exp, precision=precision))
    for dtype in ("bfloat16", "float32", "float64"):
        assert np.isnan(np.asarray(exp(w.astype(jnp.dtype(dtype))).entries, float)).all()
    if not np.isfinite(bad):
        w = np.array([[at, -at / 2, at / 3] for at in (0.3, 2.0, 3.1)])
        entries = np.tile(interpreted(js.Rotation.exp)(w).entries, (9, 1))
        entries[np.arange(27), np.repeat(np.arange(9), 3)] = bad
        log = evaluated(precision, functools.partial(js.Rotation.log, precision=precision))
        assert not np.isfinite(log(js.Rotation(entries))).any()


def transformations(f, *arrays):
    """What jit, vmap, scan and single items make of f, all as arrays over the batch."""
    yield "jit of vmap", jax.jit(jax.vmap(f))(*arrays)
    yield "scan", jax.lax.scan(lambda _, x: (0, f(*x)), 0, arrays)[1]
    yield "one", jax.tree.map(lambda x: x[None], f(*(x[5] for x in arrays)))


@pytest.mark.parametrize("what", ["values", slow("gradients")])
@wide_dtypes
def test_bits_do_not_depend_on_the_program(dtype, what):
    """Values and derivatives in "reproducible", bitwise those of NumPy."""
    w, v = motions(dtype, (0, 1e-30, 1e-4, 0.5, 1.0, 2.0, 3.1, 3.2, 7.0), 3)

    def both(w, v):
        X = js.RigidTransform.exp(js.SpatialVelocity(w, v))
        V = X.log()
        return X.rotation.entries, X.translation, V.w, V.v

    weights = [np.random.default_rng(n).standard_normal(n).astype(dtype) for n in (9, 3, 3, 3)]

    def weighted(w, v):
        terms = (c * x for xs, cs in zip(both(w, v), weights, strict=True) for x, c in zip(xs.T, cs, strict=True))
        return sum(term.sum() for term in terms)

    def gradients(w, v):
        return jax.grad(weighted, (0, 1))(w, v)

    f = {"values": both, "gradients": gradients}[what]
    expected = interpreted(f)(w, v)
    for name, found in transformations(f, w, v):
        want = jax.tree.map(lambda x: x[5:6], expected) if name == "one" else expected
        for a, b in zip(found, want, strict=True):
            np.testing.assert_array_equal(a, b, err_msg=name)


# -- Jacobians --------------------------------------------------------------------------------------------------------


@functools.cache
def exact_jacobians(dtype) -> Any:
    w, v = motions(dtype, JACOBIAN_ANGLES)
    both = [exact.motion_jacobian(exact.vector(x), exact.vector(y)) for x, y in zip(w, v, strict=True)]
    return both, [m**-1 for m in both]


JACOBIAN_ANGLES = (0, 1e-30, 1e-8, 1e-4, 0.1, 0.5, 0.999, 1.001, 1.5, 2.0, 2.5, 3.0, 3.1, 3.1415)


@wide_cases
def test_left_jacobians(dtype, precision):
    w, v = motions(dtype, JACOBIAN_ANGLES)
    V, (J, inverse) = js.SpatialVelocity(w, v), exact_jacobians(dtype)
    for function, given, exact_ones, bound in (
        (js.Rotation.left_jacobian, w, [m[:3, :3] for m in J], bounds.JACOBIAN),
        (js.Rotation.left_jacobian_inverse, w, [m[:3, :3] for m in inverse], bounds.JACOBIAN_INVERSE),
        (js.RigidTransform.left_jacobian, V, J, motion_bounds.MOTION_JACOBIAN),
        (js.RigidTransform.left_jacobian_inverse, V, inverse, motion_bounds.MOTION_JACOBIAN_INVERSE),
    ):
        found = evaluated(precision, functools.partial(function, precision=precision))(given)
        errors = relative(exact.differences(found.reshape(len(w), -1), exact_ones), exact_ones)
        assert errors.max() <= allowed(dtype, precision, bound)
