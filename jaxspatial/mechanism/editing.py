"""Makes mechanisms of others: adds frames, locks joints, takes out subtrees."""

import dataclasses
import math
import operator
from collections.abc import Iterable, Mapping

import jax
import numpy as np
import numpy.typing as npt

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.assembly import composed, is_identity, or_identity
from jaxspatial.mechanism.joints import JointKind, Parameter
from jaxspatial.mechanism.mechanism import Mechanism
from jaxspatial.mechanism.parts import PER_VELOCITY, WORLD, Body, Frame, Joint
from jaxspatial.mechanism.tendons import Tendon
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.linear import unit
from jaxspatial.numerics.numbers import Rounded, high
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.numerics.precision import DEFAULT
from jaxspatial.numerics.types import ArrayLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, act_inverse

# {field of a Joint: field of a Mechanism}
_PER_COORDINATE = {"lower": "lower", "upper": "upper", "spring_reference": "spring_references"}


def add_frames(mechanism: Mechanism, frames: Iterable[Frame]) -> Mechanism:
    """Adds named frames: tools, sensors, points of contact.

        js.add_frames(mech, [js.Frame("tool", "link7", X_LT)])

    All functions that take names of frames take these. No number of the mechanism changes.

    Args:
        mechanism: with known numbers.
        frames: named places. Their `body` is the name of a body, of any frame there is, or of an earlier one of these;
            `placement` is their pose on it.

    Returns:
        The mechanism with these frames after its own, with NumPy numbers.

    Raises:
        KeyError: a name of a body is that of no frame; lists those there are.
        TypeError: numbers of the mechanism are data, or traced, or a placement is no single RigidTransform.
        ValueError: a frame has the name of another.

    Error: a few u of float64, rounded once to the dtype, where two poses multiply; else the pose, rounded once.

    Example:
        >>> with_tool = js.add_frames(arm, [js.Frame("tool", "hand")])
        >>> with_tool.frame_names
        ('world', 'upper', 'lower', 'hand', 'tool')
    """
    _require_known(mechanism)
    t, places = mechanism.topology, mechanism.frame_placements
    named, new, carried_by = list(t.frames), list[RigidTransform](), list(t.carried_by)
    with in_double():
        poses = [_item(jax.tree.map(lambda x: x.astype(np.float64), places), i) for i in range(len(named))]
        for frame in check.as_tuple(frames, Frame, "add_frames: frames", "Frame objects"):
            names = tuple(name for name, _ in named)
            if frame.name in names:
                raise ValueError(f"add_frames: frames: there is a frame {frame.name!r} already")
            i = t.index(names, frame.body, f"add_frames: Frame {frame.name!r}: body")
            named.append((frame.name, named[i][1]))
            carried_by.append(i)
            poses.append(composed(poses[i], or_identity(frame, "placement")))
            new.append(poses[-1])
    placements = jax.tree.map(lambda old, *x: np.stack([*old, *x]).astype(old.dtype), places, *new)
    topology = dataclasses.replace(t, frames=tuple(named), carried_by=tuple(carried_by))
    return dataclasses.replace(mechanism, topology=topology, frame_placements=placements)._as_known()


def lock_joints(mechanism: Mechanism, positions: Mapping[str, ArrayLike]) -> Mechanism:
    """Locks joints at given coordinates: their bodies merge with those that carry them.

    Locked joints leave no operation in programs. Locked bodies stay as frames, and loops as they are. A mimic is locked
    with the joint that it follows. `joint_reactions` at a locked joint go by its name; the bodies of joints that were
    fixed before are frames like others, without reactions of their own.

    Args:
        mechanism: with known numbers.
        positions: coordinates by joint name, a number or as many as the joint has; rad or m.

    Returns:
        The mechanism of the other joints, with NumPy numbers.

    Raises:
        KeyError: a name is no joint's; lists those there are.
        ValueError: a joint is a mimic, or its coordinates are not finite or not as many as it has, or a quaternion has
            the length 0.
        TypeError: numbers of the mechanism are data, or traced; positions are no mapping to known numbers.

    Error: a few u of float64, rounded once to the dtype, where numbers change; others stay as they are.

    Example:
        >>> stiff = js.lock_joints(arm, {"elbow": 0.0})
        >>> print(stiff.joint_names, js.mass_matrix(stiff, jnp.zeros(1)))
        ('shoulder',) [[5.3333]]
    """
    (bodies, joints, frames), t = parts(mechanism), mechanism.topology
    if not isinstance(positions, Mapping):
        check.refuse("lock_joints: positions", "a mapping from names of joints", positions)
    locked = dict[str, float]()
    for name, given in positions.items():
        i = t.index(t.joint_names, name, "lock_joints: positions")
        q = _position(given, f"lock_joints: positions[{name!r}]", t.kind(i).nq)
        if t.is_mimic(i):
            followed = t.joint_names[t.followed[i]]
            raise ValueError(f"lock_joints: {name!r} is a mimic: lock {followed!r}, which it follows")
        mimics = [k for k in range(len(t)) if t.followed[k] == i and k != i]
        for k, x in [(i, q), *((k, mechanism.mimics[k, 0] * q + mechanism.mimics[k, 1]) for k in mimics)]:
            joints[k] = _locked(mechanism, joints, k, x)
            if np.size(x) == 1:
                locked[joints[k].name] = float(np.ravel(x)[0])
    return _rebuilt(mechanism, bodies, joints, frames, locked)


