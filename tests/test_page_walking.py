"""The page on a quadruped that learns to walk, in few updates of few robots, on one device and in two processes."""

import importlib.metadata
import os
import re
import socket
import subprocess
import sys

import numpy as np
import pytest

from tests.helpers.optional import needs
from tests.helpers.pages import FOLDER, examples, run_page

# By default `test_readme` looks at its code: the program of an update compiles for half a minute.
pytestmark = pytest.mark.slow
needs("optax")
if "example-robot-data" not in {x.metadata["Name"] for x in importlib.metadata.distributions()}:
    pytest.skip(
        'example-robot-data is not installed: python -m pip install -e ".[test,peers]"', allow_module_level=True
    )

PAGE = (FOLDER / "walking.md").read_text()


def test_the_page_runs_and_its_picture_is_drawn(tmp_path):
    """In one update nobody learns to walk: rewards are finite, networks change, and a path is drawn."""
    from tests.helpers import walking_picture

    names = run_page("walking.md", ENVIRONMENTS=64, UPDATES=2, HORIZON=8)
    curve = np.asarray(names["curve"])
    assert curve.shape == (2, 3) and np.isfinite(curve).all() and 0 <= curve[:, 1].min() <= curve[:, 1].max() < 0.1
    first = names["actor_and_critic"](names["jax"].random.key(0))
    changed = names["jax"].tree.map(lambda x, y: float(abs(x - y).max()), first, names["agent"])
    assert all(0 < x < 0.1 for x in names["jax"].tree.leaves(changed))
    walking_picture.save(tmp_path / "walking.png", names)
    assert (tmp_path / "walking.png").stat().st_size > 10_000


def test_robots_learn_to_walk():
    """As the page tells: most of the speed, with few falls."""
    reward, falls, speed = np.mean(run_page("walking.md", runs_long=True)["curve"][-10:], axis=0)
    assert reward > 1.1 and falls < 2e-3 and 0.33 < speed < 0.45


def test_two_processes_learn_the_same(tmp_path):
    """Both print the same numbers, of the mean over all robots."""
    code = "\n".join(examples(PAGE))
    for name, x in {"ENVIRONMENTS": 16, "UPDATES": 2, "HORIZON": 4}.items():
        code = re.sub(rf"^{name} = .*", f"{name} = {x}", code, flags=re.M)
    (tmp_path / "walking.py").write_text(code)
    (script,) = re.findall(r"```py\n(.*?)```", PAGE, re.S)
    (tmp_path / "many.py").write_text(script)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    surroundings = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(FOLDER.parent)}
    command = [sys.executable, "many.py", address, "2"]
    runs = [
        subprocess.Popen([*command, str(i)], cwd=tmp_path, env=surroundings, stdout=subprocess.PIPE, text=True)
        for i in range(2)
    ]
    # What connects them prints lines of its own.
    one, two = (re.findall(r"^update .*", run.communicate(timeout=600)[0], re.M) for run in runs)
    assert one == two and len(one) == 2
