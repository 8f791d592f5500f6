"""The other sides of `dynamics.py`: Pinocchio and MuJoCo in C++, compiled on the spot, frax and MuJoCo MJX in JAX.

Each takes arrays in the order of its own coordinates. Pinocchio's Python package is imported where it is used, after
the libraries are loaded: the other way round they would take parts of their code from it.
"""

import ctypes
import functools
import hashlib
import importlib.metadata
import os
import pathlib
import platform
import subprocess
import sysconfig
import tempfile
import warnings
import xml.etree.ElementTree
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from dynamics_claims import (
    BY_INERTIAS,
    FORWARD,
    FORWARD_BY_JVP,
    FORWARD_BY_MATRICES,
    FORWARD_DERIVATIVES,
    GRADIENT,
    GRADIENT_OF_STEP,
    INVERSE,
    INVERSE_BY_JVP,
    INVERSE_BY_MATRICES,
    INVERSE_DERIVATIVES,
    INVERSE_MASS_TIMES,
    JACOBIAN,
    JACOBIAN_BY_PULLBACK,
    JACOBIAN_TIMES,
    KINEMATICS,
    MASS,
    MASS_BY_DYNAMICS,
    MASS_TIMES,
    MUJOCO,
    PRODUCTS,
    STEP,
)
from mujoco import mjx

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import frax

HERE = pathlib.Path(__file__).parent
# Of compiled libraries.
CACHE = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "jaxspatial" / "benchmarks"
PACKAGES = pathlib.Path(sysconfig.get_paths()["purelib"])
PREFIX = PACKAGES / "cmeel.prefix"
FLAGS = ["-O3", "-march=native", "-DNDEBUG", "-std=c++17", "-shared", "-fPIC"]
MACROS = ["BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "BOOST_MPL_LIMIT_LIST_SIZE=30", "BOOST_MPL_LIMIT_VECTOR_SIZE=30"]
MACROS += ["FUSION_MAX_VECTOR_SIZE=10", "BOOST_FUSION_INVOKE_MAX_ARITY=10"]
# Models cross the border to the wheel's library, which was built for any x86-64 processor.
MACROS += ["EIGEN_MAX_ALIGN_BYTES=16", "EIGEN_MAX_STATIC_ALIGN_BYTES=16"]
SCALARS = {"float32": "float", "float64": "double"}
GRAVITY = (0.0, 0.0, 9.81, 0.0, 0.0, 0.0)  # upwards, linear part first
DT = 0.002  # s, of steps, as in the C++ files
MODELS = {"panda": "franka_panda/panda.urdf", "g1": "unitree_g1/g1_29dof_rev_1_0.urdf"}
TIPS = {"panda": "panda_joint7", "g1": "left_wrist_yaw_joint"}  # the joints whose bodies' Jacobians are computed


class Robot(NamedTuple):
    """One of those that come with frax."""

    name: str
    floating_base: bool

    @property
    def urdf(self):
        return PACKAGES / "frax" / "assets" / MODELS[self.name]

    @property
    def tip(self):
        return TIPS[self.name]


ROBOTS = {"panda": Robot("panda", False), "g1": Robot("g1", True)}


class Library(NamedTuple):
    """Of one robot, the one that is loaded last. sizes: algorithm -> how many numbers the result of a state has, in
    the order of the C++ file; 0 for one result of all states, of `n_parameters` numbers."""

    call: Any
    sizes: dict
    n_parameters: int


# -- C++ --------------------------------------------------------------------------------------------------------------


def built(dtypes, folder, cores):
    """name -> ctypes library: Pinocchio's algorithms per dtype, side by side on all cores, and MuJoCo's. What is in the
    folder already is not built again."""
    pinned = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)  # for the compilers, which inherit it
    started = {dtype: _started(_pinocchio_command("dynamics_pinocchio.cpp", dtype), folder) for dtype in dtypes}
    started[MUJOCO] = _started(_mujoco_command(), folder)
    os.sched_setaffinity(0, pinned)
    return {name: _finished(*x) for name, x in started.items()}


