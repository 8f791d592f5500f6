"""States and arrays to and from other libraries, one function per convention, named for it.

    from jaxspatial import interop
    F_Bo_B = interop.pinocchio.from_force(data.f[1])

`orders` moves components on arrays; beside it stands one module for each library. A library is imported by the function
that makes one of its objects, and ImportError says that it is missing; reading takes attributes as they are. A
`precision` is a name or None, which takes the default. Where a convention is ours, or an operation does the conversion,
there is no function: notebooks/conventions.md names the operation. `Mechanism.from_urdf` and `Mechanism.from_mjcf` read
model files; they warn with `ModelFileWarning`.
"""

from jaxspatial.interop import brax as brax
from jaxspatial.interop import drake as drake
from jaxspatial.interop import jaxlie as jaxlie
from jaxspatial.interop import mujoco as mujoco
from jaxspatial.interop import newton as newton
from jaxspatial.interop import orders as orders
from jaxspatial.interop import pinocchio as pinocchio
from jaxspatial.interop import ros as ros
from jaxspatial.interop import scipy as scipy
from jaxspatial.mechanism.formats import ModelFileWarning as ModelFileWarning
