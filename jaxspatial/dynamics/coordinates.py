"""Derivatives by the rates of joints as derivatives by their coordinates."""

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Number, Numbers
from jaxspatial.dynamics import along
from jaxspatial.dynamics.state import MechanismState


def by_coordinates(state: MechanismState, matrix: Number):
    """A matrix (nv, nv, B) with columns by rates, as one with columns by coordinates, kind by kind."""
    t, found, places = state.topology, list[Number](), list[np.ndarray]()
    for own in state.kind_states:
        bodies = own.bundle.own_bodies
        rates = [_columns(matrix, np.array(t.v_starts)[bodies] + k) for k in range(own.kind.nv)]
        found += rates if own.has_rates_of_coordinates else _along_coordinates(own.dq_dt_of_units(), rates)
        places += [np.array(t.q_starts)[bodies] + c for c in range(own.kind.nq)]
    order = np.argsort(np.concatenate(places))
    return along.mapped(lambda w: jnp.swapaxes(along.rows(w, order), 0, 1), along.joined(found))


def _columns(matrix: Number, which: np.ndarray):
    """Those of a matrix (n, m, B) as rows (len(which), n, B)."""
    return along.mapped(lambda w: along.rows(jnp.swapaxes(w, 0, 1), which), matrix)


def _along_coordinates(G: list[Numbers], rates: list[Number]) -> list[Number]:
    """Columns by coordinates of columns by rates: dq/dt = G v, with orthogonal columns, quaternions' too, so that
    v = G^+ dq/dt has the rows g / |g|^2."""
    inverse = [vectors.times(1 / vectors.dot(g, g), g) for g in G]
    return [vectors.dot(_lifted(row), rates) for row in zip(*inverse, strict=True)]


def _lifted(row: Numbers):
    """Numbers (1, joints, B) beside rows (joints, n, B)."""
    return [along.mapped(lambda w: jnp.swapaxes(w, 0, 1), x) for x in row]
