"""Bodies of uniform density, over numbers: [(mass,), central], some with com, of (amount,), lengths and a direction."""

import math
from collections.abc import Sequence

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.functions import pi
from jaxspatial.arithmetic.numbers import Number, Numbers, Symmetric, Three, constant, high, noinline_pairs, where
from jaxspatial.inertia import mesh


@formula
def direction(axis: Three) -> list[Three]:
    """The axis times a power of two, with its largest component from 1 to 2: one along x, y or z with a known 1."""
    return [vectors.times(2, vectors.scaled(axis)[0])]


def _mass(by: str, amount: Number, *factors: Number) -> Number:
    return amount if by == "mass" else math.prod(factors, start=amount)


def _diagonal(xx: Number, yy: Number, zz: Number) -> Symmetric:
    zero = constant(xx, 0)
    return xx, zero, yy, zero, zero, zz


def _round(m: Number, along: Number, across: Number, difference: Number, n: Three) -> list[Numbers]:
    """Of a body round about n, of any length: along n n^T / n.n + across (1 - n n^T / n.n), difference = along -
    across.

    Moments are sums of what is not negative; no root is taken, and nothing is done about a known coordinate axis.
    """
    squared = vectors.dot(n, n)
    x, y, z = (c * c / squared for c in n)
    xy, xz, yz = (difference * (n[i] * n[j] / squared) for i, j in ((0, 1), (0, 2), (1, 2)))
    xx, yy, zz = (along * a + across * (b + c) for a, b, c in ((x, y, z), (y, z, x), (z, x, y)))
    return [(m,), (xx, xy, yy, xz, yz, zz)]


@formula
def solid_box(amount: Numbers, size: Three, by: str) -> list[Numbers]:
    m = _mass(by, amount[0], *size)
    x, y, z = (m * c * c / 12 for c in size)
    return [(m,), _diagonal(y + z, z + x, x + y)]


@formula
def solid_cube(amount: Numbers, size: Numbers, by: str) -> list[Numbers]:
    (c,) = size
    m = _mass(by, amount[0], c, c, c)
    moment = m * c * c / 6
    return [(m,), _diagonal(moment, moment, moment)]


def _ball(by: str, amount: Number, a: Number, b: Number, c: Number) -> Number:
    """Mass of an ellipsoid."""
    return _mass(by, amount, a, b, 4 * c, pi(c) / 3)


@formula
def solid_sphere(amount: Numbers, radius: Numbers, by: str) -> list[Numbers]:
    (r,) = radius
    m = _ball(by, amount[0], r, r, r)
    moment = 2 * (m * r * r) / 5
    return [(m,), _diagonal(moment, moment, moment)]


@formula
def hollow_sphere(amount: Numbers, radius: Numbers, by: str) -> list[Numbers]:
    (r,) = radius
    m = _mass(by, amount[0], r, r, 4 * pi(r))
    moment = 2 * (m * r * r) / 3
    return [(m,), _diagonal(moment, moment, moment)]


@formula
def solid_ellipsoid(amount: Numbers, semi_axes: Three, by: str) -> list[Numbers]:
    x, y, z = semi_axes
    m = _ball(by, amount[0], x, y, z)
    a, b, c = (m * s * s / 5 for s in semi_axes)
    return [(m,), _diagonal(b + c, c + a, a + b)]


@formula
def solid_cylinder(amount: Numbers, radius: Numbers, length: Numbers, axis: Three, by: str) -> list[Numbers]:
    return _cylinder(by, amount[0], radius[0], length[0], axis)


@formula
def solid_cylinder_about_end(amount: Numbers, radius: Numbers, length: Numbers, axis: Three, by: str) -> list[Numbers]:
    m, central = _cylinder(by, amount[0], radius[0], length[0], axis)
    half = length[0] / 2 / vectors.dot(axis, axis).sqrt()
    return [m, vectors.times(half, axis), central]


def _cylinder(by: str, amount: Number, r: Number, length: Number, axis: Three) -> list[Numbers]:
    m = _mass(by, amount, r, r, length, pi(r))
    a, b = m * r * r, m * length * length
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def hollow_cylinder(
    amount: Numbers, inner_radius: Numbers, outer_radius: Numbers, length: Numbers, axis: Three, by: str
) -> list[Numbers]:
    (p,), (q,), (h,) = inner_radius, outer_radius, length
    m = _mass(by, amount[0], q - p, q + p, h, pi(q))
    a, b = m * p * p + m * q * q, m * h * h
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def solid_capsule(amount: Numbers, radius: Numbers, length: Numbers, axis: Three, by: str) -> list[Numbers]:
    """Of a cylinder, 3 h / (3 h + 4 r) of the mass, and two half balls, 4 r / (3 h + 4 r)."""
    (r,), (h,) = radius, length
    parts = 3 * h + 4 * r
    m = _mass(by, amount[0], r, r, parts, pi(r) / 3)
    parts = where(high(parts) == 0, 1.0, parts)
    between, ends = m * (3 * h / parts), m * (4 * r / parts)
    rr, hh = between * r * r, between * h * h
    along = (5 * rr + 4 * (ends * r * r)) / 10
    across = (3 * rr + hh) / 12 + (16 * (ends * r * r) + (10 * (ends * h * h) + 15 * (ends * h * r))) / 40
    return _round(m, along, across, (3 * rr - hh) / 12 - (2 * (ends * h * h) + 3 * (ends * h * r)) / 8, axis)


@formula
def solid_cone(amount: Numbers, radius: Numbers, height: Numbers, axis: Three, by: str) -> list[Numbers]:
    (r,), (h,) = radius, height
    m = _mass(by, amount[0], r, r, h, pi(r) / 3)
    a, b = 12 * (m * r * r), 3 * (m * h * h)
    return _round(m, 2 * a / 80, (a + b) / 80, (a - b) / 80, axis)


@formula
def thin_rod(mass: Numbers, length: Numbers, axis: Three, by: str) -> list[Numbers]:
    across = mass[0] * length[0] * length[0] / 12
    return _round(mass[0], constant(across, 0), across, -across, axis)


@formula
def solid_tetrahedron(amount: Numbers, vertices: Numbers, by: str) -> list[Numbers]:
    corners = vectors.rows(vertices)
    edges = [_difference(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    m = amount[0] if by == "mass" else _mass(by, amount[0], abs(_determinant(*edges[:3])) / 6)
    com = tuple(x + total / 4 for x, total in zip(corners[0], vectors.plus(*edges[:3]), strict=True))
    return [(m,), com, symmetric.trace_minus(_squares(m / 80, edges))]


def _difference(a: Three, b: Three) -> Three:
    return tuple(y - x for x, y in zip(a, b, strict=True))


@noinline_pairs
def _determinant(a: Three, b: Three, c: Three) -> Number:
    return vectors.dot(a, vectors.cross(b, c))


@noinline_pairs
def _squares(m: Number, edges: Sequence[Three]) -> Symmetric:
    """m times the sum of e e^T: xx, xy, yy, xz, yz, zz."""
    return tuple(vectors.recursive_sum([m * e[i] * e[j] for e in edges]) for i, j in mesh.PAIRS)
