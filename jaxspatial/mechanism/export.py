"""How mechanisms are written into exported programs: their trees as JSON, beside the arrays."""

import dataclasses
import json
from collections.abc import Sequence
from typing import Any, cast

import jax
import jax.export
import numpy as np

from jaxspatial.mechanism.joint_numbers import registered_parameters
from jaxspatial.mechanism.mechanism import Mechanism, StaticMechanism
from jaxspatial.mechanism.topology import Topology


def _to_bytes(structure: tuple[Topology]):
    return json.dumps(dataclasses.astuple(structure[0])).encode()


def _from_bytes(data: bytes):
    return (Topology(*map(_as_tuples, json.loads(data))),)


def _as_tuples(x: Any) -> Any:
    return tuple(map(_as_tuples, cast(list[Any], x))) if isinstance(x, list) else x


def _static_to_bytes(static: StaticMechanism):
    topology, arrays = static.contents
    written = [(name, shape, data.hex()) for name, shape, data in arrays]
    return json.dumps([dataclasses.astuple(topology), written]).encode()


def _static_from_bytes(data: bytes):
    topology, arrays = json.loads(data)
    leaves = [np.frombuffer(bytes.fromhex(x), np.dtype(name)).reshape(shape) for name, shape, x in arrays]
    topology = Topology(*map(_as_tuples, topology))
    parameters = {p.name: 0 for p in registered_parameters(topology.kinds)}
    like = dataclasses.replace(Mechanism.build([], []), topology=topology, parameters=parameters)
    return jax.tree.unflatten(cast(Any, jax.tree.structure(like)), leaves).as_static()


def _static_from_children(aux_data: Any, children: Sequence[Any]) -> Any:
    return aux_data


jax.export.register_pytree_node_serialization(
    Mechanism, serialized_name="jaxspatial.Mechanism", serialize_auxdata=_to_bytes, deserialize_auxdata=_from_bytes
)
jax.export.register_pytree_node_serialization(
    StaticMechanism,
    serialized_name="jaxspatial.StaticMechanism",
    serialize_auxdata=_static_to_bytes,
    deserialize_auxdata=_static_from_bytes,
    from_children=_static_from_children,
)
