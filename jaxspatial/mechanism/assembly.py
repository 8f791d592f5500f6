"""From the parts that a caller names to the arrays of a Mechanism: the tree put in order, welded bodies merged."""

import functools
import operator

import jax
import numpy as np

from jaxspatial.arithmetic.known import in_double
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joints import KINDS
from jaxspatial.mechanism.parts import WORLD, Body, Frame, Joint, Mimic
from jaxspatial.mechanism.topology import Topology
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, act

# How far the length of a quaternion may be from 1.
_UNIT = 1e-3
# How these go with the ratio of a gear.
_POWERS = {"armature": 2, "damping": 2, "friction_loss": 1, "stiffness": 2}


def assembled(bodies, joints, frames):
    """(Topology, its arrays by name) of parts: what `Mechanism` consists of but for gravity, in float64."""
    _check_names(bodies, joints, frames)
    with in_double():
        tree = _Tree({b.name: b for b in bodies}, {j.name: j for j in joints})
        tree.hang(WORLD, -1, _identity())
        _check_reached(bodies, tree)
        for frame in frames:
            tree.add_frame(frame)
        return tree.topology(), tree.arrays()


class _Tree:
    """What has been hung up so far."""

    def __init__(self, bodies, joints):
        self.bodies = bodies
        self.held = {}
        for joint in joints.values():
            self.held.setdefault(joint.parent, []).append(joint)
        self.moving, self.parents, self.placements, self.masses = [], [], [], []
        # Of every body: the moving one that it is a part of, and where on it.
        self.places = {}

    def hang(self, name, carrier, X):
        """The body at X on the moving body number `carrier`, and all that hangs on it: each body right behind its
        parent or a branch of it, as chains need it."""
        pending = self._put(name, carrier, X)
        while pending:
            pending += self._put(*self._hung(*pending.pop()))

    def _put(self, name, carrier, X):
        """What hangs on a body, the first joint last."""
        self.places[name] = carrier, X
        if carrier >= 0 and self.bodies[name].inertia is not None:
            self.masses[carrier].append(act_unless_identity(X, self.bodies[name].inertia))
        return [(joint, carrier, X) for joint in reversed(self.held.get(name, []))]

    def _hung(self, joint, carrier, X):
        placement = composed(X, _or_identity(joint, "placement"))
        child = _or_identity(joint, "child_placement")
        if joint.kind == "fixed":
            return joint.child, carrier, composed(placement, child)
        self.moving.append(joint)
        self.parents.append(carrier)
        self.placements.append(placement)
        self.masses.append([])
        return joint.child, len(self.moving) - 1, child

    def add_frame(self, frame):
        if frame.body not in self.places:
            raise ValueError(f"Frame {frame.name!r}: body: there is no body {frame.body!r}")
        carrier, X = self.places[frame.body]
        self.places[frame.name] = carrier, composed(X, _or_identity(frame, "placement"))

    # -- results ------------------------------------------------------------------------------------------------------

    def topology(self):
        names = [joint.name for joint in self.moving]
        return Topology(
            body_names=tuple(joint.child for joint in self.moving),
            joint_names=tuple(names),
            kinds=tuple(joint.kind for joint in self.moving),
            parents=tuple(self.parents),
            masters=tuple(self._master(names, i) for i in range(len(names))),
            frames=tuple((name, carrier) for name, (carrier, _) in self.places.items()),
        )

    def _master(self, names, i):
        joint = self.moving[i]
        if joint.mimic is None:
            return i
        mimic = Mimic(*joint.mimic)
        master = names.index(mimic.joint) if mimic.joint in names else None
        both = (joint,) if master is None else (joint, self.moving[master])
        if len(both) < 2 or both[1].mimic is not None or any(KINDS[x.kind].nq != 1 for x in both):
            raise ValueError(
                f"Joint {joint.name!r}: mimic: expected the name of a joint with one coordinate of its own"
            )
        return master

    def arrays(self):
        own = [joint for joint in self.moving if joint.mimic is None]
        limits = {"effort_limit": "nv", "velocity_limit": "nv", "lower": "nq", "upper": "nq"}
        return {
            "placements": _stacked(self.placements),
            "child_placements": _stacked([_or_identity(joint, "child_placement") for joint in self.moving]),
            "axes": _rows([_unit(joint, "axis") for joint in self.moving], 3),
            "second_axes": _rows([_unit(joint, "second_axis") for joint in self.moving], 3),
            "pitches": np.array([float(joint.pitch) for joint in self.moving]),
            "mimics": _rows([Mimic(*joint.mimic)[1:] if joint.mimic else (1.0, 0.0) for joint in self.moving], 2),
            "inertias": _inertias(self.masses),
            "frame_placements": _stacked([X for _, X in self.places.values()]),
            **{name: self._felt(own, name, power) for name, power in _POWERS.items()},
            **{name: _per(own, name, size) for name, size in limits.items()},
            "spring_references": self._references(own),
        }

    def _references(self, own):
        """Where the springs of each joint and its mimics together rest: the mean of where each does, by stiffness."""
        return np.concatenate([np.zeros(0), *(self._rests(joint) for joint in own)])

    def _rests(self, joint):
        own = _spring_reference(joint)
        springs = [
            _as_of_master(mimic) for mimic in self.moving if mimic.mimic and Mimic(*mimic.mimic)[0] == joint.name
        ]
        stiffness = _per([joint], "stiffness", "nv")[0] if springs else 0.0
        total = stiffness + sum(k for k, _ in springs)
        return own if not total else sum((k * x for k, x in springs), stiffness * own) / total

    def _felt(self, own, name, power):
        """One number per rate: what a mimic has of it, its master feels."""
        found = np.split(_per(own, name, "nv"), np.cumsum([KINDS[joint.kind].nv for joint in own])[:-1])
        places = {joint.name: k for k, joint in enumerate(own)}
        for joint in self.moving:
            if joint.mimic is not None:
                mimic = Mimic(*joint.mimic)
                found[places[mimic.joint]] += abs(mimic.multiplier) ** power * _per([joint], name, "nv")
        return np.concatenate([np.zeros(0), *found])


