"""Which URDF and MJCF files of public packages load, and how far what they make is from Pinocchio and MuJoCo.

    python tests/benchmarks/model_files.py [PACKAGE | NAME=FOLDER ...] [--rows FILE] [--before FILE]
                                           [--largest N] [--write]

A package is one that is installed, such as example-robot-data; a folder is one into which a package was unpacked, or a
repository cloned. Without any, all packages of `PACKAGES` that are installed. Nothing of them is needed elsewhere here.

Compared are the mass matrix, bias forces, gravity forces and poses of all bodies, and of MJCF the passive forces, in
float64 at two random states, relative to the largest number of each result. Exit status 1 if one is above 1e-9. Every
file counts once, in the first source that has it. `--largest` compares only mechanisms of at most so many velocities;
all others are loaded, and counted, by both. `--rows` keeps what was found, one file per line; `--before` takes
such a file, of another commit, into the table beside it; `--write` renews tests/peers/model_files.md.
"""

import argparse
import collections
import gc
import hashlib
import importlib.metadata
import json
import pathlib
import re
import sys
import warnings

import jax
import jax.numpy as jnp
import numpy as np

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

import jaxspatial as js  # noqa: E402
from jaxspatial.interop import ModelFileWarning  # noqa: E402
from jaxspatial.interop import mujoco as states  # noqa: E402
from tests.helpers.interpreted import interpreted  # noqa: E402

PACKAGES = (
    "example-robot-data", "pybullet", "mani-skill", "genesis-world", "dexmate-urdf", "icub-models",
    "fourier-robot-descriptions", "airo-models", "hello-robot-stretch-urdf", "jvrc-description", "mujoco", "mujoco-mjx",
    "brax", "dm-control", "gymnasium-robotics", "playground", "metaworld", "robosuite", "myosuite", "myo-sim",
)  # fmt: skip
SUFFIXES = {".urdf", ".xml", ".mjcf"}
ALLOWED = 1e-9
N = 2


def main(arguments=None):
    parser = argparse.ArgumentParser(description="Which model files of public packages load, and how right they are.")
    parser.add_argument("sources", nargs="*", metavar="PACKAGE|NAME=FOLDER")
    parser.add_argument("--rows", type=pathlib.Path, help="a file of what was found, one model file per line")
    parser.add_argument("--before", type=pathlib.Path, help="rows of another commit, for the table")
    parser.add_argument("--loads", action="store_true", help="compare nothing, find out which files load")
    parser.add_argument("--largest", type=int, default=1 << 30, help="velocities of the largest mechanism to compare")
    parser.add_argument("--write", action="store_true", help="write the table to tests/peers/model_files.md")
    options = parser.parse_args(arguments)
    gc.disable()
    jax.config.update("jax_enable_x64", True)
    rows = _kept(options.rows)
    for source, file, name in _files(options.sources or [p for p in PACKAGES if _is_installed(p)]):
        if (source, name) not in rows:
            rows[source, name] = row = {
                "source": source,
                "file": name,
                **measured(file, options.loads, options.largest),
            }
            if options.rows:
                with options.rows.open("a") as kept:
                    kept.write(json.dumps(row) + "\n")
            print(source, name, row["ours"][:120], row.get("error", ""), file=sys.stderr, flush=True)
            jax.clear_caches()
            gc.collect()
    text = "\n".join(report(list(rows.values()), list(_kept(options.before).values())))
    print(text)
    if options.write:
        (ROOT / "tests/peers/model_files.md").write_text(text + "\n")
    return 0 if all(row.get("error", 0.0) <= ALLOWED for row in rows.values()) else 1


def _kept(path):
    lines = path.read_text().splitlines() if path and path.exists() else []
    return {(row["source"], row["file"]): row for row in map(json.loads, lines)}


def _is_installed(package):
    try:
        return bool(importlib.metadata.version(package))
    except importlib.metadata.PackageNotFoundError:
        return False


def _files(sources):
    """(source, path, name) of every model file, each once. Of objects made at random by the hundred the first ten."""
    seen = set()
    for source in sources:
        name, _, folder = source.partition("=")
        if folder:
            paths = [(path, str(path.relative_to(folder))) for path in sorted(pathlib.Path(folder).rglob("*"))]
        else:
            paths = [(pathlib.Path(str(f.locate())), str(f)) for f in importlib.metadata.files(name) or []]
        made = 0
        for path, short in paths:
            if path.suffix.lower() not in SUFFIXES or not path.is_file():
                continue
            data = path.read_bytes()
            made += "random_urdfs" in short
            if (made > 10 and "random_urdfs" in short) or not re.search(rb"<(\w+:)?(robot|mujoco)\b", data):
                continue
            # The text alone: the same model stands in several packages, and meshes are beside it in one.
            digest = hashlib.sha256(data).digest()
            if digest not in seen:
                seen.add(digest)
                yield name, path, short


