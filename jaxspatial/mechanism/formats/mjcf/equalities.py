"""Equality constraints of an MJCF: mimics, tendons of one length, and closures of loops.

Those of joints and of fixed tendons are equations, linear in the coordinates; `solved` makes mimics of them, as far as
they are of two joints. Those of bodies and sites close loops.
"""

from typing import NamedTuple

import numpy as np

from jaxspatial.mechanism.formats.mjcf.file import File, pose_of
from jaxspatial.mechanism.formats.mjcf.tendons import is_fixed, linear_form
from jaxspatial.mechanism.loops import Kind, LoopClosure
from jaxspatial.mechanism.parts import Frame
from jaxspatial.mechanism.tendons import Tendon
from jaxspatial.spatial import RigidTransform

# How the warning lists equality constraints that become tendons with equal limits.
_HELD = "equality read as a tendon of one length, which convex_step holds"
# What is this small next to the terms of a sum comes from rounding.
_ROUNDED = 1e-9


def active_equalities(file: File) -> list[int]:
    """The numbers of the equality constraints that are active."""
    return [i for i in range(file.model.neq) if file.model.eq_active0[i] and file.has("EQUALITY", "CONSTRAINT")]


def closure_kinds(file: File) -> dict[int, Kind]:
    """{type of an equality constraint: the kind of closure that it is}."""
    types = file.mujoco.mjtEq
    return {int(types.mjEQ_CONNECT): "ball", int(types.mjEQ_WELD): "weld"}


class _Equation(NamedTuple):
    """sum c q = length, over different joints: constraint number i of the model."""

    i: int
    joints: list[int]
    c: np.ndarray
    length: float


def _equations(file: File) -> list[_Equation]:
    """Those of the equality constraints of joints and tendons."""
    m, types = file.model, file.mujoco.mjtEq
    of = {int(types.mjEQ_JOINT): _equation_of_joints, int(types.mjEQ_TENDON): _equation_of_tendons}
    found = list[_Equation]()
    for i in active_equalities(file):
        if m.eq_type[i] in of:
            found.append(of[int(m.eq_type[i])](file, i))
        elif m.eq_type[i] not in closure_kinds(file):
            expected = "expected joints or tendons that follow others, or bodies that are connected or welded"
            file.refuse("eq", i, f"{expected}; leave it out")
    return found


def _equation_of_joints(file: File, i: int) -> _Equation:
    """q1 - ref1 = a0 + a1 (q2 - ref2), or q1 - ref1 = a0 without joint2."""
    m, (a0, a1) = file.model, _coefficients(file, i)
    j, leader = m.eq_obj1id[i], m.eq_obj2id[i]
    length = a0 + file.reference(j)
    if leader < 0:
        return _Equation(i, [j], np.ones(1), length)
    return _Equation(i, [j, leader], np.array([1.0, -a1]), length - a1 * file.reference(leader))


def _equation_of_tendons(file: File, i: int) -> _Equation:
    """L1 - ref1 = a0 + a1 (L2 - ref2), or L1 - ref1 = a0 without tendon2."""
    m, (a0, a1) = file.model, _coefficients(file, i)
    length, of_joints = a0, dict[int, float]()
    for name, factor in (("obj1id", 1.0), ("obj2id", -a1)):
        tendon = int(getattr(m, f"eq_{name}")[i])
        if tendon < 0:
            continue
        if not is_fixed(file, tendon):
            way_out = "leave the constraint out, or close a loop with a connect"
            file.refuse("eq", i, f"tendon{name[3]}: expected fixed tendons, got {file.name('tendon', tendon)!r} along "
                        f"a rope; {way_out}")  # fmt: skip
        length += factor * float(m.tendon_length0[tendon])
        for j, x in zip(*linear_form(file, tendon), strict=True):
            of_joints[j] = of_joints.get(j, 0.0) + factor * float(x)
    joints = [j for j, x in of_joints.items() if x]
    if not joints:
        file.refuse("eq", i, "tendon1: expected tendons that move, got joints that cancel; leave it out")
    return _Equation(i, joints, np.array([of_joints[j] for j in joints]), length)


def _coefficients(file: File, i: int) -> tuple[float, float]:
    """The polynomial a0 + a1 x of an equality constraint."""
    m = file.model
    if m.eq_obj2id[i] >= 0 and any(m.eq_data[i, 2:5]):
        expected = "expected a polynomial of at most first degree"
        file.refuse("eq", i, f"polycoef: {expected}, got {m.eq_data[i, :5].tolist()}; cut the others, or leave it out")
    return float(m.eq_data[i, 0]), float(m.eq_data[i, 1])