# -- checks -----------------------------------------------------------------------------------------------------------


def _check_names(bodies, joints, frames):
    for what, kind, parts in (("bodies", Body, bodies), ("joints", Joint, joints), ("frames", Frame, frames)):
        for part in parts:
            if not isinstance(part, kind):
                raise TypeError(f"Mechanism.build: {what}: expected {kind.__name__}s, got {type(part).__name__}")
        _check_unique(what, [part.name for part in parts])
    for body in bodies:
        if body.inertia is not None:
            _check_single(body, "inertia", SpatialInertia)
    _check_unique("bodies and frames", [WORLD, *(b.name for b in bodies), *(f.name for f in frames)])
    _check_unique("joints: children", [joint.child for joint in joints])
    for joint in joints:
        for side, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in {body.name for body in bodies} and (name, side) != (WORLD, "parent"):
                raise ValueError(f"Joint {joint.name!r}: {side}: there is no body {name!r}")


def _check_single(part, name, kind):
    x = getattr(part, name)
    if not isinstance(x, kind) or x.batch_shape:
        came = f"a batch of shape {x.batch_shape}" if isinstance(x, kind) else type(x).__name__
        raise TypeError(f"{type(part).__name__} {part.name!r}: {name}: expected a single {kind.__name__}, got {came}")


def _check_unique(what, names):
    seen = set()
    for name in names:
        if name in seen:
            raise ValueError(f"Mechanism.build: {what}: {name!r} comes twice")
        seen.add(name)


def _check_reached(bodies, tree):
    lost = [body.name for body in bodies if body.name not in tree.places]
    if lost:
        raise ValueError(f"Mechanism.build: joints: nothing holds {', '.join(map(repr, lost))} against the world")


