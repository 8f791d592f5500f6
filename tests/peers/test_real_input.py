"""The command line on what a user has: wrenches and velocities at the joints of a Franka Panda and a Unitree G1.

The shifted file is held against Pinocchio's own change of frame, row by row, to 4 u mag in float64, u = 2^-53 and mag
the sum of the absolute values of a component's terms.
"""

import csv
import functools
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.drake_oracle import shift_magnitudes
from tests.helpers.optional import needs

pin = needs("pinocchio")
from tests.helpers import pinocchio_robots as robots  # noqa: E402

U = 2.0**-53
OFFSET = np.array([0.1, -0.2, 0.3])
PARTS = ("tau", "f", "w", "v")
COLUMNS = [f"{part}_{axis}" for part in PARTS for axis in "xyz"]

real_robots = pytest.mark.parametrize("robot", ["panda", "g1"])
joint_wrenches = functools.cache(robots.joint_wrenches)


# -- the motion -------------------------------------------------------------------------------------------------------


@real_robots
def test_motion_has_the_velocities_and_accelerations_it_states(robot):
    """By central differences over 2 h, which err by h^2 / 6 times the third derivative: of q up to 600, of v 3700."""
    model, h = robots.load(robot), 1e-4
    for t in (0.0, 1.3, 3.1):
        (q0, v0, _), (_, v, a), (q1, v1, _) = (robots.motion(model, s) for s in (t - h, t, t + h))
        np.testing.assert_allclose(pin.difference(model, q0, q1) / (2 * h), v, rtol=0, atol=600 * h**2 / 6)
        np.testing.assert_allclose((v1 - v0) / (2 * h), a, rtol=0, atol=3700 * h**2 / 6)
        assert ((model.lowerPositionLimit <= q0) & (q0 <= model.upperPositionLimit)).all()


@real_robots
def test_wrenches_are_of_every_joint_at_every_moment(robot):
    x = joint_wrenches(robot)
    joints = robots.load(robot).njoints - 1
    assert len(x.names) == len(set(x.names)) == 200 * joints
    for part in PARTS:
        assert getattr(x, part).shape == (200 * joints, 3)
        assert np.isfinite(getattr(x, part)).all()


# -- the command ------------------------------------------------------------------------------------------------------


def write_npz(path, parts):
    np.savez(path, **parts)


def read_npz(path):
    with np.load(path, allow_pickle=False) as file:
        return dict(file)


def write_csv(path, parts):
    with open(path, "w", newline="") as file:
        rows = np.hstack([parts[part] for part in PARTS]).tolist()
        csv.writer(file).writerows([COLUMNS, *([repr(number) for number in row] for row in rows)])


def read_csv(path):
    with open(path, newline="") as file:
        columns, *rows = csv.reader(file)
    assert columns == COLUMNS
    numbers = np.array([[float(number) for number in row] for row in rows])
    return dict(zip(PARTS, np.split(numbers, 4, axis=-1), strict=True))


def shifted_by_the_command(path):
    """Runs the command on the file; returns the path of the file it has written beside it."""
    package = str(pathlib.Path(js.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([package, os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-m", "jaxspatial", "shift", path.name, "--offset", *map(str, OFFSET)]
    done = subprocess.run(command, cwd=path.parent, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return path.with_name(f"{path.stem}_shifted{path.suffix}")


def shifted_by_pinocchio(x):
    seen_from_q = pin.SE3(np.eye(3), OFFSET).inverse()
    forces = [seen_from_q.act(pin.Force(f, tau)) for tau, f in zip(x.tau, x.f, strict=True)]
    motions = [seen_from_q.act(pin.Motion(v, w)) for w, v in zip(x.w, x.v, strict=True)]
    return {
        "tau": np.array([F.angular for F in forces]),
        "f": np.array([F.linear for F in forces]),
        "w": np.array([V.angular for V in motions]),
        "v": np.array([V.linear for V in motions]),
    }


@pytest.mark.parametrize(("robot", "suffix"), [("g1", ".npz"), ("panda", ".csv")])
@pytest.mark.slow
def test_command_shifts_real_joint_wrenches_as_pinocchio_does(robot, suffix, tmp_path):
    write, read = {".npz": (write_npz, read_npz), ".csv": (write_csv, read_csv)}[suffix]
    x = joint_wrenches(robot)
    given = {part: getattr(x, part) for part in PARTS}
    path = tmp_path / f"{robot}{suffix}"
    write(path, given)
    found = read(shifted_by_the_command(path))
    assert list(found) == list(PARTS)
    for part in ("f", "w"):
        np.testing.assert_array_equal(found[part], given[part], strict=True)
    expected = shifted_by_pinocchio(x)
    for part, magnitude in (
        ("tau", shift_magnitudes(js.SpatialForce, x.tau, x.f, OFFSET)[0]),
        ("v", shift_magnitudes(js.SpatialVelocity, x.w, x.v, OFFSET)[1]),
    ):
        assert found[part].dtype == np.float64
        assert (abs(found[part] - expected[part]) <= 4 * U * magnitude).all()
    for part, array in read(path).items():
        np.testing.assert_array_equal(array, given[part], strict=True)
