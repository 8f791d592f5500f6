"""What wrenches cost beside a step of MJX: mjx.step alone, with the conversion in the same program, and that alone.

    python tests/benchmarks/xfrc_applied.py [--write]

Robots of Brax in n environments by vmap, float32, pushed at a point of every end of a limb, in world axes. All cases
run in one process, on one core, alternately, after warm-up; ratios are taken round by round. Asserts the claims of
notebooks/simulators.md; exit status 1 if one does not hold. `--write` renews the table beside this file.
"""

import os

# One core, before XLA counts them: with two, mjx.step of 512 humanoids waits for itself for ever (jaxlib 0.10.2).
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

import argparse  # noqa: E402
import importlib.util  # noqa: E402
import pathlib  # noqa: E402
import sys  # noqa: E402
import warnings  # noqa: E402
from importlib.metadata import version  # noqa: E402
from typing import NamedTuple  # noqa: E402

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from mujoco import mjx  # noqa: E402

import jaxspatial as js  # noqa: E402
from jaxspatial import measure  # noqa: E402

HERE = pathlib.Path(__file__).parent
STEP, BOTH, CONVERSION = "mjx.step", "mjx.step of wrenches", "to_xfrc_applied"
# Frames that are pushed: the ends of the limbs.
ROBOTS = {
    "ant": ("body_4", "body_7", "body_10", "body_13"),
    "humanoid": ("right_foot", "left_foot", "right_lower_arm", "left_lower_arm"),
}


class Claim(NamedTuple):
    """Of every robot: `slower` takes at most `limit` times as long as `mjx.step`."""

    slower: str
    limit: float


CLAIMS = (Claim(BOTH, 1.1), Claim(CONVERSION, 0.1))


def cases(name, n):
    """name -> call, for n environments of a robot."""
    (folder,) = importlib.util.find_spec("brax").submodule_search_locations
    file = pathlib.Path(folder) / f"envs/assets/{name}.xml"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", js.interop.ModelFileWarning)
        robot = js.Mechanism.from_mjcf(file, dtype=np.float32)
    on_host = mujoco.MjModel.from_xml_path(str(file))
    model, start = mjx.put_model(on_host), mjx.make_data(on_host)
    q = js.random_configuration(robot, jax.random.key(0), n)
    qpos, rng = js.interop.mujoco.to_qpos(robot, q), np.random.default_rng(0)
    tau, f = jnp.asarray(rng.standard_normal((2, n, len(ROBOTS[name]), 3)), np.float32)
    points = 0.1 * rng.standard_normal((len(ROBOTS[name]), 3)).astype(np.float32)

    def rows(qpos, tau, f):
        q = js.interop.mujoco.from_qpos(robot, qpos)
        forces = js.AppliedForces(ROBOTS[name], js.SpatialForce(tau, f), points)
        return js.interop.mujoco.to_xfrc_applied(model, robot, q, forces)

    def step(qpos, applied):
        after = mjx.step(model, start.replace(qpos=qpos, xfrc_applied=applied))
        return after.qpos, after.qvel

    alone, both = jax.jit(jax.vmap(step)), jax.jit(jax.vmap(lambda qpos, tau, f: step(qpos, rows(qpos, tau, f))))
    convert = jax.jit(jax.vmap(rows))
    applied = convert(qpos, tau, f)
    return {
        STEP: lambda: alone(qpos, applied),
        BOTH: lambda: both(qpos, tau, f),
        CONVERSION: lambda: convert(qpos, tau, f),
    }


def ratios(seconds, slower):
    return seconds[slower] / seconds[STEP]


def lines(found, n):
    yield f"{n} environments by vmap, float32: medians of us per environment (10 % to 90 % of all rounds), and of the"
    yield f"ratio to {STEP} in the same round. Wrenches act at a point of each of four limbs."
    yield f"{measure.machine()}, mujoco {version('mujoco')}, mujoco-mjx {version('mujoco-mjx')}"
    for name, seconds in found.items():
        yield f"\n| {name} | us | 10 % | 90 % | / {STEP} | 10 % | 90 % |"
        yield "|---|---|---|---|---|---|---|"
        for case, each in seconds.items():
            low, middle, high = np.quantile(each / n, [0.1, 0.5, 0.9]) * 1e6
            least, ratio, most = np.quantile(ratios(seconds, case), [0.1, 0.5, 0.9])
            yield f"| {case} | {middle:.3g} | {low:.3g} | {high:.3g} | {ratio:.3f} | {least:.3f} | {most:.3f} |"
    for name, seconds in found.items():
        for claim in CLAIMS:
            value = float(np.median(ratios(seconds, claim.slower)))
            verdict = "holds" if value <= claim.limit else "DOES NOT HOLD"
            yield f"\n{name}, {claim.slower} over {STEP}: {value:.3f}, at most {claim.limit}: {verdict}."


def main(arguments=None):
    parser = argparse.ArgumentParser(description="What wrenches cost beside a step of MJX.")
    parser.add_argument("--n", type=int, default=512, help="environments")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--write", action="store_true", help="write the table to xfrc_applied.md beside this file")
    options = parser.parse_args(arguments)
    found = {name: measure.interleaved(cases(name, options.n), options.rounds) for name in options.robots}
    table = "\n".join(lines(found, options.n))
    print(table)
    if options.write:
        (HERE / "xfrc_applied.md").write_text(f"# What wrenches cost beside a step of MJX\n\n{table}\n")
    return 0 if all(np.median(ratios(s, c.slower)) <= c.limit for s in found.values() for c in CLAIMS) else 1


if __name__ == "__main__":
    sys.exit(main())
