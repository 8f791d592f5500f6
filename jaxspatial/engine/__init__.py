"""Makes a program of a formula over a mechanism.

From a call of `forward_dynamics(mechanism, q, v, tau)` to its result:

1. `algorithm` checks the arguments, and finds or makes the program of its formula for the constants among them.
2. `program` is one primitive of JAX, with its rules for `vmap`, `jvp` and transposition. `derivatives` has the programs
   of tangents and pull-backs. On CPUs a program becomes machine code: `graph` makes a graph of single numbers of its
   trace for one state, `llvm_ir` writes that for several states side by side (`registers` puts it into an order that
   needs few registers), and `cpu` compiles and calls it. On NVIDIA GPUs `cuda` does; `machine` says what both give.
   Elsewhere XLA compiles the trace, as `xla` prepares it. A function that calls several algorithms, such as a step in
   time, becomes one program by `composite`.
3. `state` gives the formula the numbers of the mechanism at its coordinates, bundle by bundle, and rounds results once,
   in the order of bodies, generalized velocities or coordinates. `alignment` gives joints common axes.
4. `recursion` goes outward and inward over the tree, one loop for each bundle of chains. `matrices` assembles matrices
   over pairs of joints. `stacking` has operations on numbers that are arrays over bodies and states.

`sums` has nothing to do with mechanisms: sums of products of many items, in twice the digits, become machine code too.

The mechanics is in the layer above, `dynamics`.
"""

from jaxspatial.engine import sums as sums