class _Follower(NamedTuple):
    """q = multiplier q[leader] + offset."""

    leader: int
    multiplier: float
    offset: float


def solved(file: File) -> tuple[dict[int, _Follower], list[_Equation]]:
    """({joint: what it follows}, the equations that make no mimic).

    Of two joints the first follows the second. Where it follows another already, the joints that both follow in the
    end take their places. What is left of an equation then says something, nothing, or what cannot be.
    """
    followers, others = dict[int, _Follower](), list[_Equation]()
    for equation in sorted(_equations(file), key=lambda x: len(x.joints) != 2):
        if len(equation.joints) == 2:
            j, leader = equation.joints
            if j in followers or _last(followers, leader).leader == j:
                equation = _over_leaders(file, followers, equation)
                if equation is None:
                    continue
        if len(equation.joints) == 2:
            (j, leader), (c1, c2) = equation.joints, equation.c.tolist()
            followers[j] = _Follower(leader, -c2 / c1, equation.length / c1)
        elif _over_leaders(file, followers, equation):
            others.append(equation)
    for j in followers:
        if file.is_limited(j):
            file.miss("range of a mimic", file.name("joint", j))
    return followers, sorted(others, key=lambda x: x.i)


def _last(followers: dict[int, _Follower], j: int) -> _Follower:
    """The joint that another one follows in the end, and how; itself where it follows none."""
    leader, a, b = j, 1.0, 0.0
    while leader in followers:
        leader, further, c = followers[leader]
        a, b = a * further, a * c + b
    return _Follower(leader, a, b)


def _over_leaders(file: File, followers: dict[int, _Follower], equation: _Equation) -> _Equation | None:
    """An equation over joints that follow none; None where others say it already."""
    i, joints, c, length = equation
    of_leaders, sizes = dict[int, float](), [abs(length)]
    for j, x in zip(joints, c.tolist(), strict=True):
        leader, a, b = _last(followers, j)
        of_leaders[leader] = of_leaders.get(leader, 0.0) + x * a
        length -= x * b
        sizes += [abs(x * a), abs(x * b)]
    left = {j: x for j, x in of_leaders.items() if abs(x) > _ROUNDED * max(sizes)}
    if left:
        return _Equation(i, list(left), np.array([*left.values()]), length)
    if abs(length) > _ROUNDED * max(sizes):
        names = ", ".join(repr(file.name("joint", j)) for j in joints)
        file.refuse("eq", i, f"{names} cannot be so: other constraints say otherwise by {length:.3g}; leave one out")
    file.leave_out("constraint that others imply", file.name("eq", i))
    return None


def tendons_of_one_length(file: File, equations: list[_Equation]) -> list[Tendon]:
    """One for each of the equations, which make no mimic."""
    found = list[Tendon]()
    for i, joints, c, length in equations:
        name = file.name("eq", i)
        file.check_number("eq", i, "coefficients and length", np.array([*c, length]))
        file.doubt(_HELD, name)
        found.append(Tendon(name, [file.name("joint", j) for j in joints], c, lower=length, upper=length))
    return found


def loop_closures(file: File) -> tuple[list[LoopClosure], list[Frame]]:
    """(closures, the frames that they hold where these are no sites)."""
    m, kinds = file.model, closure_kinds(file)
    loops, frames = list[LoopClosure](), list[Frame]()
    for i in active_equalities(file):
        if (kind := kinds.get(int(m.eq_type[i]))) is None:
            continue
        ids = m.eq_obj1id[i], m.eq_obj2id[i]
        if m.eq_objtype[i] == int(file.mujoco.mjtObj.mjOBJ_SITE):
            a, b = (file.frame_of_site(k) for k in ids)
        else:
            a, b = (f"{file.name('eq', i)}/{side}" for side in "ab")
            for name, body, pose in zip((a, b), ids, _anchors(m.eq_data[i], kind), strict=True):
                frames.append(Frame(name, file.name("body", body), pose))
        loops.append(LoopClosure(a, b, kind))
    return loops, frames


def _anchors(data: np.ndarray, kind: Kind) -> list[RigidTransform]:
    """The poses of the frames that an equality constraint holds, on its two bodies."""
    unturned = np.array([1.0, 0, 0, 0])
    if kind == "ball":
        return [pose_of(data[:3], unturned), pose_of(data[3:6], unturned)]
    # The anchor on the second body comes first, then the pose of the second body on the first.
    return [pose_of(data[3:6], data[6:10]), pose_of(data[:3], unturned)]
