"""To and from jaxlie's SO3 and SE3, batched, traced or not, in both directions. U is the unit roundoff."""

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop
from jaxspatial.interop import orders
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but
from tests.helpers.optional import needs

jaxlie = needs("jaxlie")

DTYPES = {"float32": 2.0**-24, "float64": 2.0**-53}
every_dtype = pytest.mark.parametrize(
    ("dtype", "u"), slow_but([("float32", DTYPES["float32"])], DTYPES.items()), ids=DTYPES
)


@pytest.fixture(autouse=True)
def relaxed(request):
    """jaxlie mixes integers and float64 into its sums, and ranks."""
    wide = "float64" in request.node.name
    with jax.enable_x64(wide), jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


def twists(dtype):
    """Angles from 0.1 to pi, where jaxlie's exponential is good."""
    rng = np.random.default_rng(0)
    w, v = rng.normal(size=(2, 50, 3))
    w *= rng.uniform(0.1, 3.1, (50, 1)) / np.linalg.norm(w, axis=-1, keepdims=True)
    return js.SpatialVelocity(w.astype(dtype), v.astype(dtype))


def near(ours, theirs, tolerance):
    assert ours.dtype == theirs.dtype
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance)


@every_dtype
def test_so3_both_ways_and_what_it_does(dtype, u):

    def both(w, v):
        ours = js.Rotation.exp(w)
        theirs = interop.jaxlie.to_so3(ours)
        back = interop.jaxlie.from_so3(theirs).to_matrix()
        moved = ours @ v, jax.vmap(jaxlie.SO3.apply)(theirs, v)
        return theirs.as_matrix(), ours.to_matrix(), back, moved, (ours.log(), theirs.log())

    v = np.random.default_rng(1).normal(size=(50, 3)).astype(dtype)
    theirs, ours, back, moved, logarithms = interpreted(both)(twists(dtype).w, v)
    near(theirs, ours, 12 * u)
    near(back, ours, 16 * u)
    near(*moved, 128 * u)
    near(*logarithms, 64 * u)


@every_dtype
def test_se3_both_ways_and_what_it_does(dtype, u):
    V = twists(dtype)

    def both(V):
        theirs = jaxlie.SE3.exp(orders.to_linear_first(V))
        ours = interop.jaxlie.from_se3(theirs)
        back, log = interop.jaxlie.to_se3(ours), orders.from_linear_first(js.SpatialVelocity, theirs.log())
        translations = back.translation(), theirs.translation()
        matrices = theirs.as_matrix(), ours.to_matrix(), js.RigidTransform.exp(V).to_matrix(), back.as_matrix()
        return matrices, translations, (log.to_array(), V.to_array())

    (theirs, ours, own, back), translations, logarithms = interpreted(both)(V)
    near(ours, theirs, 16 * u)
    near(own, theirs, 256 * u)
    near(back, theirs, 16 * u)
    np.testing.assert_array_equal(*translations)
    near(*logarithms, 1024 * u)


@every_dtype
def test_adjoint_is_the_motion_matrix(dtype, u):

    def both(V):
        X = js.RigidTransform.exp(V)
        theirs, ours = interop.jaxlie.to_se3(X).adjoint(), X.to_motion_matrix()
        return (ours, orders.matrix_from_linear_first(theirs)), (orders.matrix_to_linear_first(ours), theirs)

    for ours, theirs in interpreted(both)(twists(dtype)):
        near(ours, theirs, 64 * u)


def test_under_jit_and_vmap():
    X = js.RigidTransform.exp(twists(np.float32))
    round_trip = jax.jit(jax.vmap(lambda x: interop.jaxlie.from_se3(interop.jaxlie.to_se3(x))))
    near(round_trip(X).to_matrix(), X.to_matrix(), 16 * 2.0**-24)
