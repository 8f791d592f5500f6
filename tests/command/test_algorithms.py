"""Whole algorithms and applications: the errors that are told are those of the numbers. Never times."""

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.command import algorithms
from jaxspatial.command.algorithms import ALGORITHMS, Case
from jaxspatial.measure.error import rationals
from jaxspatial.numerics.precision import OF_ALGORITHMS
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow


def _forces(mass, load, state):
    """Of a trolley and its load, in 64 digits of a significand: m x'' + l (x'' - a'' cos a + a'^2 sin a), ..."""
    (_, angle), (_, rate), (a, spin) = (np.asarray(x).astype(np.longdouble).T for x in state)
    mass, load, _, g = (np.longdouble(np.float32(x)) for x in (mass, load, 0.01, 9.81))
    swing = np.float32(0.4 * np.float64(np.float32(load)) * 0.01**2)
    along = (mass + load) * a - load * (spin * np.cos(angle) - rate**2 * np.sin(angle))
    about = (load + swing) * spin - load * a * np.cos(angle) + load * g * np.sin(angle)
    return np.stack([along, about], -1)


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="needs numbers of more digits than float64 has")
def test_errors_are_those_of_the_numbers():
    """Of a trolley and its load, by hand."""
    mech, n = algorithms.trolley(3.0, 0.5), 20
    lines = algorithms.cases(["inverse_dynamics"])
    advanced = []
    rows = algorithms.measure(mech, lines, n, lambda: advanced.append(1))
    assert [row.case for row in rows] == lines and len(advanced) == algorithms.steps(lines)
    state = algorithms._state(ALGORITHMS["inverse_dynamics"], mech, n)
    exact = _forces(3.0, 0.5, state)
    for row in rows[:3]:
        ours = jax.jit(jax.vmap(lambda *x, p=row.case.precision: js.inverse_dynamics(mech, *x, precision=p)))(*state)
        worst = float(abs(np.asarray(ours).astype(np.longdouble) - exact).max())
        assert row.worst_in_units == pytest.approx(worst, rel=1e-3) and row.unit == "SI"
    assert rows[2].worst_ulps <= 0.51 <= rows[1].worst_ulps < 8 and np.isnan(rows[-1].worst_ulps)
    assert rows[4].worst_in_units < 1e-7 * rows[1].worst_in_units


def test_forces_of_forward_dynamics_are_those_of_a_motion():
    mech = algorithms.trolley(3.0, 0.5)
    q, v, tau = algorithms._state(ALGORITHMS["forward_dynamics"], mech, 10)
    *_, vdot = algorithms._state(ALGORITHMS["inverse_dynamics"], mech, 10)
    found = interpreted(lambda *x: js.forward_dynamics(mech, *x))(q, v, tau)
    np.testing.assert_allclose(found, vdot, rtol=0, atol=1e-4)


def test_steps_count_the_reference_too():
    """It is compiled, though not asked for."""
    lines = algorithms.cases(["forward_dynamics"], ["float16", "float32"])
    assert [line[1:] for line in lines] == [("float32", str(p)) for p in OF_ALGORITHMS]
    assert algorithms.steps(lines) == algorithms.steps([*lines, Case("forward_dynamics", "float64", "compensated")])
    assert algorithms.steps([]) == 0


def test_the_embedded_arm_is_an_arm():
    mech = algorithms.arm()
    assert mech.nv == 7 and mech.dtype == np.float32
    assert interpreted(lambda M: M.is_physically_valid())(mech.inertias).all()
    stretched = interpreted(lambda q: js.forward_kinematics(mech, q).translation[-1])(np.zeros(7, np.float32))
    np.testing.assert_allclose(stretched, [0.088, 0.0, 0.333 + 0.316 + 0.384], atol=1e-6)


@pytest.mark.parametrize("names", [slow(("100 links", "1 km")), slow(("base", "1 t", "10 g"))])
def test_applications(names, monkeypatch):
    """Compensated is off by rounding once, the others by more."""
    some = [one for one in algorithms.APPLICATIONS if any(name in one.name for name in names)]
    monkeypatch.setattr(algorithms, "APPLICATIONS", some)
    advanced = []
    losses = algorithms.losses(lambda: advanced.append(1), states=20)
    assert len(advanced) == algorithms.application_steps() and len(losses) == len(some) >= len(names)
    for loss in losses:
        rounded = 1.01 * 2.0**-24 * loss.size
        assert loss.errors["compensated"] <= rounded < loss.errors["fast"] + loss.errors["reproducible"]


def test_what_is_lost_far_off():
    """By exact rationals."""
    far = next(one for one in algorithms.APPLICATIONS if "1 km" in one.name)
    found = algorithms.loss(far, lambda: None, 20)
    tau, f, p = far.arguments(np.random.default_rng(0), 20)
    exact = rationals(tau) - np.cross(rationals(p), rationals(f))
    plain = (tau - np.cross(p, f)).astype(np.float32)
    assert found.errors["reproducible"] == pytest.approx(float(abs(rationals(plain) - exact).max()), rel=1e-6)
    assert 0.5 < found.size < 2 and found.errors["fast"] > 1e-3 and found.unit == "N m"
