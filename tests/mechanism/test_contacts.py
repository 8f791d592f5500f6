"""Spheres that touch, and the ground: what is accepted, what is refused, and what they stay in JAX's hands."""

import dataclasses
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js

NUMBERS = dict(stiffness=1e4, relaxation_time=0.01, friction=0.5)


def test_numbers_stay_what_they_are():
    contacts = js.PointContacts(["a", "b"], np.zeros((2, 3)), np.full(2, 0.1), **NUMBERS)
    assert contacts.frames == ("a", "b") and contacts.batch_shape == () and contacts.dtype == np.float64
    assert all(isinstance(x, np.ndarray) and not x.flags.writeable for x in jax.tree.leaves(contacts))
    traced = js.PointContacts(["a", "b"], **NUMBERS | {"friction": jnp.ones((5, 2), jnp.float32)})
    assert traced.batch_shape == (5,) and traced.dtype == np.float32 and isinstance(traced.stiffness, np.ndarray)
    assert js.PointContacts((), **NUMBERS).frames == ()
    assert contacts.astype(np.float32).dtype == np.float32


def test_numbers_are_learned_and_batched():
    def total(contacts):
        return (contacts.friction * contacts.stiffness).sum()

    contacts = js.PointContacts(["a", "b"], **NUMBERS | {"friction": jnp.array([0.5, 0.25], jnp.float32)})
    contacts = jax.tree.map(jnp.asarray, contacts)
    found = jax.grad(total)(contacts)
    np.testing.assert_array_equal(found.friction, np.float32([1e4, 1e4]))
    axes = js.PointContacts(["a", "b"], None, None, stiffness=None, relaxation_time=None, friction=0)
    many = jax.vmap(lambda x: x.friction * 2, in_axes=(axes,))(contacts)
    np.testing.assert_array_equal(many, np.float32([1, 0.5]))


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"frames": "a"}, TypeError, "PointContacts: frames: expected a sequence of names, got 'a'"),
        ({"positions": np.zeros((3, 3))}, ValueError, r"PointContacts: positions: expected shape \(\*batch, 2, 3\)"),
        ({"friction": np.zeros(3)}, ValueError, r"friction: expected a number, or shape \(\*batch, 2\), got \(3,\)"),
        ({"friction": -0.1}, ValueError, "PointContacts: friction: expected numbers of at least 0, got -0.1"),
        ({"stiffness": 0.0}, ValueError, "PointContacts: stiffness: expected numbers above 0, got 0.0"),
        ({"stiffness": np.nan}, ValueError, "PointContacts: stiffness: expected numbers above 0, got nan"),
        ({"radius": [0.1, np.nan]}, ValueError, "PointContacts: radius: expected numbers of at least 0, got .0.1, nan"),
        ({"relaxation_time": -1.0}, ValueError, "PointContacts: relaxation_time: expected .* at least 0, got -1.0"),
        ({"positions": np.full((2, 3), np.nan)}, ValueError, "PointContacts: positions: expected numbers, got ..nan"),
        ({"friction": jnp.full(2, np.nan)}, None, ""),
        ({"stiffness": None}, TypeError, r"PointContacts: stiffness: expected a number, \(2,\)"),
        ({"radius": 1}, None, ""),
        ({"radius": np.ones(2, int)}, None, ""),
        ({"radius": jnp.ones(2, int)}, TypeError, "PointContacts: radius: expected floating point"),
        (
            {"radius": np.zeros((3, 2)), "friction": np.zeros((4, 2))},
            ValueError,
            "radius and stiffness and relaxation_time and friction: expected batch shapes that broadcast",
        ),
        (
            {"radius": jnp.zeros(2, jnp.float32), "friction": jnp.zeros(2, jnp.float16)},
            TypeError,
            "expected one dtype",
        ),
    ],
)
def test_what_is_refused(changes, error, message):
    arguments = {"frames": ["a", "b"]} | NUMBERS | changes
    if error is None:
        js.PointContacts(**arguments)
        return
    with pytest.raises(error, match=message):
        js.PointContacts(**arguments)


def test_numbers_without_a_default_are_required():
    """The signature says so, and a call without them; JAX rebuilds contacts without any check."""
    parameters = inspect.signature(js.PointContacts).parameters
    required = [name for name, x in parameters.items() if x.default is x.empty]
    assert required == ["frames", "stiffness", "relaxation_time", "friction"]
    assert [name for name, x in parameters.items() if x.kind is x.KEYWORD_ONLY] == required[1:]
    with pytest.raises(TypeError, match="'stiffness', 'relaxation_time', and 'friction'"):
        js.PointContacts(["a"])
    with pytest.raises(TypeError, match="'friction'"):
        js.PointContacts(["a"], stiffness=1.0, relaxation_time=0.0)
    contacts = js.PointContacts(["a"], **NUMBERS)
    leaves, structure = jax.tree.flatten(contacts)
    assert jax.tree.unflatten(structure, ["any"] * len(leaves)).friction == "any"
    changed = dataclasses.replace(contacts, friction=0.25)
    assert changed.friction == 0.25 and changed.stiffness == contacts.stiffness


def test_a_plane_gives_signed_distances():
    with jax.enable_x64(True):
        ground = js.HalfSpace([0.0, 3.0, 4.0], 0.5)
        points = np.random.default_rng(0).normal(size=(7, 3))
        expected = points @ [0, 0.6, 0.8] - 0.5
        np.testing.assert_allclose(ground(points), expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose(jax.vmap(ground)(points), expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose(jax.grad(ground)(points[0]), [0, 0.6, 0.8], rtol=0, atol=1e-15)
        many = js.HalfSpace(jnp.ones((7, 3)), jnp.zeros(7))
        np.testing.assert_allclose(many(points), points.sum(-1) / np.sqrt(3), rtol=0, atol=1e-15)
        np.testing.assert_array_equal(js.HalfSpace()(points), points[:, 2])
        assert ground.astype(np.float32)(np.float32(points)).dtype == np.float32


@pytest.mark.parametrize("size", [1e-30, 1e30])
def test_a_normal_of_any_length(size):
    ground = js.HalfSpace(np.float32(size) * np.float32([0, 0, 1]), np.float32(0.25))
    assert ground(np.float32([1, 2, 3])) == np.float32(2.75)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (((0.0, 0.0, 0.0),), ValueError, "HalfSpace: normal: expected a vector of a length above 0"),
        (((0.0, 1.0),), ValueError, r"HalfSpace: normal: expected shape \(\*batch, 3\), got \(2,\)"),
        ((np.zeros((3, 3), np.float32) + 1, np.zeros(2, np.float32)), ValueError, "normal and offset: expected batch"),
        (((0.0, 0.0, 1.0), "up"), TypeError, "HalfSpace: offset: expected an array of floating point"),
    ],
)
def test_what_a_plane_refuses(arguments, error, message):
    with pytest.raises(error, match=message):
        js.HalfSpace(*arguments)


def test_what_is_shown():
    with jax.enable_x64(True):
        assert repr(js.PointContacts(["a"], np.zeros((1, 3)), **NUMBERS)) == (
            "PointContacts(['a'], positions=float64[1,3], radius=0.0, stiffness=10000.0, relaxation_time=0.01, "
            "friction=0.5)"
        )
        assert repr(js.HalfSpace()) == "HalfSpace([0.0, 0.0, 1.0], 0.0)"
