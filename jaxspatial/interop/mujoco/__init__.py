"""MuJoCo: arrays of mjData and mjModel, of the C library as of MJX. It has two orders of components.

Inside, rotational part first: cvel, cacc, cdof, cfrc_int, cfrc_ext. All of them are in the world's axes, about the
centre of mass of the whole tree that the body belongs to, point C = `subtree_com[body_rootid[i]]`: move them to the
body's origin by `shift(x, xpos[i] - C)`. At the surface, force first: xfrc_applied, mj_contactForce. Quaternions are
wxyz. Arrays are (*batch, n), so that a field of mjData can be taken whole. Read: MuJoCo's engine_core_smooth.c, mujoco
4.0, mjx 3.17.
"""

from jaxspatial.interop.mujoco.body_arrays import from_cacc as from_cacc, from_cdof as from_cdof, from_cfrc as from_cfrc
from jaxspatial.interop.mujoco.body_arrays import from_contact_force as from_contact_force, from_cvel as from_cvel
from jaxspatial.interop.mujoco.body_arrays import from_object_acceleration as from_object_acceleration
from jaxspatial.interop.mujoco.body_arrays import from_xfrc_applied as from_xfrc_applied, to_cacc as to_cacc
from jaxspatial.interop.mujoco.body_arrays import to_cdof as to_cdof, to_cfrc as to_cfrc
from jaxspatial.interop.mujoco.body_arrays import to_contact_force as to_contact_force, to_cvel as to_cvel
from jaxspatial.interop.mujoco.body_arrays import to_object_acceleration as to_object_acceleration
from jaxspatial.interop.mujoco.body_arrays import to_xfrc_applied as to_xfrc_applied
from jaxspatial.interop.mujoco.frames import from_free_joint_qacc as from_free_joint_qacc
from jaxspatial.interop.mujoco.frames import from_free_joint_qfrc as from_free_joint_qfrc
from jaxspatial.interop.mujoco.frames import from_free_joint_qpos as from_free_joint_qpos
from jaxspatial.interop.mujoco.frames import from_free_joint_qvel as from_free_joint_qvel
from jaxspatial.interop.mujoco.frames import from_xpos_xmat as from_xpos_xmat, from_xpos_xquat as from_xpos_xquat
from jaxspatial.interop.mujoco.frames import to_free_joint_qacc as to_free_joint_qacc
from jaxspatial.interop.mujoco.frames import to_free_joint_qfrc as to_free_joint_qfrc
from jaxspatial.interop.mujoco.frames import to_free_joint_qpos as to_free_joint_qpos
from jaxspatial.interop.mujoco.frames import to_free_joint_qvel as to_free_joint_qvel, to_xpos_xmat as to_xpos_xmat
from jaxspatial.interop.mujoco.frames import to_xpos_xquat as to_xpos_xquat
from jaxspatial.interop.mujoco.inertia import from_body_inertia as from_body_inertia, from_cinert as from_cinert
from jaxspatial.interop.mujoco.inertia import from_full_inertia as from_full_inertia, to_body_inertia as to_body_inertia
from jaxspatial.interop.mujoco.inertia import to_cinert as to_cinert, to_full_inertia as to_full_inertia
from jaxspatial.interop.mujoco.states import from_qacc as from_qacc, from_qfrc as from_qfrc, from_qpos as from_qpos
from jaxspatial.interop.mujoco.states import from_qvel as from_qvel, to_qacc as to_qacc, to_qfrc as to_qfrc
from jaxspatial.interop.mujoco.states import to_qpos as to_qpos, to_qvel as to_qvel
