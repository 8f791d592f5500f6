"""The other sides of `dynamics.py`: Pinocchio and MuJoCo in C++, compiled on the spot, frax and MuJoCo MJX in JAX.

Each is a function (q, v, a) -> the result, for arrays in the order of its own coordinates. Pinocchio's Python package
is imported where it is used, after the libraries are loaded: the other way round they would take parts of their code
from it.
"""

import ctypes
import pathlib
import subprocess
import sysconfig
import tempfile
import warnings
import xml.etree.ElementTree

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx
from mujoco.mjx._src import smooth

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import frax

HERE = pathlib.Path(__file__).parent
PACKAGES = pathlib.Path(sysconfig.get_paths()["purelib"])
PREFIX = PACKAGES / "cmeel.prefix"
FLAGS = ["-O3", "-march=native", "-DNDEBUG", "-std=c++17", "-shared", "-fPIC"]
MACROS = ["BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "BOOST_MPL_LIMIT_LIST_SIZE=30", "BOOST_MPL_LIMIT_VECTOR_SIZE=30"]
MACROS += ["FUSION_MAX_VECTOR_SIZE=10", "BOOST_FUSION_INVOKE_MAX_ARITY=10"]
# Models cross the border to the wheel's library, which was built for any x86-64 processor.
MACROS += ["EIGEN_MAX_ALIGN_BYTES=16", "EIGEN_MAX_STATIC_ALIGN_BYTES=16"]
SCALARS = {"float32": "float", "float64": "double"}
ALGORITHMS = ["inverse dynamics", "forward dynamics"]
GRAVITY = (0.0, 0.0, 9.81, 0.0, 0.0, 0.0)  # upwards, linear part first


# -- C++ --------------------------------------------------------------------------------------------------------------


def pinocchio_library(dtype, folder):
    """Pinocchio's recursions for a dtype, as a library: of the one robot that is loaded last."""
    macros = [f"-D{x}" for x in (f"SCALAR={SCALARS[dtype]}", *MACROS)]
    includes = [f"-I{PREFIX / 'include'}", f"-I{PREFIX / 'include/eigen3'}"]
    links = [f"-L{PREFIX / 'lib'}", "-lpinocchio_default", "-lboost_serialization", f"-Wl,-rpath,{PREFIX / 'lib'}"]
    return _built("dynamics_pinocchio.cpp", pathlib.Path(folder) / f"pinocchio_{dtype}.so", [*macros, *includes], links)


def mujoco_library(folder):
    place = pathlib.Path(mujoco.__file__).parent
    (library,) = place.glob("libmujoco.so.*")
    links = [str(library), f"-Wl,-rpath,{place}"]
    return _built("dynamics_mujoco.cpp", pathlib.Path(folder) / "mujoco.so", [f"-I{place / 'include'}"], links)


def _built(source, library, options, links):
    if not library.exists():
        subprocess.run(["g++", *FLAGS, *options, str(HERE / source), "-o", library, *links], check=True)
    return ctypes.CDLL(str(library))


def run(library, algorithm, arrays):
    """A function without arguments: the whole batch through a library."""
    arrays = [np.ascontiguousarray(x) for x in arrays]
    out = np.empty_like(arrays[1])
    pointers = [ctypes.c_void_p(x.ctypes.data) for x in (*arrays, out)]
    number, n = ALGORITHMS.index(algorithm), ctypes.c_long(len(out))

    def call(_alive=arrays):
        library.run(number, n, *pointers)
        return out

    return call


def load_pinocchio(library, robot):
    """Pinocchio's model in Python, also given to the library."""
    import pinocchio as pin

    root = (pin.JointModelFreeFlyer(),) if robot.floating_base else ()
    model = pin.buildModelFromUrdf(str(robot.urdf), *root)
    with tempfile.NamedTemporaryFile(suffix=".bin") as file:
        model.saveToBinary(file.name)
        library.load(file.name.encode())
    return model


def load_mujoco(library, robot):
    model = mujoco_model(robot)
    with tempfile.NamedTemporaryFile(suffix=".mjb") as file:
        mujoco.mj_saveModel(model, file.name, None)
        library.load(file.name.encode())
    return model


def mujoco_model(robot):
    """Of the same URDF, without its shapes."""
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
    return spec.compile()


# -- JAX --------------------------------------------------------------------------------------------------------------


def frax_program(robot, algorithm):
    """One item; the floating base of frax is its own model of the robot."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = {"panda": frax.load_panda, "g1": frax.load_g1}[robot.name]()
    if algorithm == "inverse dynamics":
        return lambda q, v, a: model.rnea(q, v, a, jnp.asarray(GRAVITY, q.dtype), None)
    return lambda q, v, tau: model.forward_dynamics(q, v, tau, None)


def mjx_program(robot, algorithm):
    """One item, of the pipeline what the result needs."""
    model = mjx.put_model(mujoco_model(robot))
    start = mjx.make_data(model)

    def placed(q, v):
        d = start.replace(qpos=q, qvel=v)
        return smooth.com_pos(model, smooth.kinematics(model, d))

    def inverse(q, v, a):
        d = smooth.com_vel(model, placed(q, v).replace(qacc=a))
        return smooth.rne(model, d, flg_acc=True).qfrc_bias

    def forward(q, v, tau):
        d = placed(q, v)
        d = smooth.factor_m(model, smooth.crb(model, d))
        bias = smooth.rne(model, smooth.com_vel(model, d)).qfrc_bias
        return smooth.solve_m(model, d, tau - bias)

    return inverse if algorithm == "inverse dynamics" else forward


def urdf(name):
    """The robots that come with frax."""
    places = {"panda": "franka_panda/panda.urdf", "g1": "unitree_g1/g1_29dof_rev_1_0.urdf"}
    return PACKAGES / "frax" / "assets" / places[name]


def expected(model, algorithm, arrays):
    """Of states, by Pinocchio in Python, in float64."""
    import pinocchio as pin

    data = model.createData()
    function = pin.rnea if algorithm == "inverse dynamics" else pin.aba
    return np.stack([function(model, data, *x) for x in zip(*arrays, strict=True)])


def versions():
    import pinocchio as pin

    names = f"pin {pin.__version__}, mujoco {mujoco.__version__}, frax {getattr(frax, '__version__', '0.1.0')}"
    return f"g++ {' '.join(FLAGS[:3])}, {names}"


def with_dtype(dtype):
    return jax.enable_x64(dtype == "float64")
