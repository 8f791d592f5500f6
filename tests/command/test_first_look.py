"""What the first look measures, and the quadruped that it is about."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.command import algorithms, demo, first_look, quadruped
from jaxspatial.command.main import main
from tests.helpers.soon import compiled_soon


@pytest.fixture(autouse=True, scope="module")
def _soon():
    with compiled_soon():
        yield


@pytest.fixture(scope="module")
def motion():
    """0.6 s, pushed to the left from 0.2 to 0.4 s."""
    return quadruped.pushed(0.6, [(0.2, 0.4, (0.0, 40.0, 0.0))])


def test_it_stands_until_it_is_pushed_and_stays_on_its_feet(motion):
    mech, q, (feet, trunk) = motion
    assert q.shape == (120, 19) and mech.nv == 18
    weight = 9.81 * float(np.sum(mech.inertias.mass))
    pushed = np.arange(120) // 40 == 1
    np.testing.assert_array_equal(np.asarray(trunk["trunk"].f)[:, 1], np.where(pushed, 40, 0))
    assert abs(q[39, 5]) < 1e-3 < 1e-2 < q[79, 5] and (q[:, 6] > 0.2).all()
    standing = np.asarray(feet.wrenches.f)[30:40].sum(1).mean(0)
    np.testing.assert_allclose(standing, [0, 0, weight], atol=0.15 * weight)


@pytest.mark.slow
def test_the_demo_is_of_a_robot_that_stands_twice_and_then_lies_on_the_ground():
    """Not one that sinks into it."""
    mech, q, (touching, _) = quadruped.pushed(demo._SECONDS, demo._PUSHES, may_fall=True)
    upright = 1 - 2 * (q[:, 1] ** 2 + q[:, 2] ** 2)
    begins = [round(begin / float(quadruped.DT)) for begin, *_ in demo._PUSHES]
    assert (upright[: begins[2]] > 0.8).all() and (upright[begins[1:]] > 0.95).all() and upright[-1] < 0
    assert (q[:, 6] > 0.03).all() and abs(q[:, 4:6]).max() < 1.0
    weight = 9.81 * float(np.sum(mech.inertias.mass))
    np.testing.assert_allclose(np.asarray(touching.wrenches.f)[-100:].sum(1).mean(0)[2], weight, rtol=0.1)


def test_a_leg_in_the_air_comes_to_rest():
    """The dampers of the controller do not drive it: they are implicit."""
    mech, (q, v) = quadruped.mechanism(), quadruped.standing()
    q = q + np.eye(19, dtype=np.float32)[6] + np.float32(0.2) * (np.arange(19) > 6)
    step = jax.jit(lambda _, x: quadruped.step(mech, *x, jnp.zeros(3))[:2])
    q, v = jax.lax.fori_loop(0, 60, step, (q, v))
    assert q[6] > 0.5 and abs(v[6:]).max() < 1


def test_shapes_are_on_its_links(motion):
    """The file can be shown: primitives, no meshes elsewhere."""
    assert "<mesh" not in quadruped.FILE.read_text() and set(quadruped.FEET.frames) <= set(motion[0].frame_names)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_demo_is_a_recording(motion, tmp_path, monkeypatch, capsys):
    """With the shapes of the robot, its pushes and the forces on its feet; of a shorter motion here."""
    pytest.importorskip("viser")
    monkeypatch.setattr(quadruped, "pushed", lambda *_, **__: motion)
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--record", "push.viser"]) == 0
    assert "recording: push.viser" in capsys.readouterr().out and (tmp_path / "push.viser").stat().st_size > 10_000
    assert main(["demo", "--record", "push.viser"]) == 2 and "exists already" in capsys.readouterr().err
    assert main(["demo", "--record", "push.png"]) == 2 and "ending in .html or .viser" in capsys.readouterr().err


def test_the_demo_says_what_it_needs(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.delitem(sys.modules, "jaxspatial.viewer", raising=False)
    monkeypatch.delattr(js, "viewer", raising=False)
    assert main(["demo"]) == 2 and "pip install '.[view]'" in capsys.readouterr().err


@pytest.mark.parametrize("k", [0, 1])
def test_where_precision_decides(k):
    """A hundred times the accuracy and more."""
    found = algorithms.loss(algorithms.FIRST_LOOK[k], states=20)
    fast, reproducible, compensated = found.errors.values()
    assert fast >= reproducible / 3 > 1e2 * compensated > 0


# By default the two tests above, which do without minutes of simulated time and the gradient of a quadruped.
@pytest.mark.slow
def test_all_that_it_measures():
    heard = []
    look = first_look.measure(lambda: heard.append(1), wrenches=1000, states=8, gradients=4, steps=24)
    assert len(heard) == 5 + len(first_look.PRECISIONS) + len(algorithms.FIRST_LOOK)
    assert set(look.wrenches) == {*first_look.PRECISIONS, first_look.CROSS, first_look.MEMORY}
    assert min(*look.wrenches.values(), *look.torques.values(), look.steps, look.gradients) > 0
    assert 0.01 < look.response < 10
    for loss in look.losses[2:]:  # what is rounded from step to step, no precision gives back
        assert loss.errors["compensated"] > loss.errors["reproducible"] / 10 > 0
