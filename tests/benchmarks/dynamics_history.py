"""How the speed of dynamics changed, by commit: Pinocchio's time over ours, in every table that was committed.

    python tests/benchmarks/dynamics_history.py    # writes dynamics_history.md and .png; measures nothing

It reads `git log` of `dynamics.md`, so it needs a clone with its history. Each ratio is of two times that were measured
in one process, in turns; machines differ from commit to commit, and with them ratios.
"""

import pathlib
import re
import subprocess
from typing import NamedTuple

HERE = pathlib.Path(__file__).parent
TABLE, PAGE, PICTURE = HERE / "dynamics.md", HERE / "dynamics_history.md", HERE / "dynamics_history.png"
ROBOTS = {"panda": "Franka Panda", "g1": "Unitree G1"}
ALGORITHMS = {
    "inverse dynamics": "#00798c",
    "forward dynamics": "#d1495b",
    "mass matrix": "#edae49",
    "Jacobian": "#3a7d44",
    "derivatives of inverse dynamics": "#7b2d8b",
    "derivatives of forward dynamics": "#30323d",
}

INTRO = """# Speed of dynamics, by commit

![Pinocchio's time over ours, by commit](dynamics_history.png)

Pinocchio's time over ours, float32, batches of 4096 states, one core: above 1 ours is faster. Every commit is one that
changed the numbers of [the table](dynamics.md). Both times were measured in one process, in turns. Machines differ, as
the column says, and with them both times: a step from one machine to another is partly the machine's. Written by
`dynamics_history.py` from the history of the repository.
"""


class Measured(NamedTuple):
    """One committed table. ratios: (robot, algorithm) -> Pinocchio's time over ours, float32, batch 4096."""

    commit: str
    date: str
    machine: str
    ratios: dict


def ratios(text):
    """Those of a table, in either of the forms that it had; empty where it has none of them."""
    found = {}
    for robot in ROBOTS:
        section = text.partition(f"## {robot}, float32: us per state\n")[2].partition("\n## ")[0]
        for name in ALGORITHMS:
            row = re.search(rf"^\| {name} \| 4096 \| ([\d.]+) \([^|]*\| ([\d.]+) \(", section, re.M)
            ours, theirs = row.groups() if row else (_first_form(text, robot, name, who) for who in FIRST)
            if ours and theirs:
                found[robot, name] = float(theirs) / float(ours)
    return found


FIRST = "reproducible", "Pinocchio C++"


def _first_form(text, robot, name, who):
    row = re.search(rf"^\| {robot}, {name}, float32, 4096 \| {re.escape(who)} \| ([\d.]+) ", text, re.M)
    return row and row[1]


def history():
    """Of all commits of the table, oldest first; those that changed its words alone are left out."""
    lines = _git("log", "--reverse", "--format=%h %cs", "--", str(TABLE)).splitlines()
    found = []
    for commit, date in map(str.split, lines):
        text = _git("show", f"{commit}:{TABLE.relative_to(HERE.parent.parent)}")
        machine = re.search(r"^(.*), 1 core in use", text, re.M)
        measured = Measured(commit, date, machine[1] if machine else "", ratios(text))
        if measured.ratios and (not found or measured.ratios != found[-1].ratios):
            found.append(measured)
    return found


def _git(*command):
    return subprocess.run(["git", *command], cwd=HERE, check=True, capture_output=True, text=True).stdout


def page(found):
    """Markdown: a table for each robot, a row for each commit."""
    parts = [INTRO]
    for robot, title in ROBOTS.items():
        lines = [["commit", "date", "machine", *ALGORITHMS], ["---"] * (3 + len(ALGORITHMS))]
        lines += [[*x[:3], *(_digits(x.ratios.get((robot, name))) for name in ALGORITHMS)] for x in found]
        parts += [f"## {title}\n", *("| " + " | ".join(line) + " |" for line in lines), ""]
    return "\n".join(parts)


def _digits(x):
    return "" if x is None else f"{x:.3g}"


def draw(found, path):
    """A panel for each robot, a line for each algorithm, and another marker for each machine."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    machines = list(dict.fromkeys(x.machine for x in found))
    figure, panels = pyplot.subplots(1, 2, figsize=(9, 4.2), sharey=True, layout="constrained")
    for ax, (robot, title) in zip(panels, ROBOTS.items(), strict=True):
        for name, color in ALGORITHMS.items():
            at = [i for i, x in enumerate(found) if (robot, name) in x.ratios]
            ax.semilogy(at, [found[i].ratios[robot, name] for i in at], color=color, label=name)
            for machine, marker in zip(machines, "osD^v", strict=False):
                own = [i for i in at if found[i].machine == machine]
                ax.semilogy(own, [found[i].ratios[robot, name] for i in own], marker, color=color, markersize=5)
        ax.axhline(1, color="grey", linestyle=":")
        ax.set_xticks(range(len(found)), [f"{x.commit}, {x.date[5:]}" for x in found], rotation=60, ha="right", size=8)
        ax.set_title(title, fontsize=10)
        ax.spines[["top", "right"]].set_visible(False)
    for machine, marker in zip(machines, "osD^v", strict=False):
        panels[1].plot([], [], marker, color="grey", label=machine)
    panels[0].set_ylabel("Pinocchio's time over ours")
    figure.legend(
        *panels[1].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=8
    )
    ticks = [0.2, 0.5, 1, 2, 5, 10, 20, 50]
    panels[0].set_yticks(ticks, [f"{x:g}" for x in ticks])
    panels[0].minorticks_off()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


if __name__ == "__main__":
    FOUND = history()
    PAGE.write_text(page(FOUND))
    draw(FOUND, PICTURE)
    print(PAGE.read_text())
