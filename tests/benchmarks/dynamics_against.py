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


def compared(options, machine):
    """(the report, the exit status: 1 where a row is slower by more than a tenth, or none could be compared)."""
    left_out, found = [], []
    with two_commits.sides(__file__, options.against) as sides:
        for robot in options.robots:
            states = sides.folder / "states.npz"
            with jax.enable_x64(True):
                made = rows.States(None, rows.mechanism(peers.ROBOTS[robot]), options.batch)
            np.savez(states, made.q, *made.of_rates)
            counts = dict.fromkeys(options.rows, options.batch)
            for dtype in options.dtypes:
                begin = robot, dtype, str(states)
                found += sides.compared(f"{robot}, {dtype}", begin, options.rows, counts, options, left_out)
    about = [sides.about, f"Batches of {options.batch} states.", machine]
    report = "\n".join(two_commits.lines(found, left_out, about, "state"))
    return report, int(not found or any(x.is_slower for x in found))


class _Programs(two_commits.Programs):
    """Compiled rows of a robot in a dtype."""

    def begin(self, robot, dtype, states):
        """The coordinates, which have to be alike for states to mean the same; or why there is no such mechanism."""
        jax.config.update("jax_enable_x64", dtype == "float64")
        self.robot, self.calls = peers.ROBOTS[robot], {}
        self.states = [jnp.asarray(x.astype(dtype)) for x in two_commits.arrays(states)]
        try:
            mech = rows.mechanism(self.robot)
        except Exception as error:
            return two_commits.reason(error)
        return [mech.nq, mech.nv, list(mech.joint_names)]

    def cold(self, row):
        return compiling.cold(lambda: self._program(row), self.states)

    def _program(self, row):
        return rows.program(compiling.watched(rows.mechanism(self.robot)), self.robot.tip, row)


if __name__ == "__main__":
    two_commits.serve(_Programs())
