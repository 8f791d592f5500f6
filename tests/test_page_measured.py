"""Times on pages are those of the tables of benchmarks, to as many digits as the pages tell."""

import re

import pytest

from tests.helpers.pages import FOLDER

TABLES = FOLDER.parent / "tests/benchmarks"
SECTIONS = {"Panda": "panda, float32: us per state", "G1": "g1, float32: us per state"}


def cells(page, section, start):
    """Of the first row of a table that begins so: the numbers before brackets and units, as texts."""
    text = (TABLES / page).read_text()
    assert section in text
    rows = text.partition(section)[2].splitlines()
    row = next(row for row in rows if row.startswith(f"| {start} |"))
    return [re.match(r"[\d.]*", cell.strip())[0] for cell in row.split("|")[1:-1]]


def is_told(told, measured):
    """Whether a number is the measured one, rounded to the digits that it has."""
    digits = len(told.replace(".", "").lstrip("0"))
    return float(told) == float(f"{float(measured):.{digits}g}")


def rows(page, heading):
    section = (FOLDER / page).read_text().partition(f"## {heading}")[2].partition("\n## ")[0]
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in section.splitlines() if row.startswith("| ")][1:]


def test_rounding():
    assert is_told("0.69", "0.691") and is_told("40", "39.5") and not is_told("0.7", "0.76") and is_told("162", "162")


@pytest.mark.parametrize("row", rows("measured.md", "Where it is faster, and where slower"), ids=lambda row: row[0])
def test_what_is_faster(row):
    task, states, ours, other, ratio = row
    theirs, who = other.split(", ")
    if found := re.fullmatch(r"step of a (\w+) (on the ground|on stairs)", task):
        on_stairs = " on stairs" * (found[2] == "on stairs")
        names = (f"{name}{on_stairs}" for name in ("convex_step", "mjx.step"))
        measured = [cells("contact.md", f"| {found[1].lower()} | us", name)[1] for name in names]
        told_ratio = float(measured[1]) / float(measured[0])
        assert who == "MJX"
    elif f"| {task} | us" in (TABLES / "constraints.md").read_text():
        found = {case: cells("constraints.md", f"| {task} | us", case) for case in ("ours", "Pinocchio")}
        measured, told_ratio = [found["ours"][1], found["Pinocchio"][1]], found["ours"][4]
        assert who == "Pinocchio"
    else:
        name, robot = re.fullmatch(r"(.*) of a (Panda|G1).*", task).groups()
        found = cells("dynamics.md", SECTIONS[robot], f"{name} | {states}")
        measured, told_ratio = found[2:4], found[6]
        assert who == "Pinocchio"
    assert is_told(ours, measured[0]) and is_told(theirs, measured[1]) and is_told(ratio, told_ratio)


def test_what_compiling_takes():
    text = " ".join((FOLDER / "measured.md").read_text().split())
    told = re.search(r"need: ([\d.]+) s for .*?, ([\d.]+) s for .*?, ([\d.]+) s for .*?, and ([\d.]+) s", text).groups()
    rollout = (float(x) for x in cells("contact.md", "| solo12 | us", "convex_step")[4:])
    gradient = (float(x) for x in cells("contact.md", "| solo12 | us", "gradient of 60 steps, one state")[4:])
    measured = [
        cells("dynamics.md", "## Seconds to trace", f"{robot}, float32 | forward dynamics")[4]
        for robot in ("panda", "g1")
    ]
    assert all(map(is_told, told, [*measured, sum(rollout), sum(gradient)]))


def test_what_compiling_of_many_links_takes():
    text = " ".join((FOLDER / "speed.md").read_text().split())
    told = re.search(
        r"takes ([\d.]+) s for 10 links and ([\d.]+) s for 1000\. .*: ([\d.]+) s for four legs and ([\d.]+) s for one, "
        r"([\d.]+) s for five fingers and ([\d.]+) s for one\.",
        text,
    ).groups()
    sizes = ("chain", "10 links"), ("chain", "1000 links"), ("quadruped", "four legs"), ("quadruped", "one leg")
    for number, (name, size) in zip(told, (*sizes, ("hand", "five fingers"), ("hand", "one finger")), strict=True):
        measured = cells("dynamics.md", "## Size", f"{name}, forward dynamics | {size}")[2]
        assert is_told(number, measured.split()[0]), (name, size)


PRODUCTS = {
    "M x": ("mass matrix times a vector, by inverse dynamics", "mass matrix times a vector"),
    "M^-1 x": ("inverse mass matrix times a vector", None),
    "J^T F": ("Jacobian transposed times a wrench, by pull-back", "Jacobian transposed times a wrench"),
    "derivatives of inverse dynamics along vectors": (
        "derivatives of inverse dynamics times vectors, by jvp",
        "derivatives of inverse dynamics times vectors, by matrices",
    ),
    "derivatives of forward dynamics along vectors": (
        "derivatives of forward dynamics times vectors, by jvp",
        "derivatives of forward dynamics times vectors, by matrices",
    ),
}


@pytest.mark.parametrize("row", rows("speed.md", "Products without matrices"), ids=lambda row: row[0])
def test_products_without_matrices(row):
    """The other one, J v, has no time."""
    product, _, *told = row
    for number, name in zip(told, PRODUCTS.get(product, ("", "")), strict=True):
        assert bool(number) == bool(name)
        assert not name or is_told(number, cells("dynamics.md", SECTIONS["G1"], f"{name} | 4096")[6])


def test_steps_with_contact():
    """What the page on contact tells of three robots: the least and the largest of each."""
    text = " ".join((FOLDER / "contact.md").read_text().split())
    robots = [f"| {name} | us" for name in ("solo12", "go1", "go2")]
    told = {
        r"a step takes ([\d.]+) to ([\d.]+) us per state": ("convex_step", slice(1, 2)),
        r"another law of contact, it takes ([\d.]+) to ([\d.]+) us": ("mjx.step", slice(1, 2)),
        r"One robot takes ([\d.]+) to ([\d.]+) us per step in a long": (
            "convex_step, one state, 500 steps a call",
            slice(1, 2),
        ),
        r"and ([\d.]+) to ([\d.]+) us in a call of one step": ("convex_step, one state, a call", slice(1, 2)),
        r"one robot's rollout ([\d.]+) to ([\d.]+) s": ("gradient of 60 steps, one state", slice(4, 6)),
    }
    for pattern, (name, columns) in told.items():
        least, most = re.search(pattern, text).groups()
        measured = [sum(map(float, cells("contact.md", robot, name)[columns])) for robot in robots]
        assert is_told(least, min(measured)) and is_told(most, max(measured)), name
