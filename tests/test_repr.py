"""What JAX rebuilds with other leaves than numbers can be shown: shapes, tracers, axes, anything."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.test_export import EXAMPLES

LEAVES = {
    "None": None,
    "object": object(),
    "axis": 0,
    "text": "x",
    "list": [1],
    "nan": float("nan"),
    "shape": jax.ShapeDtypeStruct((3,), np.float32),
    "sharding": jax.sharding.PartitionSpec("x"),
    "no tangent": np.zeros((), jax.dtypes.float0),
    "objects": np.array([None]),
    "empty": np.zeros((0, 3)),
}


def _is_shown(x):
    assert str(x) == repr(x)
    assert repr(x).startswith((type(x).__name__, f"<jaxspatial.{type(x).__module__.split('.')[1]}"))


def _with_one(x, leaf):
    """x with each of its leaves in turn in the place of which this one is, and with all of them."""
    leaves, structure = jax.tree.flatten(x)
    for i in range(len(leaves)):
        yield jax.tree.unflatten(structure, [*leaves[:i], leaf, *leaves[i + 1 :]])
    yield jax.tree.unflatten(structure, [leaf] * len(leaves))


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_any_leaves_are_shown(name):
    x = EXAMPLES[name]()
    for leaf in (*LEAVES.values(), jax.random.key(0)):
        for changed in _with_one(x, leaf):
            _is_shown(changed)


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_what_is_traced_is_shown(name):
    x = EXAMPLES[name]()
    _is_shown(jax.eval_shape(lambda: x))
    jax.make_jaxpr(_is_shown)(x)
    two = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), x)
    jax.make_jaxpr(jax.vmap(lambda x, _: _is_shown(x)))(two, jnp.zeros(2))


def test_what_was_donated_is_shown():
    f = jnp.ones(3)
    for x in (js.SpatialForce(f, f), js.to_double_word(f), js.Components(f[0], 0.0, 1.0)):
        for leaf in jax.tree.leaves(x):
            leaf.delete()
        _is_shown(x)


@pytest.mark.parametrize("leaf", LEAVES.values(), ids=LEAVES)
def test_a_mechanism_is_its_tree_whatever_its_numbers_are(leaf):
    mech = js.testing.random_mechanism(0, n=3, dtype=np.float32)
    head, *tree = repr(jax.tree.map(lambda _: leaf, mech)).splitlines()
    assert head.startswith("Mechanism(nq=") and tree == repr(mech).splitlines()[1:]


def test_parts_of_a_mechanism_are_shown():
    X, M = jax.eval_shape(lambda: (js.RigidTransform.identity(), js.SpatialInertia.solid_sphere(0.1, mass=1.0)))
    for part in (js.Body("b", M), js.Frame("f", "b", X), js.Joint("j", "fixed", "world", "b", X)):
        _is_shown(part)
