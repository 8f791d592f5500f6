"""Two commits in turns: what rows of the benchmark of dynamics cost with the jaxspatial of each.

    python tests/benchmarks/dynamics.py --against COMMIT [--robots panda] [--dtypes float32] [--rows "mass matrix"]

Run by itself, this file is one of the two processes of `two_commits.py`.
"""

import dynamics_compiling as compiling
import dynamics_peers as peers
import dynamics_rows as rows
import jax
import jax.numpy as jnp
import numpy as np
import two_commits


def main(options, machine, table):
    """The exit status, see `two_commits.main`."""

    def compare(sides, left_out):
        counts = dict.fromkeys(options.rows, options.batch)
        for robot in options.robots:
            states = sides.folder / "states.npz"
            with jax.enable_x64(True):
                made = rows.States(None, rows.mechanism(peers.ROBOTS[robot]), options.batch)
            np.savez(states, made.q, *made.of_rates)
            for dtype in options.dtypes:
                begin = robot, dtype, str(states)
                yield from sides.compared(f"{robot}, {dtype}", begin, options.rows, counts, options, left_out)

    about = f"Batches of {options.batch} states.", machine
    return two_commits.main(__file__, compare, options, about, "state", table)


class _Programs(two_commits.Programs):
    """Compiled rows of a robot in a dtype."""

    def mechanism(self, *about):
        robot, dtype, states = about
        jax.config.update("jax_enable_x64", dtype == "float64")
        self.robot = peers.ROBOTS[robot]
        self.states = [jnp.asarray(x.astype(dtype)) for x in two_commits.arrays(states)]
        return rows.mechanism(self.robot)

    def cold(self, row):
        return compiling.cold(lambda: self._program(row), self.states)

    def _program(self, row):
        return rows.program(compiling.watched(rows.mechanism(self.robot)), self.robot.tip, row)


if __name__ == "__main__":
    two_commits.serve(_Programs())