def built_from(file, dtype, folder):
    """One library: Pinocchio's algorithms that a C++ file beside this one calls."""
    return _finished(*_started(_pinocchio_command(file, dtype), folder))


def _pinocchio_command(file, dtype):
    macros = [f"-D{x}" for x in (f"SCALAR={SCALARS[dtype]}", *MACROS)]
    includes = [f"-I{PREFIX / 'include'}", f"-I{PREFIX / 'include/eigen3'}"]
    links = [f"-L{PREFIX / 'lib'}", "-lpinocchio_default", "-lboost_serialization", f"-Wl,-rpath,{PREFIX / 'lib'}"]
    return HERE / file, [*macros, *includes, "-w"], links


def _mujoco_command():
    place = pathlib.Path(mujoco.__file__).parent
    (library,) = place.glob("libmujoco.so.*")
    return HERE / "dynamics_mujoco.cpp", [f"-I{place / 'include'}"], [str(library), f"-Wl,-rpath,{place}"]


def _started(command, folder):
    """(the compiler, None where nothing is to do; what it writes; the library's place)."""
    source, options, links = command
    told = [source.read_text(), *FLAGS, *options, *links, versions(), platform.node()]
    name = hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]
    library = pathlib.Path(folder) / f"{source.stem}_{name}.so"
    if library.exists():
        return None, None, library
    library.parent.mkdir(parents=True, exist_ok=True)
    unfinished = library.with_suffix(f".{os.getpid()}")
    compiler = subprocess.Popen(["g++", *FLAGS, *options, str(source), "-o", str(unfinished), *links])
    return compiler, unfinished, library


def _finished(compiler, unfinished, library):
    if compiler is not None:
        if compiler.wait():
            raise subprocess.CalledProcessError(compiler.returncode, compiler.args)
        os.replace(unfinished, library)
    return ctypes.CDLL(str(library))


def run(library, algorithm, arrays):
    """A function without arguments: the whole batch of arrays (q, v, a, cotangent) through a library."""
    arrays = [np.ascontiguousarray(x) for x in arrays]
    size, n = library.sizes[algorithm], len(arrays[0])
    out = np.empty((n, size) if size else library.n_parameters, arrays[0].dtype)
    pointers = [ctypes.c_void_p(x.ctypes.data) for x in (*arrays, out)]
    number, lengths = list(library.sizes).index(algorithm), (ctypes.c_long(n), ctypes.c_long(size))

    def call(_alive=arrays):
        library.call(number, *lengths, *pointers)
        return out

    return call


def load_pinocchio(library, robot):
    """(Pinocchio's model in Python, the Library that it was given to)."""
    import pinocchio as pin

    root = (pin.JointModelFreeFlyer(),) if robot.floating_base else ()
    model = pin.buildModelFromUrdf(str(robot.urdf), *root)
    hand_over(model, library, model.getFrameId(robot.tip))
    nq, nv, n = model.nq, model.nv, model.njoints - 1
    sizes = {INVERSE: nv, FORWARD: nv, MASS: nv * nv, KINEMATICS: 12 * n, JACOBIAN: 6 * nv}
    sizes |= {INVERSE_DERIVATIVES: 3 * nv * nv, FORWARD_DERIVATIVES: 3 * nv * nv}
    sizes |= {GRADIENT: 3 * nv, BY_INERTIAS: 0, STEP: nq + nv, **dict.fromkeys(PRODUCTS, nv)}
    return model, Library(library.run, sizes, 10 * n)


def hand_over(model, library, frame):
    """Gives Pinocchio's model in Python to a library, with the frame of its Jacobians."""
    with tempfile.NamedTemporaryFile(suffix=".bin") as file:
        model.saveToBinary(file.name)
        library.load(file.name.encode(), frame)


