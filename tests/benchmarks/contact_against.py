"""Two commits in turns: what a step with contact costs with the jaxspatial of each.

    python tests/benchmarks/contact.py --against COMMIT [--robots solo12]

Run by itself, this file is one of the two processes of `two_commits.py`.
"""

import contact_rows as rows
import dynamics_compiling as compiling
import two_commits

# Those of this library; without contacts a step is the program of `semi_implicit_step`.
ROWS = rows.CONVEX, rows.PLAIN, rows.ONE, rows.CALL, rows.ROLLOUT, rows.GRADIENT


def compared(options, machine):
    """(the report, the exit status: 1 where a row is slower by more than a tenth, or none could be compared)."""
    left_out, found = [], []
    # A call of one step is a single one here: the benchmark of two commits repeats short calls itself.
    counts = {row: 1 if row == rows.CALL else rows.per_step(row, options.n, options.steps) for row in ROWS}
    with two_commits.sides(__file__, options.against) as sides:
        for name in options.robots:
            begin = name, options.n, options.steps
            found += sides.compared(f"{name}, float32", begin, ROWS, counts, options, left_out)
    about = [sides.about, f"{options.n} states, rollouts of {options.steps} steps.", machine]
    report = "\n".join(two_commits.lines(found, left_out, about, "state and step"))
    return report, int(not found or any(x.is_slower for x in found))


class _Programs(two_commits.Programs):
    """Compiled rows of a robot."""

    def begin(self, name, n, steps):
        """The coordinates, which have to be alike for states to mean the same; or why there is no such mechanism."""
        self.about, self.calls = (name, n, steps), {}
        try:
            mech = rows.mechanism(name)
        except Exception as error:
            return two_commits.reason(error)
        self.arguments = {row: arguments for row, (_, arguments) in rows.calls(*self.about, mech).items()}
        return [mech.nq, mech.nv, list(mech.joint_names)]

    def cold(self, row):
        return compiling.cold(lambda: self._function(row), self.arguments[row])

    def _function(self, row):
        return rows.calls(*self.about, compiling.watched(rows.mechanism(self.about[0])))[row][0]


if __name__ == "__main__":
    two_commits.serve(_Programs())
