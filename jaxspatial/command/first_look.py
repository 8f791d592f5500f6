"""The first look: in a minute, what the library is for; wrenches, a robot on the ground, and what accuracy decides."""

import argparse
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.command import algorithms, measuring, quadruped
from jaxspatial.command.algorithms import FIRST_LOOK, Loss
from jaxspatial.command.files import staged
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics
from jaxspatial.measure import timing
from jaxspatial.measure.operation import rotating_body
from jaxspatial.measure.timing import Advance
from jaxspatial.numerics.precision import OF_ALGORITHMS
from jaxspatial.spatial import SpatialForce, shift

WRENCHES, STATES, GRADIENTS, STEPS = 1_000_000, 4096, 256, 60
# Steps of the push.
_PUSHED = 20
_ROUNDS, _LIMIT = 11, 3.0
CROSS, MEMORY = "tau - jnp.cross(p, f)", "(tau + f + p) / 2"
PRECISIONS = tuple(map(str, OF_ALGORITHMS))


class Look(NamedTuple):
    """What was measured.

    wrenches: nanoseconds for each of WRENCHES, of a shift in each precision and of what it is compared with.
    torques: microseconds for the torques of an arm of seven joints, each of STATES, in each precision.
    steps: of all STATES together, in a second. gradients: of where a push leaves the robot, in a second.
    response: how much farther the trunk is after all steps for 1 N more of push, mm.
    losses: of `FIRST_LOOK`.
    """

    wrenches: dict[str, float]
    torques: dict[str, float]
    steps: float
    gradients: float
    response: float
    losses: list[Loss]


def run(given: argparse.Namespace) -> int:
    """Measures, prints a page and draws a picture; returns the exit status."""
    measuring.check_installed(given, "lxml")  # which reads the robot
    from jaxspatial.command import picture, report

    path, console = measuring.picture_of(given), measuring.console_on()
    assert path is not None and console is not None  # without --json, which is no first look
    console.print(f"{timing.machine()}\n", soft_wrap=True)
    look = report.with_progress(console, measure, 5 + len(PRECISIONS) + len(FIRST_LOOK))
    report.print_first_look(console, look)
    with staged(path, given.overwrite) as file:
        picture.draw_first_look(look, file, path.suffix[1:].lower())
    console.print(f"picture: {path}", markup=False)
    return 0


def measure(
    advance: Advance = lambda: None,
    wrenches: int = WRENCHES,
    states: int = STATES,
    gradients: int = GRADIENTS,
    steps: int = STEPS,
) -> Look:
    """All of it. Compiled side by side, and then timed, one after the other and alone."""
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        # What takes longest first.
        gradient = pool.submit(_compiled, jax.value_and_grad(_end), gradients, steps)
        step = pool.submit(_compiled, _end, states, steps)
        arms = {precision: pool.submit(_torques, precision, states) for precision in PRECISIONS}
        found = [pool.submit(algorithms.loss, application) for application in FIRST_LOOK]
        losses = [_done(future, advance) for future in found]
        torques = {precision: _done(future, advance) for precision, future in arms.items()}
        rollout, derivative = _done(step, advance), _done(gradient, advance)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    nanoseconds = _wrenches(wrenches)
    advance()
    taken = timing.interleaved(torques, _ROUNDS, limit=_LIMIT)
    microseconds = {precision: float(np.median(x)) / states * 1e6 for precision, x in taken.items()}
    advance()
    seconds = timing.interleaved({"steps": rollout, "gradients": derivative}, _ROUNDS, limit=_LIMIT)
    advance()
    steps_a_second, gradients_a_second = (
        n / float(np.median(seconds[name])) for name, n in (("steps", states * steps), ("gradients", gradients))
    )
    response = 1e3 * float(np.mean(derivative()[1][:, 1]))
    return Look(nanoseconds, microseconds, steps_a_second, gradients_a_second, response, losses)


def _done(future, advance):
    result = future.result()
    advance()
    return result


def _wrenches(n: int) -> dict[str, float]:
    """Nanoseconds for each of n float32 wrenches, each moved by an offset of its own, in place."""
    scene = rotating_body(n)
    tau, f = (jnp.asarray(x, jnp.float32) for x in (scene.tau, scene.f))
    p = jnp.asarray(np.random.default_rng(0).uniform(-0.5, 0.5, (n, 3)), jnp.float32)

    def in_place(torque: Callable[..., Any]):
        program = jax.jit(torque, donate_argnums=0)
        state = [tau + 0]

        def call():
            state[0] = program(state[0], f, p)
            return state[0]

        return call

    def shifted(precision):
        return lambda tau, f, p: shift(SpatialForce(tau, f), p, precision=precision).tau

    calls = {precision: in_place(shifted(precision)) for precision in PRECISIONS}
    calls[CROSS] = in_place(lambda tau, f, p: tau - jnp.cross(p, f))
    # Without the product XLA takes five times as long for it on CPUs, in place.
    calls[MEMORY] = in_place(lambda tau, f, p: (tau + f + p) * 0.5)
    seconds = timing.interleaved(calls, 3 * _ROUNDS, limit=_LIMIT)
    return {name: float(np.median(x)) / n * 1e9 for name, x in seconds.items()}


def _end(push, steps: int):
    """Where the trunk is, y, m, after steps of 5 ms, in the first of which it is pushed, by a force, N."""
    mech = quadruped.mechanism()

    def after(state, i):
        q, v = state
        found = quadruped.step(mech, q, v, jnp.where(i < _PUSHED, push, 0))
        return (found.q, found.v), None

    (q, _), _ = jax.lax.scan(after, quadruped.standing(), np.arange(steps))
    return q[5]


def _compiled(function, n, steps):
    """For n pushes at once."""
    pushes = np.random.default_rng(0).uniform(-quadruped.PUSH, quadruped.PUSH, (n, 3)).astype(np.float32)
    return timing.compiled(jax.vmap(lambda push: function(push, steps)), "reproducible", [pushes])


def _torques(precision, n):
    """Of the arm in n random states."""
    arm, rng = algorithms.arm(), np.random.default_rng(0)
    state = list(rng.uniform(-1, 1, (3, n, arm.nv)).astype(np.float32))
    return timing.compiled(jax.vmap(lambda q, v, vdot: inverse_dynamics(arm, q, v, vdot)), precision, state)
