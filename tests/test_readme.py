"""What the README says runs."""

import copy
import dataclasses
import pathlib
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js

LAYERS = ("arithmetic", "rotation", "spatial", "inertia", "mechanism", "dynamics", "interop", "measure")
README = (pathlib.Path(__file__).parent.parent / "README.md").read_text()


def _table(heading):
    """The cells of the table under a heading, without its head."""
    section = README.split(f"## {heading}\n")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def _examples():
    return re.findall(r"```python\n(.*?)```", README, re.S)


def test_first_example_runs(capsys):
    block = _examples()[0]
    assert len([line for line in block.splitlines() if line and not line.startswith("#")]) <= 20
    exec(block, {})
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "SpatialForce(tau=[2.0, -1.0, -3.0], f=[1.0, 2.0, 0.0]) 3.5 3.5"


def test_example_of_a_mechanism_runs(capsys):
    exec(_examples()[1], {})
    first, *lines = capsys.readouterr().out.splitlines()
    assert first == "Mechanism(nq=2, nv=2, 2 bodies, float32)"
    assert lines[-2] == "    lower  <- elbow: revolute" and lines[-1].startswith("[")


def test_example_of_double_words_runs(capsys):
    exec(_examples()[2], {})
    assert capsys.readouterr().out == "SpatialForce(tau=[0.1, 0.2, 0.3], f=[1.0, 2.0, 3.0])\n"


def test_quick_start_has_two_lines():
    section = README.split("## Quick start\n")[1].split("\n## ")[0]
    blocks = re.findall(r"```sh\n(.*?)```", section, re.S)
    assert [block.count("\n") for block in blocks] == [1, 1]
    assert "python -m jaxspatial" in blocks[0] and "pytest" in blocks[1]


@pytest.mark.parametrize("row", _table("Coming from Drake"), ids=lambda row: row[0])
def test_coming_from_drake(row):
    """No row is empty, and every expression of ours works."""
    drake, ours, _ = row
    assert drake and re.fullmatch(r"`.+`", ours)
    tau, f, x6 = np.float32([0, 0, 3]), np.float32([1, 2, 0]), np.arange(6, dtype=np.float32)
    F = js.SpatialForce(tau, f)
    many = jax.tree.map(lambda leaf: jnp.tile(leaf, (4, 1)), F)
    scope = {
        "js": js, "jax": jax, "jnp": jnp, "copy": copy, "dataclasses": dataclasses,
        "tau": tau, "f": f, "x6": x6, "F": F, "F2": F * 0.5, "V": js.SpatialVelocity(f, tau),
        "p": jnp.array([1.0, 2.0, 3.0]), "M": np.ones((6, 4), np.float32), "many": many, "offsets": jnp.ones((4, 3)),
        "donated": jax.tree.map(jnp.array, F), "donated_many": jax.tree.map(jnp.array, many),
    }  # fmt: skip
    assert eval(ours.strip("`"), scope) is not None


def test_every_public_name_is_in_the_readme():
    for name in js.__dict__:
        if not name.startswith("_") and name not in (*LAYERS, "Precision", "CentralAxis"):
            assert re.search(rf"\b{name}\b", README), name


def test_links_and_pictures_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("https://"):
            assert (pathlib.Path(__file__).parent.parent / target).exists(), target
