"""Loops of a mechanism: what becomes of them when a mechanism is changed, made static, written and read."""

import pickle

import jax
import jax.export
import numpy as np
import pytest

import jaxspatial as js

LOOPS = (
    js.LoopClosure("tip", "c", "ball"),
    js.LoopClosure("a", "mark", "distance", 0.1),
    js.LoopClosure("b", "tip", "weld"),
)


def build(loops=LOOPS):
    joints = [
        js.Joint("j", "revolute", "world", "a"), js.Joint("k", "revolute", "a", "b"),
        js.Joint("l", "revolute", "world", "c"),
    ]  # fmt: skip
    frames = [js.Frame("tip", "b"), js.Frame("mark", "world")]
    return js.Mechanism.build([js.Body(x) for x in "abc"], joints, frames, dtype=np.float32, loops=loops)


def told(mech):
    return [(x.frame_a, x.frame_b, x.kind, None if x.distance is None else float(x.distance)) for x in mech.loops]


DISTANCE = float(np.float32(0.1))
TOLD = [("tip", "c", "ball", None), ("a", "mark", "distance", DISTANCE), ("b", "tip", "weld", None)]
KEPT = {
    "built": lambda m: m,
    "replace": lambda m: m.replace(gravity=np.zeros(3, np.float32)),
    "as_data": js.Mechanism.as_data,
    "as_static": js.Mechanism.as_static,
    "known again": lambda m: m.as_static()._as_known(),
    "pickled": lambda m: pickle.loads(pickle.dumps(m)),
    "pickled static": lambda m: pickle.loads(pickle.dumps(m.as_static())),
    "astype": lambda m: m.astype(np.float16).astype(np.float32).replace(loops=m.loops),
    "add_frames": lambda m: js.add_frames(m, [js.Frame("more", "b")]),
    "lock_joints": lambda m: js.lock_joints(m, {"k": 0.5}),
    "a tree": lambda m: jax.tree.map(lambda x: x, m),
}


@pytest.mark.parametrize("change", KEPT.values(), ids=KEPT)
def test_kept(change):
    assert told(change(build())) == TOLD


def test_replaced():
    mech = js.add_frames(build(()), [js.Frame("new", "c")])
    loop = js.LoopClosure("new", "tip", "hinge")
    assert mech.loops == () and repr(mech.replace(loops=[loop]).loops) == repr((loop,))


def test_a_subtree_keeps_what_closes_within():
    """And what closes at the world only while that frame is there."""
    assert told(js.subtree(build(), "a")) == TOLD[2:]
    assert told(js.subtree(build(), "c")) == []


def test_static_ones_differ_by_their_loops():
    others = [build(()), build(LOOPS[:1]), build((js.LoopClosure("tip", "c", "weld"), *LOOPS[1:]))]
    others += [build((LOOPS[0], js.LoopClosure("a", "mark", "distance", 0.2), LOOPS[2]))]
    assert all(build().as_static() != other.as_static() for other in others)
    assert build().as_static() is build().as_static()


@pytest.mark.parametrize("change", [js.Mechanism.as_data, js.Mechanism.as_static])
def test_exported(change):
    mech = change(build())
    blob = jax.export.export(jax.jit(lambda m: (m, m.gravity)))(mech).serialize()
    found, _ = jax.export.deserialize(blob).call(mech)
    assert told(found) == TOLD


def test_distance_is_a_leaf():
    mech = build()
    (distance,) = jax.tree.leaves(mech.loops)
    assert distance.dtype == np.float32 and distance == np.float32(0.1)
    q = np.float32([0.3, 0.4, 0.5])
    slope = jax.grad(lambda loops: js.constraint_error(mech, q, loops)[3])(mech.as_data().loops)
    assert slope[1].distance == -1


def test_repr():
    assert repr(LOOPS[0]) == "LoopClosure('tip', 'c', 'ball')"
    assert repr(LOOPS[1]) == "LoopClosure('a', 'mark', 'distance', 0.1)"