def subtree(mechanism: Mechanism, body: str) -> Mechanism:
    """Takes out a body and all that hangs on it; the world takes the place of its parent.

    Args:
        mechanism: with known numbers.
        body: one of `mechanism.body_names`.

    Returns:
        The mechanism of these bodies and their frames, with NumPy numbers, and with the loops that close between frames
        that are left, and the tendons over joints that are left alone.

    Raises:
        KeyError: there is no such body; lists those there are.
        TypeError: numbers of the mechanism are data, or traced.

    Error: a few u of float64, rounded once to the dtype, where numbers change; others stay as they are.

    Example:
        >>> js.subtree(arm, "lower").body_names
        ('lower',)
    """
    t = mechanism.topology
    root = t.index(mechanism.body_names, body, "subtree: body")
    numbers = [i for i in range(len(t)) if root in t.ancestors(i)]
    names = {t.body_names[i] for i in numbers}
    bodies, joints, frames = parts(mechanism)
    bodies, frames = [b for b in bodies if b.name in names], [f for f in frames if f.body in names]
    joints = [dataclasses.replace(joints[i], parent=WORLD) if i == root else joints[i] for i in numbers]
    return _rebuilt(mechanism, bodies, joints, frames)


def _rebuilt(
    mechanism: Mechanism,
    bodies: list[Body],
    joints: list[Joint],
    frames: list[Frame],
    locked: Mapping[str, float] | None = None,
) -> Mechanism:
    """A mechanism of these parts, with what else there is to a mechanism."""
    names = {WORLD, *(part.name for part in (*bodies, *frames))}
    loops = [loop for loop in mechanism.loops if {loop.frame_a, loop.frame_b} <= names]
    own, locked = {joint.name for joint in joints}, locked or {}
    # The length of a tendon over locked joints alone is constant: it does nothing.
    left = (x for x in mechanism.tendons if {*x.joints} <= own and not {*x.joints} <= locked.keys())
    tendons = [_over(x, locked) for x in left]
    return Mechanism.build(bodies, joints, frames, mechanism.gravity, mechanism.dtype, loops, tendons)


def _over(tendon: Tendon, locked: Mapping[str, float]) -> Tendon:
    """The tendon over the joints that are not locked at known coordinates."""
    if not locked.keys() & set(tendon.joints):
        return tendon
    c = dict(zip(tendon.joints, np.asarray(tendon.coefficients, np.float64).tolist(), strict=True))
    offset = float(tendon.offset) + sum(x * locked[name] for name, x in c.items() if name in locked)
    left = [name for name in tendon.joints if name not in locked]
    return dataclasses.replace(tendon, joints=left, coefficients=np.array([c[x] for x in left]), offset=offset)


def parts(mechanism: Mechanism) -> tuple[list[Body], list[Joint], list[Frame]]:
    """Takes a mechanism apart into the bodies, joints and frames that `Mechanism.build` makes it of.

    Raises:
        TypeError: numbers of the mechanism are data, or traced.

    Example:
        >>> from jaxspatial.mechanism.editing import parts
        >>> bodies, joints, frames = parts(arm)
        >>> bodies[0].name, joints[0].kind, frames[0].name
        ('upper', 'revolute', 'hand')
    """
    _require_known(mechanism)
    with in_double():
        n = len(mechanism.topology)
        mechanism = jax.tree.map(operator.methodcaller("astype", np.float64), mechanism._as_known())
        bodies, joints = [_body(mechanism, i) for i in range(n)], [_joint(mechanism, i) for i in range(n)]
        frames, names = list[Frame](), {WORLD, *mechanism.body_names}
        for k, (name, i) in enumerate(mechanism.topology.frames):
            if name not in names:
                frames.append(Frame(name, *_on_body(mechanism, i, _item(mechanism.frame_placements, k))))
        return bodies, joints, frames


