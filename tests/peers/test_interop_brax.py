"""To and from Brax's Transform, Motion and Force, batched, in both directions, and what they do there. U = 2^-24."""

import chex
import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop
from jaxspatial.inertia import SpatialInertia
from tests.helpers.interpreted import interpreted
from tests.helpers.optional import needs

base = needs("brax.base")

U = 2.0**-24
N = 20


@pytest.fixture(autouse=True)
def relaxed():
    """Brax mixes dtypes and ranks."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


def random(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def poses():
    return js.RigidTransform(js.Rotation.exp(2 * random(N, 3)), random(N, 3, seed=1))


def near(ours, theirs, k):
    np.testing.assert_allclose(ours.to_array(), theirs.to_array(), rtol=0, atol=k * U)


@pytest.mark.parametrize(
    ("of", "to", "kind", "theirs"),
    [
        (interop.brax.from_motion, interop.brax.to_motion, js.SpatialVelocity, base.Motion),
        (interop.brax.from_force, interop.brax.to_force, js.SpatialForce, base.Force),
        (interop.brax.from_momentum, interop.brax.to_force, js.SpatialMomentum, base.Force),
    ],
)
def test_spatial_vectors_both_ways(of, to, kind, theirs):
    ours = kind(random(N, 3), random(N, 3, seed=1))
    made = to(ours)
    assert type(made) is theirs
    np.testing.assert_array_equal(made.ang, ours.rotational)
    np.testing.assert_array_equal(made.vel, ours.translational)
    assert type(of(made)) is kind
    np.testing.assert_array_equal(of(made).to_array(), ours.to_array())


def test_a_part_that_is_left_out_becomes_zeros():
    for to, kind in ((interop.brax.to_motion, js.SpatialVelocity), (interop.brax.to_force, js.SpatialForce)):
        made = to(kind(**{kind.__match_args__[1]: np.ones((4, 3), np.float32)}))
        np.testing.assert_array_equal(made.ang, np.zeros((4, 3)))
        np.testing.assert_array_equal(made.vel, np.ones((4, 3)))


def test_transform_both_ways_and_what_it_does():

    def both(ours):
        theirs = interop.brax.to_transform(ours)
        product = jax.vmap(base.Transform.do)(theirs, interop.brax.to_transform(ours.inverse()))
        identity = interop.brax.from_transform(product).rotation.to_matrix()
        return interop.brax.from_transform(theirs).to_matrix(), ours.to_matrix(), product, identity

    back, ours, product, identity = interpreted(both)(poses())
    np.testing.assert_allclose(back, ours, rtol=0, atol=16 * U)
    np.testing.assert_allclose(identity, np.tile(np.eye(3), (N, 1, 1)), rtol=0, atol=32 * U)
    np.testing.assert_allclose(product.pos, 0, atol=64 * U)


def test_do_acts_on_a_force_and_undoes_on_a_motion():
    X, F, V = (
        poses(),
        js.SpatialForce(random(N, 3), random(N, 3, seed=2)),
        js.SpatialVelocity(random(N, 3, seed=3), random(N, 3)),
    )
    frame, force, motion = interop.brax.to_transform(X), interop.brax.to_force(F), interop.brax.to_motion(V)
    near(interop.brax.from_force(jax.vmap(base.Transform.do)(frame, force)), js.act(X, F), 64)
    near(interop.brax.from_motion(jax.vmap(base.Transform.do)(frame, motion)), js.act_inverse(X, V), 64)
    near(interop.brax.from_motion(jax.vmap(base.Transform.inv_do)(frame, motion)), js.act(X, V), 64)


def test_products_agree():
    F, V, W = (kind(random(N, 3, seed=i), random(N, 3, seed=i + 3)) for i, kind in
               enumerate((js.SpatialForce, js.SpatialVelocity, js.SpatialVelocity)))  # fmt: skip
    motion, force = interop.brax.to_motion(V), interop.brax.to_force(F)
    np.testing.assert_allclose(jax.vmap(base.Motion.dot)(motion, force), js.dot(V, F), rtol=0, atol=64 * U)
    near(interop.brax.from_force(jax.vmap(base.Motion.cross)(motion, force)), js.cross(V, F), 64)
    crossed = jax.vmap(base.Motion.cross)(motion, interop.brax.to_motion(W))
    near(interop.brax.from_motion(crossed), js.cross(V, W), 64)


def test_spatial_acceleration_both_ways():
    """Carried along by the motion, a velocity has this spatial acceleration: zero when it is its own."""
    A, V = (
        js.SpatialAcceleration(random(N, 3), random(N, 3, seed=2)),
        js.SpatialVelocity(random(N, 3, seed=3), random(N, 3, seed=4)),
    )
    theirs = interop.brax.to_spatial_acceleration(A, V)
    np.testing.assert_allclose(theirs.vel, A.a - np.cross(V.w, V.v), rtol=0, atol=16 * U)
    near(interop.brax.from_spatial_acceleration(theirs, interop.brax.to_motion(V)), A, 16)


def test_under_jit_and_vmap():
    X = poses()
    round_trip = jax.jit(jax.vmap(lambda x: interop.brax.from_transform(interop.brax.to_transform(x))))
    np.testing.assert_allclose(round_trip(X).to_matrix(), X.to_matrix(), rtol=0, atol=16 * U)


def bodies():
    half = random(N, 3, 3, seed=5)
    second = np.einsum("nij,nkj->nik", half, half)
    central = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3, dtype=np.float32) - second
    return SpatialInertia(np.exp(random(N)), random(N, 3, seed=6), central)


def at_the_origin(M):
    return SpatialInertia(M.mass, np.zeros((N, 3), np.float32), M.central)


def test_inertia_of_links_both_ways():
    M = bodies()
    back = interop.brax.from_inertia(interop.brax.to_inertia(M))
    chex.assert_trees_all_close(back, M, rtol=0, atol=16 * U)


def test_inertia_in_axes_of_its_own():
    """About the link's origin it is what the pose of these axes makes of it."""
    M, X = bodies(), poses()
    own = base.Inertia(transform=interop.brax.to_transform(X), i=M.central_matrix(), mass=M.mass)
    read, expected = interop.brax.from_inertia(own), js.act(X, at_the_origin(M))
    np.testing.assert_allclose(read.to_matrix(), expected.to_matrix(), rtol=0, atol=512 * U)


def test_moved_inertia_both_ways_and_what_it_does():
    """`do` of the pose of the inertia's axes, as Brax's dynamics do it, then `mul`."""
    M, X, V = at_the_origin(bodies()), poses(), js.SpatialVelocity(random(N, 3), random(N, 3, seed=2))

    def both(M, X, V):
        expected = js.act(X, M)
        moved = jax.vmap(base.Transform.do)(interop.brax.to_transform(X), interop.brax.to_inertia(M))
        read, made = interop.brax.from_moved_inertia(moved), interop.brax.to_moved_inertia(expected)
        momentum = interop.brax.from_momentum(jax.vmap(base.Inertia.mul)(made, interop.brax.to_motion(V)))
        return moved, made, (read.to_matrix(), expected.to_matrix()), (momentum, expected @ V)

    moved, made, matrices, momenta = interpreted(both)(M, X, V)
    np.testing.assert_allclose(*matrices, rtol=0, atol=1024 * U)
    np.testing.assert_allclose(made.i, moved.i, rtol=0, atol=1024 * U)
    np.testing.assert_allclose(made.transform.pos, moved.transform.pos, rtol=0, atol=256 * U)
    near(*momenta, 2048)