def measured(file, only_loads=False, largest=1 << 30):
    """{"format", "peer": what the peer says, "ours": "loads" or the message, "error" where both load}."""
    is_urdf = re.search(rb"<(\w+:)?robot\b", file.read_bytes()) is not None
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        mech, ours = _loaded(js.Mechanism.from_urdf if is_urdf else js.Mechanism.from_mjcf, file)
    said = [x.message for x in said if isinstance(x.message, ModelFileWarning)]
    row = {"format": "URDF" if is_urdf else "MJCF", "ours": ours, "warning": str(said[0]) if said else ""}
    if only_loads:
        return row
    compare = _with_pinocchio if is_urdf else _with_mujoco
    try:
        found = compare(file, mech if mech is not None and mech.nv <= largest else None)
    except Exception as error:  # What a peer cannot read has nothing to be compared with.
        return row | {"peer": " ".join(f"{type(error).__name__}: {error}".split())[:300]}
    return row | {"peer": "loads"} | found


def _loaded(read, file):
    try:
        return read(file, dtype=np.float64), "loads"
    except Exception as error:  # Whatever it is, it is a row of the table.
        return None, " ".join(f"{type(error).__name__}: {error}".split())


def _worst(pairs):
    """The largest error, relative to the largest number of each result, and of what it is."""
    worst, of = 0.0, ""
    for what, (ours, theirs) in pairs.items():
        if not ours.size:
            continue
        largest = abs(theirs).max()
        size = float(abs(ours - theirs).max() / (largest if largest > 1e-12 else 1.0))
        if not size <= worst:
            worst, of = size, what
    return {"error": worst, "of": of}


# -- Pinocchio --------------------------------------------------------------------------------------------------------

# What urdfdom takes: {element: its attributes}.
_OF_URDF = {
    "robot": {"name"}, "link": {"name"}, "joint": {"name", "type"}, "inertial": set(), "origin": {"xyz", "rpy"},
    "mass": {"value"}, "inertia": {"ixx", "iyy", "izz", "ixy", "ixz", "iyz"}, "parent": {"link"}, "child": {"link"},
    "axis": {"xyz"}, "limit": {"lower", "upper", "effort", "velocity"}, "mimic": {"joint", "multiplier", "offset"},
}  # fmt: skip


def cleaned(data):
    """A URDF without the words that urdfdom does not take, and with those that it asks for; it has a link "world"."""
    import lxml.etree as etree

    parser = etree.XMLParser(recover=True, remove_comments=True, remove_pis=True)
    root = etree.fromstring(data.lstrip(), parser)
    for element in list(root.iter("*")):
        parent, local = element.getparent(), element.tag.rpartition("}")[2]
        if ":" not in local and (parent is None or element.prefix == root.prefix):
            element.tag = local
        is_ours = parent is None or (element.tag in _OF_URDF and (parent.tag != "robot" or element.tag != "inertial"))
        if not is_ours:
            parent.remove(element)
            continue
        for name in set(element.attrib) - _OF_URDF[element.tag]:
            del element.attrib[name]
    root.set("name", root.get("name") or "robot")
    links = [link.get("name") for link in root.iter("link")]
    if "world" not in links and any(parent.get("link") == "world" for parent in root.iter("parent")):
        etree.SubElement(root, "link", name="world")
    for link in root.iter("link"):
        for inertial in link.findall("inertial"):
            if inertial.find("inertia") is None:
                inertial.append(etree.Element("inertia", dict.fromkeys(_OF_URDF["inertia"], "0")))
    for joint in root.iter("joint"):
        # Limits are no part of what is compared, and mimics are taken apart from the outside.
        for part in [*joint.findall("limit"), *joint.findall("mimic")]:
            joint.remove(part)
        joint.append(etree.Element("limit", lower="-1", upper="1", effort="1", velocity="1"))
    return etree.tostring(root).decode()


