"""Layer 6: states and arrays to and from other libraries, one function per convention, named for it.

    from jaxspatial import interop
    F_Bo_B = interop.pinocchio.from_force(data.f[1])

`orders` moves components on arrays; beside it stands one module for each library. None of the libraries is imported
until a function has to make one of its objects: reading takes attributes as they are. Model files are read by
`Mechanism.from_urdf` and `Mechanism.from_mjcf`; `ModelFileWarning` is what they have to tell.
"""

from jaxspatial.interop import brax as brax
from jaxspatial.interop import drake as drake
from jaxspatial.interop import jaxlie as jaxlie
from jaxspatial.interop import mujoco as mujoco
from jaxspatial.interop import orders as orders
from jaxspatial.interop import pinocchio as pinocchio
from jaxspatial.interop import scipy as scipy
from jaxspatial.mechanism.formats import ModelFileWarning as ModelFileWarning