# -- arrays -----------------------------------------------------------------------------------------------------------


def _identity():
    return RigidTransform.identity(dtype=np.float64)


def _or_identity(part, name):
    X = getattr(part, name)
    if X is None:
        return _identity()
    _check_single(part, name, RigidTransform)
    return jax.tree.map(known, X)


def known(x):
    if isinstance(x, jax.core.Tracer):
        raise TypeError(
            "Mechanism.build: expected known numbers (NumPy), got data that is traced; build with known ones, and put "
            "data in their place with Mechanism.replace (results within jax.ensure_compile_time_eval() are known)"
        )
    return np.asarray(x, np.float64)


def is_identity(X):
    return not X.translation.any() and (X.rotation.entries == np.eye(3).ravel()).all()


def composed(X_AB, X_BC):
    if is_identity(X_AB) or is_identity(X_BC):
        return X_BC if is_identity(X_AB) else X_AB
    return jax.tree.map(known, X_AB @ X_BC)


def act_unless_identity(X_AB, M_BBo_B):
    """M_BAo_A of M_BBo_B, in float64: bit for bit what it was where A is B."""
    M = jax.tree.map(known, M_BBo_B)
    return M if is_identity(X_AB) else jax.tree.map(known, act(X_AB, M))


def _unit(joint, name):
    axis = known(getattr(joint, name))
    # By the largest first, whose square may over- or underflow.
    largest = abs(axis).max() if axis.shape == (3,) else 0.0
    if not (np.isfinite(largest) and largest > 0):
        raise ValueError(f"Joint {joint.name!r}: {name}: expected three numbers, not all zero, got {axis.tolist()}")
    axis = axis / 2.0 ** np.floor(np.log2(largest))
    return axis / np.linalg.norm(axis)


def _rows(rows, n):
    return np.array(rows, np.float64).reshape(len(rows), n)


def _stacked(transforms):
    entries = _rows([X.rotation.entries for X in transforms], 9)
    return RigidTransform(Rotation(entries), _rows([X.translation for X in transforms], 3))


def _inertias(masses):
    merged = [functools.reduce(operator.add, parts) if parts else _nothing() for parts in masses]
    leaves = [jax.tree.leaves(jax.tree.map(known, M)) for M in merged]
    mass, com, central = ([parts[k] for parts in leaves] for k in range(3))
    return SpatialInertia(_rows(mass, 1)[:, 0], _rows(com, 3), _rows(central, 6))


def _nothing():
    return SpatialInertia.zero(dtype=np.float64)


def _as_of_master(joint):
    """(stiffness, reference) of the spring of a mimic, at its master's coordinate: of a q + b, and k, a^2 k."""
    mimic = Mimic(*joint.mimic)
    stiffness = mimic.multiplier**2 * _per([joint], "stiffness", "nv")[0]
    return stiffness, (_spring_reference(joint) - mimic.offset) / (mimic.multiplier or 1.0)


def _spring_reference(joint):
    """The coordinates at which the joint's spring rests."""
    kind = KINDS[joint.kind]
    found = np.array(kind.neutral) if joint.spring_reference is None else _per([joint], "spring_reference", "nq")
    if kind.nq > kind.nv and abs(np.linalg.norm(found[:4]) - 1) > _UNIT:
        came = found[:4].tolist()
        raise ValueError(f"Joint {joint.name!r}: spring_reference: expected a unit quaternion first, got {came}")
    return found


def _per(joints, name, size):
    """One number per rate or coordinate, of what is given per joint."""
    found = []
    for joint in joints:
        n = getattr(KINDS[joint.kind], size)
        value = known(getattr(joint, name))
        if value.shape not in ((), (n,)):
            raise ValueError(f"Joint {joint.name!r}: {name}: expected a number or {n} of them, got shape {value.shape}")
        found.append(np.broadcast_to(value, (n,)))
    return np.concatenate([np.zeros(0), *found])