def _with_pinocchio(file, mech):
    import pinocchio as pin

    data = file.read_bytes()
    model = pin.buildModelFromXML(cleaned(data))
    if mech is None or not mech.nv:
        return {}
    of = dict(zip(mech.joint_names, range(len(mech.joint_names)), strict=True))
    if set(of) != set(model.names[1:]):
        raise ValueError(f"joints: {sorted(set(of) ^ set(model.names))[:4]}")
    held = {name: _Held(mech, i, model.joints[model.getJointId(name)]) for name, i in of.items()}
    G = np.zeros((model.nv, mech.nv))
    for x in held.values():
        G[np.ix_(x.their_v, x.v)] = x.multiplier * np.eye(len(x.v))
    rng, theirs = np.random.default_rng(0), pin.Data(model)
    # Some files have 1e16 for no limit; such angles have no digits left.
    near = mech.replace(**{name: np.clip(getattr(mech, name), -10.0, 10.0) for name in ("lower", "upper")})
    q = np.asarray(js.random_configuration(near, jax.random.key(0), N, np.float64))
    v = rng.standard_normal((N, mech.nv))
    frames = [name for name in mech.frame_names[1:] if model.existFrame(name, pin.FrameType.BODY)]
    ids = [model.getFrameId(name, pin.FrameType.BODY) for name in frames]
    ours = _algorithms(mech, tuple(frames), q, v)
    found = collections.defaultdict(list)
    for k in range(N):
        there = np.empty(model.nq)
        for x in held.values():
            x.put(there, q[k])
        upper = np.triu(pin.crba(model, theirs, there))
        found["mass"].append(G.T @ (upper + np.triu(upper, 1).T) @ G)
        found["bias"].append(G.T @ pin.nonLinearEffects(model, theirs, there, G @ v[k]))
        found["gravity"].append(G.T @ pin.computeGeneralizedGravity(model, theirs, there))
        pin.framesForwardKinematics(model, theirs, there)
        found["positions"].append([theirs.oMf[i].translation.copy() for i in ids])
        found["rotations"].append([theirs.oMf[i].rotation.copy() for i in ids])
    return _worst({what: (ours[what], np.array(x)) for what, x in found.items()})


class _Held:
    """A joint of both."""

    def __init__(self, mech, i, theirs):
        name = mech.joint_names[i]
        self.theirs, self.kind = theirs, mech.topology.kinds[i]
        self.q, self.v = mech.joint_position_indices(name), mech.joint_velocity_indices(name)
        self.multiplier, self.offset = mech.mimics[i]
        swapped = {"free": [3, 4, 5, 0, 1, 2]}.get(self.kind, range(len(self.v)))
        self.their_v = theirs.idx_v + np.array([*swapped])
        if theirs.nv != len(self.v):
            raise ValueError(f"joint {name}: {theirs.shortname()} for {self.kind}")

    def put(self, there, q):
        own, at = q[self.q], slice(self.theirs.idx_q, self.theirs.idx_q + self.theirs.nq)
        if self.kind == "free":
            there[at] = [*own[4:], *np.roll(own[:4], -1)]
        elif self.kind == "planar":
            there[at] = [*own[:2], np.cos(own[2]), np.sin(own[2])]
        else:
            angle = self.multiplier * own + self.offset
            there[at] = np.concatenate([np.cos(angle), np.sin(angle)]) if self.theirs.nq == 2 else angle


def _algorithms(mech, frames, q, v):
    def all_of_them(q, v):
        X = js.forward_kinematics(mech, q, frames)
        return {
            "mass": js.mass_matrix(mech, q),
            "bias": js.bias_forces(mech, q, v),
            "gravity": js.gravity_forces(mech, q),
            "positions": X.translation,
            "rotations": X.rotation.to_matrix(),
        }

    return interpreted(jax.vmap(all_of_them))(q, v)


# -- MuJoCo -----------------------------------------------------------------------------------------------------------