def load_mujoco(library, robot):
    model = mujoco_model(robot)
    body = int(model.jnt_bodyid[model.joint(robot.tip).id])
    with tempfile.NamedTemporaryFile(suffix=".mjb") as file:
        mujoco.mj_saveModel(model, file.name, None)
        library.load(file.name.encode(), body)
    nq, nv = model.nq, model.nv
    sizes = {INVERSE: nv, FORWARD: nv, MASS: nv * nv, KINEMATICS: 7 * model.nbody, JACOBIAN: 6 * nv, STEP: nq + nv}
    return Library(library.run, sizes, 0)


def mujoco_model(robot):
    """Of the same URDF, without its shapes, contacts and limits."""
    root = xml.etree.ElementTree.parse(robot.urdf).getroot()
    for link in root.iter("link"):
        for shape in [x for x in link if x.tag in ("visual", "collision")]:
            link.remove(shape)
    for old in root.findall("mujoco"):
        root.remove(old)
    options = {"fusestatic": str(not robot.floating_base).lower(), "balanceinertia": "false", "strippath": "true"}
    xml.etree.ElementTree.SubElement(xml.etree.ElementTree.SubElement(root, "mujoco"), "compiler", options)
    spec = mujoco.MjSpec.from_string(xml.etree.ElementTree.tostring(root, encoding="unicode"))
    if robot.floating_base:
        spec.worldbody.first_body().add_freejoint()
    spec.option.timestep = DT
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return spec.compile()


# -- JAX: functions of a batch of arrays (q, v, a, cotangent) ---------------------------------------------------------


def pulled_back(function, arguments, cotangents):
    """The gradients with respect to all arguments of a state."""
    return jax.vjp(function, *arguments)[1](cotangents)


def frax_programs(robot):
    """algorithm -> program. What frax does not do is not there; the floating base is its own model of the robot."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = {"panda": frax.load_panda, "g1": frax.load_g1}[robot.name]()

    def forward(q, v, tau):
        return model.forward_dynamics(q, v, tau, None)

    def step(q, v, tau):
        after = v + DT * forward(q, v, tau)
        return model.integrate(q, after, DT), after

    programs = {
        INVERSE: lambda q, v, a, c: model.rnea(q, v, a, jnp.asarray(GRAVITY, q.dtype), None),
        FORWARD: lambda q, v, tau, c: forward(q, v, tau),
        MASS: lambda q, v, a, c: model.mass_matrix(q),
        KINEMATICS: lambda q, v, a, c: model.joint_to_world_transforms(q),
        JACOBIAN: lambda q, v, a, c: model.left_hand_jacobian(q) if robot.floating_base else model.ee_jacobian(q),
        GRADIENT: lambda q, v, tau, c: pulled_back(forward, (q, v, tau), c),
        STEP: lambda q, v, tau, c: step(q, v, tau),
        GRADIENT_OF_STEP: lambda q, v, tau, c: pulled_back(step, (q, v, tau), (jnp.ones_like(q), c)),
    }
    return {name: jax.vmap(program) for name, program in programs.items()}


def mjx_programs(robot):
    """algorithm -> program: its own step, which takes seconds to compile; its other functions are parts of it."""
    model = mjx.put_model(mujoco_model(robot))
    start = mjx.make_data(model)

    def step(q, v, tau):
        after = mjx.step(model, start.replace(qpos=q, qvel=v, qfrc_applied=tau))
        return after.qpos, after.qvel

    programs = {
        STEP: lambda q, v, tau, c: step(q, v, tau),
        GRADIENT_OF_STEP: lambda q, v, tau, c: pulled_back(step, (q, v, tau), (jnp.ones_like(q), c)),
    }
    return {name: jax.vmap(program) for name, program in programs.items()}


# -- what is right, in float64 ----------------------------------------------------------------------------------------


def expected(model, robot, algorithm, arrays):
    """Of states, by Pinocchio in Python: rows of numbers as its library writes them. None where it has no such
    function."""
    found = _REFERENCES.get(algorithm)
    if found is None:
        return None
    rows = [np.concatenate([x.ravel() for x in found(model, robot, *state)]) for state in zip(*arrays, strict=True)]
    return np.sum(rows, axis=0) if algorithm == BY_INERTIAS else np.stack(rows)


def _copied(name, model, *arguments):
    """What a function of Pinocchio returns, a tuple for one array too: views of its data, which end with it."""
    import pinocchio as pin

    data = model.createData()
    found = getattr(pin, name)(model, data, *arguments)
    return [np.array(x) for x in (found if isinstance(found, tuple) else (found,))]


def _poses(model, robot, q, v, a, c):
    import pinocchio as pin

    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return [np.array(x) for X in list(data.oMi)[1:] for x in (X.rotation.T, X.translation)]


def _jacobian(model, robot, q, v, a, c):
    import pinocchio as pin

    frame = model.getFrameId(robot.tip)
    return [x.T for x in _copied("computeFrameJacobian", model, q, frame, pin.LOCAL_WORLD_ALIGNED)]


def _derivatives(name, model, robot, q, v, a, c):
    return [x.T for x in _copied(name, model, q, v, a)]


def _gradient(model, robot, q, v, tau, c):
    return [x.T @ c for x in _copied("computeABADerivatives", model, q, v, tau)]


def _simple(name, *used):
    return lambda model, robot, *state: _copied(name, model, *(state[i] for i in used))


def _of_parameters(model, robot, q, v, a, c):
    return [_copied("computeJointTorqueRegressor", model, q, v, a)[0].T @ c]


def _step(model, robot, q, v, tau, c):
    import pinocchio as pin

    after = v + DT * _copied("aba", model, q, v, tau)[0]
    return [pin.integrate(model, q, DT * after), after]


def _symmetric(upper):
    return np.triu(upper) + np.triu(upper, 1).T


def _mass(model, q):
    return _symmetric(_copied("crba", model, q)[0])


def _mass_times(model, robot, q, v, a, c):
    return [_mass(model, q) @ c]


def _jacobian_times(model, robot, *state):
    """The wrench is torque on top of force here, and so are a floating base's coordinates; there force is on top."""
    wrench = state[-1][:6] if robot.floating_base else np.roll(state[-1][:6], 3)
    return [_jacobian(model, robot, *state)[0] @ wrench]