def _require_known(mechanism: Mechanism) -> None:
    if not all(isinstance(x, np.ndarray) for x in jax.tree.leaves(mechanism)):
        raise TypeError("mechanism: expected known numbers (NumPy), got data; build, and replace numbers after")


def _item(tree, i: int):
    return jax.tree.map(operator.itemgetter(i), tree)


def _body(mechanism: Mechanism, i: int):
    """The body with its inertias about its own frame."""
    X_JB = _item(mechanism.child_placements, i)

    def own(inertias: SpatialInertia | None) -> SpatialInertia | None:
        M = jax.tree.map(np.asarray, _item(inertias, i)) if inertias is not None else None
        return M if M is None or is_identity(X_JB) else act_inverse(X_JB, M)

    return Body(mechanism.body_names[i], own(mechanism.inertias), own(mechanism.lifts))


def _joint(mechanism: Mechanism, i: int):
    t, fields = mechanism.topology, {}
    parent, X_PJ = _on_body(mechanism, t.parents[i], _item(mechanism.placements, i))
    if not t.is_mimic(i):
        fields = {name: getattr(mechanism, name)[t.v_slice(i)] for name in PER_VELOCITY}
        fields |= {name: getattr(mechanism, field)[t.q_slice(i)] for name, field in _PER_COORDINATE.items()}
    return Joint(
        t.joint_names[i],
        t.kinds[i],
        parent,
        t.body_names[i],
        placement=X_PJ,
        child_placement=_item(mechanism.child_placements, i),
        axis=mechanism.axes[i],
        second_axis=mechanism.second_axes[i],
        pitch=float(mechanism.pitches[i]),
        parameters={p.name: mechanism.parameters[p.name][i] for p in t.kind(i).parameters if p.field is None},
        mimic=(t.joint_names[t.followed[i]], *mechanism.mimics[i].tolist()) if t.is_mimic(i) else None,
        turn_limit=math.inf if mechanism.turn_limits is None else float(mechanism.turn_limits[i]),
        **fields,
    )


def _on_body(mechanism: Mechanism, i: int, X_JF: RigidTransform):
    """(the name of body i, or of the world for -1; X_BF of a frame that is at X_JF on its joint)."""
    if i < 0:
        return WORLD, X_JF
    X_JB = _item(mechanism.child_placements, i)
    X_BJ = X_JB if is_identity(X_JB) else jax.tree.map(np.asarray, X_JB.inverse())
    return mechanism.body_names[i], composed(X_BJ, X_JF)


def _position(x, name: str, n: int):
    """The known coordinates of a joint that has n."""
    q = floats.as_float_array(x, name, np.dtype(np.float64), keep_dtype=True)
    if not floats.is_computed(q):
        raise TypeError(f"{name}: expected known numbers, got {check.in_short(q)}")
    q = np.asarray(q, np.float64)
    if q.shape not in ((), (n,)):
        raise ValueError(f"{name}: expected a number or {n} of them, got shape {q.shape}")
    if not np.isfinite(q).all():
        raise ValueError(f"{name}: expected finite numbers, got {q.tolist()}")
    return q


def _locked(mechanism: Mechanism, joints: list[Joint], i: int, q: npt.ArrayLike):
    t, joint = mechanism.topology, joints[i]
    q = np.broadcast_to(np.asarray(q, np.float64), (t.kind(i).nq,))
    if (n := t.kind(i).sphere[0]) and not 0 < abs(q[:n]).max() < np.inf:
        raise ValueError(f"lock_joints: positions[{joint.name!r}]: expected a length above 0, got {q[:n].tolist()}")
    with in_double():
        X = composed(or_identity(joint, "placement"), _transform(t.kind(i), joint, q))
    return Joint(joint.name, "fixed", joint.parent, joint.child, X, joint.child_placement)


def _transform(kind: type[JointKind], joint: Joint, q: np.ndarray):
    """X_PB of a joint at known coordinates."""

    def number(x: float):
        return Rounded(DEFAULT, np.float64(x))

    def of_joint(p: Parameter):
        value = np.ravel(getattr(joint, p.name) if p.field else joint.parameters[p.name]).tolist()
        return tuple(map(number, value)) if p.size > 1 else number(value[0])

    cos_sin = {k: (number(np.cos(q[k])), number(np.sin(q[k]))) for k in kind.angles}
    coordinates, n = tuple(map(number, q)), kind.sphere[0]
    coordinates = (*unit(coordinates[:n]), *coordinates[n:]) if n else coordinates
    rows, p = kind(of_joint, number(0.0)).transform(coordinates, cos_sin)
    entries = np.array([float(high(x)) for row in rows for x in row])
    return RigidTransform(Rotation(entries), np.array([float(high(x)) for x in p]))
