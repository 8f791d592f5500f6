"""Which law of contact for which number: what gradients of whole runs tell of a planar box that is thrown.

`python -m tests.helpers.contact_laws` prints the table of notebooks/learning.md.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxspatial as js

CORNERS = np.array([[x, y, 0] for x in (-0.1, 0.1) for y in (-0.15, 0.15)])
NUMBERS = ("stiffness", "friction", "dissipation", "mass", "speed")
# Logarithms of the numbers over the true ones.
VALUES = np.linspace(-np.log(4), np.log(4), 8)
SETS, THROWS = 12, 16


class Law(NamedTuple):
    """A law of contact, in n steps of dt s. stiction_speed, m/s: of `contact_forces`, None for `convex_step`."""

    dt: float
    n: int
    stiction_speed: float | None = None

    def __str__(self):
        of = "`convex_step`" if self.stiction_speed is None else f"`contact_forces`, {self.stiction_speed} m/s"
        return f"{of} | {self.n} of {1e3 * self.dt:.0f} ms"

    def true(self):
        """The NUMBERS: N/m, 1, relaxation time in s or dissipation in s/m, kg, m/s."""
        return np.array([3e3, 0.45, 0.02 if self.stiction_speed is None else 0.3, 1.0, 2.0])


LAWS = (
    *(Law(5e-3, 80), Law(5e-3, 160), Law(1e-2, 80)),
    *(Law(2e-3, 200, 0.3), Law(5e-3, 80, 0.3), Law(5e-3, 80, 0.1)),
)


def box():
    """Of 0.2 m by 0.3 m, in the plane z = 0, y up."""
    M = js.SpatialInertia.solid_box(np.array([0.2, 0.3, 0.2]), mass=1.0)
    joint = js.Joint("root", "planar", "world", "box")
    return js.Mechanism.build([js.Body("box", M)], [joint], gravity=(0, -9.81, 0), dtype=np.float64)


def throws(n, highest=0.3, seed=0):
    """q (n, 3) up to so many m above the ground, at any angle, and v (n, 3) in world axes, of a unit speed along it."""
    rng = np.random.default_rng(seed)
    angle, height, rate, spin = rng.uniform([-np.pi, 0, -1, -3], [np.pi, highest, -0.3, 3], (n, 4)).T
    lowest = -0.1 * abs(np.sin(angle)) - 0.15 * abs(np.cos(angle))
    return np.stack([0 * angle, height - lowest, angle], 1), np.stack([0 * angle + 1, rate, spin], 1)


def path(law, logarithms, q, v):
    """(n, 4, 2) corners after each step, m. logarithms: (5,) of the numbers over the true ones."""
    k, mu, loss, mass, speed = jnp.exp(logarithms) * law.true()
    mech, ground = box(), js.HalfSpace([0.0, 1.0, 0.0])
    M = mech.inertias
    mech = mech.replace(inertias=js.SpatialInertia(mass * M.mass, M.com, mass * M.central))
    is_convex, (across, along, _) = law.stiction_speed is None, CORNERS.T
    relaxation_time = loss if is_convex else 0.0
    touching = js.PointContacts(["box"] * 4, CORNERS, stiffness=k, relaxation_time=relaxation_time, friction=mu)

    def one(state, _):
        if is_convex:
            after = js.convex_step(mech, *state, np.zeros(3), law.dt, contacts=touching, ground=ground)[:2]
        else:
            own = {"dissipation": loss, "stiction_speed": law.stiction_speed}
            forces = js.contact_forces(mech, *state, touching, ground, **own)
            after = js.semi_implicit_step(mech, *state, np.zeros(3), law.dt, forces)
        x, y, angle = after[0]
        c, s = jnp.cos(angle), jnp.sin(angle)
        return after, jnp.stack([x + c * across - s * along, y + s * across + c * along], -1)

    c, s = jnp.cos(q[2]), jnp.sin(q[2])
    vx, vy, spin = speed * v[0], v[1], v[2]
    in_body = jnp.stack([c * vx + s * vy, c * vy - s * vx, spin])
    return jax.lax.scan(one, (q, in_body), None, law.n)[1]


def losses(law, logarithms, q, v, truth):
    """(2,): the mean squared distance of the corners from a path, m2, after the last step and over all of them."""
    squares = ((path(law, logarithms, q, v) - truth) ** 2).sum(-1).mean(-1)
    return jnp.stack([squares[-1], squares.mean()])


def over_throws(law, function):
    """function(losses of a number's logarithm, value), for all numbers, values and throws: (5, values, throws, ...)."""

    def at(number, value, q, v, truth):
        direction = jnp.eye(len(NUMBERS))[number]
        return function(lambda value: losses(law, value * direction, q, v, truth), value)

    def all_of(values, q, v):
        truth = jax.vmap(lambda q, v: path(law, jnp.zeros(len(NUMBERS)), q, v))(q, v)
        every = jax.vmap(at, (None, None, 0, 0, 0))
        every = jax.vmap(jax.vmap(every, (None, 0, None, None, None)), (0, None, None, None, None))
        return every(jnp.arange(len(NUMBERS)), values, q, v, truth)

    return all_of


def derivative(of, value):
    return jax.jvp(of, (value,), (1.0,))[1]


def differences(of, value, apart=(1e-6, 1e-7, 1e-8)):
    """(3, ...) at several distances: rounding errors spoil the small ones, and a run that diverges the large ones."""
    d = np.array(apart)
    ahead, behind = (jax.vmap(of)(value + x) for x in (d, -d))
    return jax.vmap(lambda x, d: x / (2 * d))(ahead - behind, d)


class Shares(NamedTuple):
    """Of gradients: (5,) that agree with differences, and (5, 2) that point to the truth by the last state and by the
    path, of one throw and of sets of throws together."""

    agree: np.ndarray
    of_one: np.ndarray
    of_sets: np.ndarray


def shares(law):
    q, v = throws(SETS * THROWS)
    exact = np.asarray(jax.jit(over_throws(law, derivative))(VALUES, q, v))
    few = VALUES, q[:THROWS], v[:THROWS]
    near = np.asarray(jax.jit(over_throws(law, differences))(*few))
    # Of a loss itself, as a gradient far below it is lost among the rounding errors of differences.
    size = np.asarray(jax.jit(over_throws(law, lambda of, value: of(value)))(*few))[..., None, :]
    agree = (abs(exact[:, :, :THROWS, None] - near) <= 1e-4 * abs(near) + 1e-5 * size).any(3)

    def right(slopes):
        return (np.sign(slopes) == np.sign(VALUES)[:, None, None]).mean((1, 2))

    together = exact.reshape(*exact.shape[:2], SETS, THROWS, 2).mean(3)
    return Shares(agree.mean((1, 2, 3)), right(exact), right(together))


def learned(law, starts=8, updates=300):
    """(starts, 3) stiffness, friction and dissipation over the true ones, as Adam finds them together from the paths
    of THROWS throws, with all of them wrong by a factor from a quarter to four at first."""
    import optax

    q, v = throws(THROWS)
    known, adam = np.zeros(len(NUMBERS) - 3), optax.adam(0.05)

    def learn(x, truth):
        def loss(x):
            return jax.vmap(lambda *own: losses(law, jnp.concatenate([x, known]), *own)[1])(q, v, truth).mean()

        def update(carry, _):
            x, state = carry
            change, state = adam.update(jax.grad(loss)(x), state)
            return (x + change, state), None

        return jnp.exp(jax.lax.scan(update, (x, adam.init(x)), None, updates)[0][0])

    truth = jax.jit(jax.vmap(lambda q, v: path(law, np.zeros(len(NUMBERS)), q, v)))(q, v)
    first = np.random.default_rng(0).uniform(-np.log(4), np.log(4), (starts, 3))
    return np.asarray(jax.jit(jax.vmap(learn, (0, None)))(first, truth))


def table():
    """Its rows and their Shares: in percent, how many gradients agree with differences, and point to the truth."""
    for law in LAWS:
        found = shares(law)
        cells = [f"{100 * path:.0f} ({100 * last:.0f})" for last, path in found.of_sets]
        yield "| " + " | ".join([str(law), f"{100 * found.agree.min():.0f}", *cells]) + " |", found


if __name__ == "__main__":
    with jax.enable_x64(True):
        for row, found in table():
            print(row, "of one throw:", *np.round(100 * found.of_one[:, 1]))