def _times_directions(name, model, robot, q, v, a, c):
    by_q, by_v, by_a = _copied(name, model, q, v, a)
    return [by_q @ c + by_v @ a + _symmetric(by_a) @ v]


_OF_INVERSE = functools.partial(_times_directions, "computeRNEADerivatives")
_OF_FORWARD = functools.partial(_times_directions, "computeABADerivatives")
_REFERENCES = {
    INVERSE: _simple("rnea", 0, 1, 2),
    FORWARD: _simple("aba", 0, 1, 2),
    MASS: _simple("crba", 0),
    KINEMATICS: _poses,
    JACOBIAN: _jacobian,
    INVERSE_DERIVATIVES: functools.partial(_derivatives, "computeRNEADerivatives"),
    FORWARD_DERIVATIVES: functools.partial(_derivatives, "computeABADerivatives"),
    GRADIENT: _gradient,
    BY_INERTIAS: _of_parameters,
    STEP: _step,
    MASS_TIMES: _mass_times,
    MASS_BY_DYNAMICS: _mass_times,
    INVERSE_MASS_TIMES: lambda model, robot, q, v, a, c: [np.linalg.solve(_mass(model, q), c)],
    JACOBIAN_TIMES: _jacobian_times,
    JACOBIAN_BY_PULLBACK: _jacobian_times,
    INVERSE_BY_MATRICES: _OF_INVERSE,
    INVERSE_BY_JVP: _OF_INVERSE,
    FORWARD_BY_MATRICES: _OF_FORWARD,
    FORWARD_BY_JVP: _OF_FORWARD,
}


def versions():
    """Without importing Pinocchio."""
    names = ("pin", "mujoco", "mujoco-mjx", "frax")
    return f"g++ {' '.join(FLAGS[:3])}, {', '.join(f'{name} {importlib.metadata.version(name)}' for name in names)}"
