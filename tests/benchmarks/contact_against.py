"""Two commits in turns: what a step with contact costs with the jaxspatial of each.

    python tests/benchmarks/contact.py --against COMMIT [--robots solo12]

Run by itself, this file is one of the two processes of `two_commits.py`.
"""

import contact_rows as rows
import dynamics_compiling as compiling
import two_commits

# Those of this library; without contacts a step is the program of `semi_implicit_step`.
ROWS = rows.CONVEX, rows.PLAIN, rows.ONE, rows.CALL, rows.ROLLOUT, rows.GRADIENT


def main(options, machine, table):
    """The exit status, see `two_commits.main`."""
    # A call of one step is a single one here: the benchmark of two commits repeats short calls itself.
    counts = {row: 1 if row == rows.CALL else rows.per_step(row, options.n, options.steps) for row in ROWS}

    def compare(sides, left_out):
        for name in options.robots:
            begin = name, options.n, options.steps
            yield from sides.compared(f"{name}, float32", begin, ROWS, counts, options, left_out)

    about = f"{options.n} states, rollouts of {options.steps} steps.", machine
    return two_commits.main(__file__, compare, options, about, "state and step", table)


class _Programs(two_commits.Programs):
    """Compiled rows of a robot."""

    def mechanism(self, *about):
        self.about, mech = about, rows.mechanism(about[0])
        self.arguments = {row: arguments for row, (_, arguments) in rows.calls(*about, mech).items()}
        return mech

    def cold(self, row):
        return compiling.cold(lambda: self._function(row), self.arguments[row])

    def _function(self, row):
        return rows.calls(*self.about, compiling.watched(rows.mechanism(self.about[0])))[row][0]


if __name__ == "__main__":
    two_commits.serve(_Programs())
