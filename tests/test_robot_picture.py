"""The picture of the README: it can be drawn again, and shows what it says."""

import importlib.metadata

import numpy as np
import pytest

import jaxspatial as js

pytest.importorskip("matplotlib")
pytest.importorskip("viser")
pytest.importorskip("collada")
try:
    importlib.metadata.distribution("example-robot-data")
except importlib.metadata.PackageNotFoundError:
    pytest.skip("example-robot-data is not installed", allow_module_level=True)


# By default `test_plot` holds what is drawn, and the test below the numbers.
@pytest.mark.slow
# Parsers of shapes use what is no longer recommended.
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_picture_can_be_drawn_again(tmp_path):
    """Smaller here: in as few pixels as there is still a robot, a load and arrows of each colour."""
    from matplotlib.colors import to_rgb
    from matplotlib.image import imread

    from jaxspatial import plot
    from tests.helpers import robot_picture

    robot_picture.save(tmp_path / "again.png", dpi=80)
    again, kept = imread(tmp_path / "again.png"), imread(robot_picture.FILE)
    assert again.shape[:2] == (448, 672) and kept.shape[:2] == (700, 1050)
    assert robot_picture.FILE.stat().st_size < 100_000
    box = np.array(robot_picture.BOX)
    for color, share in ((plot.TORQUE, 1e-3), (plot.FORCE, 1e-3), (0.85 * box, 3e-3), ((0.85,) * 3, 0.03)):
        for image in (again, kept):
            near = abs(image[..., :3] - np.array(to_rgb(color))).max(-1) < 0.12
            assert near.mean() > share, color


def test_its_torques_hold_the_load():
    """Those of the weight are J^T F of the part that the arm alone does not need."""
    from tests.helpers import robot_picture

    mech, q, _, F_T_W, tau = robot_picture.scene()
    J = np.asarray(js.jacobian(mech, q, robot_picture.T))
    expected = np.asarray(js.gravity_forces(mech, q)) - J.T @ np.asarray(F_T_W.to_array())
    np.testing.assert_allclose(tau, expected, atol=1e-4)
    p_WC = js.forward_kinematics(mech, q, robot_picture.T) @ robot_picture.LOAD
    p_WT = js.forward_kinematics(mech, q, robot_picture.T).translation
    np.testing.assert_allclose(js.shift(F_T_W, p_WC - p_WT).tau, 0, atol=1e-5)
