"""Bodies of uniform density, over numbers: [(mass,), central], some with com, of (amount,), lengths and a direction."""

import math

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.functions import pi
from jaxspatial.arithmetic.numbers import constant, high, noinline_pairs, where
from jaxspatial.inertia import mesh


@formula
def direction(axis):
    """The axis times a power of two, with its largest component from 1 to 2: one along x, y or z with a known 1."""
    return [vectors.times(2, vectors.scaled(axis)[0])]


def _mass(by, amount, *factors):
    return amount if by == "mass" else math.prod(factors, start=amount)


def _diagonal(xx, yy, zz):
    zero = constant(xx, 0)
    return xx, zero, yy, zero, zero, zz


def _round(m, along, across, difference, n):
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
def solid_box(amount, size, by):
    m = _mass(by, *amount, *size)
    x, y, z = (m * c * c / 12 for c in size)
    return [(m,), _diagonal(y + z, z + x, x + y)]


@formula
def solid_cube(amount, size, by):
    (c,) = size
    m = _mass(by, *amount, c, c, c)
    moment = m * c * c / 6
    return [(m,), _diagonal(moment, moment, moment)]


def _ball(by, amount, a, b, c):
    """Mass of an ellipsoid."""
    return _mass(by, amount, a, b, 4 * c, pi(c) / 3)


@formula
def solid_sphere(amount, radius, by):
    (r,) = radius
    m = _ball(by, *amount, r, r, r)
    moment = 2 * (m * r * r) / 5
    return [(m,), _diagonal(moment, moment, moment)]


@formula
def hollow_sphere(amount, radius, by):
    (r,) = radius
    m = _mass(by, *amount, r, r, 4 * pi(r))
    moment = 2 * (m * r * r) / 3
    return [(m,), _diagonal(moment, moment, moment)]


@formula
def solid_ellipsoid(amount, semi_axes, by):
    m = _ball(by, *amount, *semi_axes)
    a, b, c = (m * s * s / 5 for s in semi_axes)
    return [(m,), _diagonal(b + c, c + a, a + b)]


@formula
def solid_cylinder(amount, radius, length, axis, by):
    return _cylinder(by, *amount, *radius, *length, axis)


@formula
def solid_cylinder_about_end(amount, radius, length, axis, by):
    m, central = _cylinder(by, *amount, *radius, *length, axis)
    half = length[0] / 2 / vectors.dot(axis, axis).sqrt()
    return [m, vectors.times(half, axis), central]


def _cylinder(by, amount, r, length, axis):
    m = _mass(by, amount, r, r, length, pi(r))
    a, b = m * r * r, m * length * length
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def hollow_cylinder(amount, inner_radius, outer_radius, length, axis, by):
    (p,), (q,), (h,) = inner_radius, outer_radius, length
    m = _mass(by, *amount, q - p, q + p, h, pi(q))
    a, b = m * p * p + m * q * q, m * h * h
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def solid_capsule(amount, radius, length, axis, by):
    """Of a cylinder, 3 h / (3 h + 4 r) of the mass, and two half balls, 4 r / (3 h + 4 r)."""
    (r,), (h,) = radius, length
    parts = 3 * h + 4 * r
    m = _mass(by, *amount, r, r, parts, pi(r) / 3)
    parts = where(high(parts) == 0, 1.0, parts)
    between, ends = m * (3 * h / parts), m * (4 * r / parts)
    rr, hh = between * r * r, between * h * h
    along = (5 * rr + 4 * (ends * r * r)) / 10
    across = (3 * rr + hh) / 12 + (16 * (ends * r * r) + (10 * (ends * h * h) + 15 * (ends * h * r))) / 40
    return _round(m, along, across, (3 * rr - hh) / 12 - (2 * (ends * h * h) + 3 * (ends * h * r)) / 8, axis)


@formula
def solid_cone(amount, radius, height, axis, by):
    (r,), (h,) = radius, height
    m = _mass(by, *amount, r, r, h, pi(r) / 3)
    a, b = 12 * (m * r * r), 3 * (m * h * h)
    return _round(m, 2 * a / 80, (a + b) / 80, (a - b) / 80, axis)


@formula
def thin_rod(mass, length, axis, by):
    across = mass[0] * length[0] * length[0] / 12
    return _round(*mass, constant(across, 0), across, -across, axis)


@formula
def solid_tetrahedron(amount, vertices, by):
    corners = vectors.rows(vertices)
    edges = [_difference(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    m = _mass(by, *amount, *(() if by == "mass" else (abs(_determinant(*edges[:3])) / 6,)))
    com = tuple(x + total / 4 for x, total in zip(corners[0], vectors.plus(*edges[:3]), strict=True))
    return [(m,), com, symmetric.trace_minus(_squares(m / 80, edges))]


def _difference(a, b):
    return tuple(y - x for x, y in zip(a, b, strict=True))


@noinline_pairs
def _determinant(a, b, c):
    return vectors.dot(a, vectors.cross(b, c))


@noinline_pairs
def _squares(m, edges):
    """m times the sum of e e^T: xx, xy, yy, xz, yz, zz."""
    return tuple(vectors.recursive_sum([m * e[i] * e[j] for e in edges]) for i, j in mesh.PAIRS)
