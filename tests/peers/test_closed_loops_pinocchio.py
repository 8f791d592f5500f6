"""Closed loops against Pinocchio's constrained dynamics, which are solved by proximal iterations too."""

import jax
import numpy as np
import pytest

from tests.helpers import closed_loops
from tests.helpers.optional import needs

needs("pinocchio")
import pinocchio as pin  # noqa: E402

from tests.helpers import pinocchio_closures  # noqa: E402


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("name", closed_loops.BODIES)
def test_accelerations_and_forces(name):
    s = closed_loops.closed(name)
    model = pinocchio_closures.model(s.model)
    data, own = model.createData(), pin.StdVec_RigidConstraintModel()
    own.extend(pinocchio_closures.closures(model, s.model, closed_loops.CLOSURES[name][2]))
    datas = pin.StdVec_RigidConstraintData()
    datas.extend([x.createData() for x in own])
    pin.initConstraintDynamics(model, data, own, datas)
    found = closed_loops.constrained(name)
    for q, v, tau, ours in zip(s.q, s.v, s.tau, np.asarray(found.vdot), strict=True):
        settings = pin.ProximalSettings(1e-14, 1e-14, 1e-10, 50)
        vdot = pin.constraintDynamics(model, data, q, v, tau, own, datas, settings)
        assert abs(ours - vdot).max() <= 1e-9 * abs(vdot).max()
        # J^T l, of their mechanics.
        forces = pin.rnea(model, data, q, v, vdot) - tau
        assert abs(pin.rnea(model, data, q, v, ours) - tau - forces).max() <= 1e-9 * abs(forces).max()