def _with_mujoco(file, mech):
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(file))
    if mech is None or not mech.nv:
        return {}
    # Springs and damping of ropes are left out here, and listed.
    is_rope = [model.wrap_type[i] != int(mujoco.mjtWrap.mjWRAP_JOINT) for i in model.tendon_adr]
    model.tendon_stiffness[is_rope] = model.tendon_damping[is_rope] = 0
    q = js.random_configuration(mech, jax.random.key(0), N, np.float64)
    v = jnp.asarray(np.random.default_rng(0).standard_normal((N, mech.nv)))
    ids = {model.body(i).name or f"body_{i}": i for i in range(1, model.nbody)}
    frames = tuple(ids)
    rubbing = mech.replace(friction_loss=0 * mech.friction_loss)

    def all_of_them(q, v):
        still = states.from_qacc(mech, q, v, jnp.zeros(len(states.to_qvel(mech, q, v))))
        return {
            "qpos": states.to_qpos(mech, q),
            "qvel": states.to_qvel(mech, q, v),
            "T": jax.vmap(lambda v: states.to_qvel(mech, q, v), out_axes=1)(jnp.eye(mech.nv)),
            "still": still,
            "passive": js.passive_forces(rubbing, q, v),
        }

    ours = _algorithms(mech, frames, q, v) | interpreted(jax.vmap(all_of_them))(q, v)
    data, found = mujoco.MjData(model), collections.defaultdict(list)
    for k in range(N):
        T = ours["T"][k]
        data.qpos[:], data.qvel[:] = ours["qpos"][k], 0
        mujoco.mj_forward(model, data)
        found["gravity"].append(T.T @ data.qfrc_bias)
        data.qvel[:] = ours["qvel"][k]
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        for column, unit in zip(M, np.eye(model.nv), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        M = T.T @ M @ T
        found["mass"].append(M)
        found["bias"].append(T.T @ data.qfrc_bias - M @ ours["still"][k])
        found["passive"].append(T.T @ (data.qfrc_spring + data.qfrc_damper + data.qfrc_gravcomp))
        found["positions"].append(data.xpos[1:].copy())
        found["rotations"].append(data.xmat[1:].reshape(-1, 3, 3).copy())
    return _worst({what: (ours[what], np.array(x)) for what, x in found.items()})


# -- report -----------------------------------------------------------------------------------------------------------

HEAD = """# Model files of public packages

Written by `tests/benchmarks/model_files.py`, which says what is compared, and how. Of every source: its files, those
that the peer reads, those that load here, those of which both can be compared, and the largest relative error of these.
Peers are {peers}; of URDF, words that are no part of the format are cut first, and the link "world" is
declared. Where files were only loaded (`--loads`) the peer was not asked.
"""


def report(rows, before):
    peers = ", ".join(
        f"{name} {importlib.metadata.version(package)}"
        for name, package in (("Pinocchio", "pin"), ("MuJoCo", "mujoco"))
        if _is_installed(package)
    )
    yield HEAD.format(peers=peers)
    known = {(row["source"], row["file"]) for row in rows}
    earlier = {key: row for row in before if (key := (row["source"], row["file"])) in known}
    yield "| source | format | files | peer reads | loaded before | load | compared | largest error |\n|" + "---|" * 8
    groups = collections.defaultdict(list)
    for row in rows:
        groups[row["format"], row["source"]].append(row)
        groups[row["format"], "all"].append(row)
    for (of, source), group in sorted(groups.items(), key=lambda x: (x[0][0], x[0][1] == "all", x[0][1])):
        old = [earlier.get((row["source"], row["file"])) for row in group]
        compared, asked = [row["error"] for row in group if "error" in row], [row for row in group if "peer" in row]
        counts = (
            len(group),
            sum(row["peer"] == "loads" for row in asked) if asked else "",
            sum(row["ours"] == "loads" for row in old if row) if all(old) else "",
            sum(row["ours"] == "loads" for row in group),
            len(compared) if asked else "",
            f"{max(compared):.1e}" if compared else "",
        )
        yield f"| {source} | {of} | " + " | ".join(map(str, counts)) + " |"
    for title, which in (("Causes before", list(earlier.values())), ("Causes", rows)):
        if which:
            yield f"\n## {title}\n\nOf files that do not load here: how many, and how many of these the peer reads.\n"
            yield "| format | message | files | of which the peer reads |\n|---|---|---|---|"
            yield from _causes(which)
    if wrong := [row for row in rows if not row.get("error", 0.0) <= ALLOWED]:
        yield "\n## Wrong\n\n| file | error |\n|---|---|"
        yield from (f"| {row['source']}: {row['file']} | {row['error']:.1e}, {row['of']} |" for row in wrong)


def _causes(rows):
    found = collections.defaultdict(list)
    for row in rows:
        if row["ours"] != "loads":
            found[row["format"], _cause(row["ours"])].append(row.get("peer") == "loads")
    for (of, cause), reads in sorted(found.items(), key=lambda x: (x[0][0], -len(x[1]))):
        yield f"| {of} | {cause.replace('|', '/')} | {len(reads)} | {sum(reads)} |"


def _cause(message):
    """The message without names and numbers: what files have in common."""
    message = re.sub(r"^\w+Error: |from_(urdf|mjcf): |line \d+( of [^:]*)?: |in <\w+>: ", "", message)
    message = re.sub(r' name="[^"]*"', "", message)
    return re.sub(r"'[^']*'", "'...'", message)[:110]


if __name__ == "__main__":
    sys.exit(main())
