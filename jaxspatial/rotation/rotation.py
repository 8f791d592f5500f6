"""Rotations, as what they do to vectors. The mathematics is in the modules beside this one."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, lanes, vectors
from jaxspatial.arithmetic.components import as_array
from jaxspatial.arithmetic.double_word import from_double_word
from jaxspatial.arithmetic.kernel import kernel
from jaxspatial.arithmetic.numbers import numeric
from jaxspatial.arithmetic.quantity import Quantity
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.rotation import angles, directions, exponential, quaternion


@tree
class Rotation(Quantity):
    """R_AB: re-expresses in frame A what is expressed in frame B. Made by the constructors below.

    entries: (*batch, 9) the matrix, row by row.

    What the error bounds of all constructors and functions below mean: u is the unit roundoff of the inputs' dtype; an
    error of k u normwise is one of the whole vector, or matrix in its largest singular value, relative to its size. In
    "fast" and "reproducible" bounds are those given (float16 and bfloat16 are computed in float32). In "compensated"
    and "faithful" formulas are evaluated in float64, or for float64 in double words, and every number r of the result
    is rounded once: off by u |r|, and by 16 k u^2 of the size of the whole. That is 1.01 u normwise of a vector, and of
    a matrix in its Frobenius norm; in its largest singular value up to 1.7 u of a rotation. Derivatives of any order
    are those of the function, also where it has a removable singularity.

    Where subnormals are flushed to zero (XLA CPU), components below finfo.tiny (float32 1.2e-38, float64 2.2e-308)
    count as 0, also those given, in all precisions: 8 finfo.tiny are added to errors, to those of `log` and
    `to_quaternion` of the smallest angles, too. A direction given by a vector (`between`, `from_two_vectors`, ...)
    keeps its digits down to a size of finfo.tiny / eps; scale up what is smaller.
    """

    entries: jax.Array

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    def __post_init__(self):
        """Checks what a caller passes; marks of a tree of axes or specs pass."""
        if not check.is_tree_mark(self.entries):
            object.__setattr__(
                self, "entries", owned(check.as_vectors(self.entries, "Rotation: entries", size=9, held=True))
            )

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def identity(cls, batch_shape=(), dtype=None):
        """The rotation that changes nothing, known while tracing: it leaves no operation behind."""
        dtype = check.as_dtype(dtype)
        batch_shape = (batch_shape,) if isinstance(batch_shape, int) else batch_shape
        return cls(np.broadcast_to(np.eye(3, dtype=dtype).ravel(), (*batch_shape, 9)))

    @classmethod
    def from_matrix(cls, m):
        """From matrices (*batch, 3, 3), taken as they are, digit by digit.

        Raises ValueError for numbers that are no rotation: where an entry of m m^T is 1e-3 + 16 eps and more off that
        of the identity, or the determinant is negative. It is there to find a scaled, mirrored or unfinished matrix,
        not drift: `nearest` removes that. NaN passes. *unchecked* while tracing, and in `Rotation(entries)`.
        """
        entries = as_matrices(m, "Rotation.from_matrix: m")
        _require_rotations(entries, "Rotation.from_matrix: m")
        return cls(entries)

    @classmethod
    def nearest(cls, m, *, precision=None):
        """The rotation nearest to matrices (*batch, 3, 3) in the Frobenius norm: what removes the drift of many
        products.

        NaN where the determinant is not positive. Error at most 16 u normwise for matrices near a rotation, times
        2 / (s2 + s3) in general, for singular values s1 = 1 >= s2 >= s3. [Higham 1986]
        """
        return cls(_nearest(precision, as_matrices(m, "Rotation.nearest: m")))

    @classmethod
    def from_quaternion(cls, wxyz, *, precision=None):
        """From quaternions (*batch, 4), real part first, of any length but 0 (NaN). Error at most 6 u normwise."""
        return cls(_from_quaternion(precision, check.as_vectors(wxyz, "Rotation.from_quaternion: wxyz", size=4)))

    @classmethod
    def exp(cls, w, *, precision=None):
        """The rotation about w by |w| radians: what angular velocity w does in unit time.

        w: (*batch, 3), rad. Error at most 8 u normwise for |w| <= pi; beyond, 2 u |w| more, which is 4 pi u for each
        turn. NaN where u |w| is as large as a turn. Right in value and all derivatives at 0 and everywhere else.
        [Rodrigues 1840]
        """
        return cls(_exp(precision, check.as_vectors(w, "Rotation.exp: w")))

    @classmethod
    def about_x(cls, angle, *, precision=None):
        """About the x axis by angles (*batch,), rad; NaN as for `exp`. Errors of sine and cosine at most 2 u for angles
        up to 2048 (float64: 2^26), 2 u |angle| beyond."""
        return cls._about(0, angle, precision)

    @classmethod
    def about_y(cls, angle, *, precision=None):
        """As `about_x`, about the y axis."""
        return cls._about(1, angle, precision)

    @classmethod
    def about_z(cls, angle, *, precision=None):
        """As `about_x`, about the z axis."""
        return cls._about(2, angle, precision)

    @classmethod
    def _about(cls, axis, angle, precision):
        angle = check.as_float_array(angle, f"Rotation.about_{'xyz'[axis]}: angle")
        return cls(_about(precision, expanded(angle), axis=axis))

    @classmethod
    def from_axis_angle(cls, axis, angle, *, precision=None):
        """About axis (*batch, 3), of any length but 0 (NaN), by angle (*batch,), rad. Error at most 12 u normwise."""
        axis = check.as_vectors(axis, "Rotation.from_axis_angle: axis")
        angle = check.as_float_array(angle, "Rotation.from_axis_angle: angle", axis.dtype)
        return cls(_call(_from_axis_angle, precision, axis=axis, angle=expanded(angle)))

    @classmethod
    def from_roll_pitch_yaw(cls, rpy, *, precision=None):
        """Rz(yaw) Ry(pitch) Rx(roll), of (*batch, 3) angles, rad, in that order. Error at most 12 u normwise."""
        return cls(_from_roll_pitch_yaw(precision, check.as_vectors(rpy, "Rotation.from_roll_pitch_yaw: rpy")))

    @classmethod
    def from_one_vector(cls, u, axis=2, *, precision=None):
        """A frame whose axis 0, 1 or 2 points along u (*batch, 3), of any length but 0 (NaN).

        The axis after that one is perpendicular to the coordinate axis along which u is smallest; the frame jumps where
        that changes. Error at most 8 u normwise.
        """
        u = check.as_vectors(u, "Rotation.from_one_vector: u")
        return cls(_from_one_vector(precision, u, axis=_axis(axis, "Rotation.from_one_vector")))

    @classmethod
    def from_two_vectors(cls, u, v, axes=(2, 0), *, precision=None):
        """A frame whose axis axes[0] points along u, with v between that and axis axes[1] (Gram-Schmidt).

        u, v: (*batch, 3), of any length but 0. NaN where they are parallel, or the sine of the angle between them is
        below finfo.tiny; error at most 16 u normwise over the sine
        of the angle between them.
        """
        u = check.as_vectors(u, "Rotation.from_two_vectors: u")
        v = check.as_vectors(v, "Rotation.from_two_vectors: v", u.dtype)
        axes = tuple(_axis(axis, "Rotation.from_two_vectors") for axis in axes)
        if len(axes) != 2 or axes[0] == axes[1]:
            raise ValueError(f"Rotation.from_two_vectors: axes: expected two different axes, got {axes}")
        return cls(_call(_from_two_vectors, precision, {"axes": axes}, u=u, v=v))

    @classmethod
    def between(cls, a, b, *, precision=None):
        """The smallest rotation that takes the direction of a to that of b, (*batch, 3), of any length but 0 (NaN).

        Where they are exactly opposite, or so to finfo.tiny, by pi about an axis perpendicular to both. Error at most
        12 u normwise times 2 / |a/|a| + b/|b||, which is 1 unless they are nearly opposite.
        """
        a = check.as_vectors(a, "Rotation.between: a")
        b = check.as_vectors(b, "Rotation.between: b", a.dtype)
        return cls(_call(_between, precision, a=a, b=b))

    # -- to other forms -----------------------------------------------------------------------------------------------

    def to_matrix(self):
        """(*batch, 3, 3)."""
        return self.entries.reshape((*self.batch_shape, 3, 3))

    def to_quaternion(self, *, precision=None):
        """The unit quaternion (*batch, 4), real part first and not negative. Error at most 6 u normwise."""
        return _to_quaternion(precision, self.entries)

    def log(self, *, precision=None):
        """The rotation vector (*batch, 3), rad, of length at most pi, with exp(log(R)) = R.

        Error at most 8 u normwise, also of a vector of 1e-30, down to the smallest numbers (see `Rotation`); right in
        value and all derivatives at the identity. At angle pi it jumps to its negative, by nature: what comes at
        exactly pi has a positive largest component.
        """
        return _log(precision, self.entries)

    def to_axis_angle(self, *, precision=None):
        """(axis (*batch, 3), angle (*batch,)), 0 <= angle <= pi. At the identity the axis is x, and derivatives are 0.
        Errors at most 10 u normwise."""
        return tuple(_to_axis_angle(precision, self.entries))

    def to_roll_pitch_yaw(self, *, precision=None):
        """(*batch, 3) with R = Rz(yaw) Ry(pitch) Rx(roll), |pitch| <= pi / 2, |roll| and |yaw| <= pi.

        Near |pitch| = pi / 2 roll and yaw have little meaning but together: their errors grow to 16 u / cos(pitch),
        that of the rotation they make stays at 32 u.
        """
        return _to_roll_pitch_yaw(precision, self.entries)

    @property
    def _vectors(self):
        return (self.entries,)

    def _with_vectors(self, vectors):
        return rebuilt(Rotation, ("entries",), vectors)

    @property
    def batch_shape(self):
        return self.entries.shape[:-1]

    @property
    def dtype(self):
        return np.dtype(self.entries.dtype)

    def __repr__(self):
        return f"Rotation({shown(self.entries, 3)})"

    # -- operations ---------------------------------------------------------------------------------------------------

    def inverse(self):
        """R_BA of R_AB: the transpose. Known while tracing where R_AB is."""
        is_known = isinstance(self.entries, np.ndarray)
        return Rotation(self.entries[..., _TRANSPOSED] if is_known else _transposed(None, self.entries))

    def __matmul__(self, other):
        """R_AB @ v_B is v_A, (*batch, 3), and R_AB @ R_BC is R_AC; see `rotated` and `composed` for bounds."""
        if isinstance(other, Rotation):
            return composed(self, other)
        return NotImplemented if hasattr(other, "__rmatmul__") and not hasattr(other, "shape") else rotated(self, other)

    def interpolate(self, other, t, *, precision=None):
        """R exp(t log(R^-1 R2)): at constant angular velocity from this rotation, t = 0, to the other, t = 1 (slerp).

        t: (*batch,), any number. The shorter way; at half a turn see `log`. Error at most (32 + 16 |t|) u normwise.
        """
        t = check.as_float_array(t, "Rotation.interpolate: t", self.dtype)
        return Rotation(_call(_interpolated, precision, start=self.entries, end=other.entries, t=expanded(t)))

    @staticmethod
    def left_jacobian(w, *, precision=None):
        """J (*batch, 3, 3) with exp(w + e) = exp(J e) exp(w) for small e. Error at most 8 u normwise for |w| <= pi.

        w: (*batch, 3), rad. The right Jacobian is that of -w, its transpose. [Barfoot 2017, 7.1.3]
        """
        return matrices(_left_jacobian(precision, check.as_vectors(w, "Rotation.left_jacobian: w")), 3)

    @staticmethod
    def left_jacobian_inverse(w, *, precision=None):
        """J^-1 (*batch, 3, 3) of `left_jacobian`, infinite at |w| = 2 pi. Error at most 16 u normwise for |w| <= pi."""
        return matrices(_left_jacobian_inverse(precision, check.as_vectors(w, "Rotation.left_jacobian_inverse: w")), 3)


def rotated(R_AB, v_B, *, precision=None):
    """v_A = R_AB v_B, (*batch, 3): the same vector, expressed in frame A.

    Error per component, mag the sum of the absolute values of its three products: at most 3 u mag in "fast" and
    "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp in "faithful", while nothing over- or underflows; plus a
    few finfo.tiny where subnormals are flushed. 15 flops.
    Raises TypeError for dtypes that differ, ValueError for shapes.
    """
    v_B = check.as_vectors(v_B, "Rotation @ v: v", R_AB.dtype, held=is_identity(R_AB))
    check.require_same_dtype(Rotation=R_AB, v=v_B)
    return rotated_together(R_AB, v_B, precision=precision)[0]


def rotated_together(R_AB, *vectors, precision=None):
    """`rotated` for several vectors of the dtype of R, in one operation: what a derivative collects from all of them is
    one sum."""
    for v in vectors:
        check.common_batch_shape(Rotation=R_AB.batch_shape, v=v.shape[:-1])
    return vectors if is_identity(R_AB) else _rotated(precision, R_AB.entries, *vectors)


def is_identity(R_AB):
    """True for a single identity known while tracing."""
    known = isinstance(R_AB.entries, np.ndarray) and not R_AB.batch_shape
    return known and (R_AB.entries == np.eye(3).ravel()).all()


def composed(R_AB, R_BC, *, precision=None):
    """R_AC = R_AB R_BC. Error per entry as of a component of `rotated`. 45 flops."""
    check.require_same_dtype(left=R_AB, right=R_BC)
    check.common_batch_shape(left=R_AB.batch_shape, right=R_BC.batch_shape)
    if is_identity(R_AB) or is_identity(R_BC):
        return R_BC if is_identity(R_AB) else R_AB
    return Rotation(_composed(precision, R_AB.entries, R_BC.entries))


@kernel
def _rotated(precision, entries, *vectors):
    rows = matrix_rows(entries)
    return tuple(lanes.stack_like(v, [lanes.dot(precision, row, lanes.unstack(v)) for row in rows]) for v in vectors)


_TRANSPOSED = np.arange(9).reshape(3, 3).T.ravel()


@kernel
def _transposed(_, entries):
    return lanes.stack(vectors.flat(vectors.transpose(matrix_rows(entries))), lanes.batch_shape(entries))


@kernel
def _composed(precision, left, right):
    columns = list(zip(*matrix_rows(right), strict=True))
    return lanes.stack_like(left, [lanes.dot(precision, row, c) for row in matrix_rows(left) for c in columns])


def matrix_rows(entries):
    """The rows of a matrix given by its entries, of lanes."""
    return vectors.rows(lanes.unstack(entries))


# -- in numbers -------------------------------------------------------------------------------------------------------


@numeric
def _nearest(entries):
    return vectors.flat(directions.nearest(vectors.rows(entries)))


@numeric
def _from_quaternion(q):
    return vectors.flat(quaternion.to_matrix(vectors.unit(q)))


@numeric
def _to_quaternion(entries):
    return quaternion.from_matrix(vectors.rows(entries))


@numeric
def _exp(w):
    return vectors.flat(exponential.rotation(w))


@numeric
def _log(entries):
    return exponential.rotation_vector(vectors.rows(entries))


@numeric
def _about(angle, axis):
    return vectors.flat(angles.about(axis, *angle))


@numeric
def _from_axis_angle(axis, angle):
    return vectors.flat(quaternion.to_matrix(angles.about_axis(axis, *angle)))


@numeric
def _to_axis_angle(entries):
    return list(angles.axis_angle(quaternion.from_matrix(vectors.rows(entries))))


@numeric
def _from_roll_pitch_yaw(rpy):
    return vectors.flat(quaternion.to_matrix(angles.from_roll_pitch_yaw(*rpy)))


@numeric
def _to_roll_pitch_yaw(entries):
    return angles.roll_pitch_yaw(quaternion.from_matrix(vectors.rows(entries)))


@numeric
def _from_one_vector(u, axis):
    return vectors.flat(directions.from_one_vector(u, axis))


@numeric
def _from_two_vectors(u, v, axes):
    return vectors.flat(directions.from_two_vectors(u, v, axes))


@numeric
def _between(a, b):
    return vectors.flat(quaternion.to_matrix(directions.between(a, b)))


@numeric
def _interpolated(start, end, t):
    start, end = vectors.rows(start), vectors.rows(end)
    w = exponential.rotation_vector(vectors.product(vectors.transpose(start), end))
    return vectors.flat(vectors.product(start, exponential.rotation(vectors.times(*t, w))))


@numeric
def _left_jacobian(w):
    return vectors.flat(exponential.left_jacobian(w))


@numeric
def _left_jacobian_inverse(w):
    return vectors.flat(exponential.left_jacobian_inverse(w))


# -- what comes in ----------------------------------------------------------------------------------------------------


def _call(formula, precision, static=None, **arrays):
    """The formula over arrays of one dtype, with batches that broadcast; messages use their names."""
    check.require_same_dtype(**arrays)
    check.common_batch_shape(**{name: a.shape[:-1] for name, a in arrays.items()})
    return formula(precision, *arrays.values(), **(static or {}))


def as_matrices(m, name, n=3):
    """Matrices (*batch, n, n) by their entries (*batch, n n)."""
    m = check.as_vectors(m, name, size=n, many=[str(n)], held=True)
    if m.shape[-2] != n:
        raise ValueError(f"{name}: expected shape (*batch, {n}, {n}), got {m.shape}")
    return m.reshape((*m.shape[:-2], n * n))


def _require_rotations(entries, name):
    """Of what is known now; nothing is asked of what is traced."""
    leaves = jax.tree.leaves(entries)
    if not leaves or any(isinstance(x, (jax.core.Tracer, jax.ShapeDtypeStruct)) for x in leaves):
        return
    tolerance = 1e-3 + 16 * float(jnp.finfo(entries.dtype).eps)
    m = np.asarray(from_double_word(as_array(entries, entries.shape[:-1]))).astype(np.float64).reshape((-1, 3, 3))
    with np.errstate(all="ignore"):
        off = abs(m @ np.swapaxes(m, -1, -2) - np.eye(3)).max((-1, -2), initial=0.0)
        wrong = np.flatnonzero((off > tolerance) | (np.linalg.det(m) < 0))
    if wrong.size:
        i = wrong[0]
        which = f"at place {i} of {len(m)} " if len(m) > 1 else ""
        how = f"with an entry of m m^T {off[i]:.3g} off" if off[i] > tolerance else "with a negative determinant"
        raise ValueError(
            f"{name}: expected rotation matrices, got {which}{m[i].tolist()}, {how}; Rotation.nearest(m) is the "
            "nearest rotation, Rotation(m.reshape((*m.shape[:-2], 9))) takes numbers as they are"
        )


def owned(array):
    """A NumPy array as a read-only copy: the caller may write to his own."""
    if isinstance(array, np.ndarray):
        array = array.copy()
        array.setflags(write=False)
    return array


def shown(x, n):
    """The numbers of one item, n in a row; the shape of a batch or of something not computed yet."""
    if isinstance(x, (np.ndarray, jax.Array)) and not isinstance(x, jax.core.Tracer) and x.ndim == 1:
        numbers = [str(number) for number in np.asarray(x)]
        rows = [", ".join(numbers[i : i + n]) for i in range(0, len(numbers), n)]
        return "[" + "; ".join(rows) + "]"
    if hasattr(x, "shape") and hasattr(x, "dtype") and not isinstance(x, check.Number):
        return f"{np.dtype(x.dtype).name}[{','.join(map(str, x.shape))}]"
    return repr(x)


def expanded(x):
    """(*batch,) as (*batch, 1)."""
    return x.reshape((*x.shape, 1))


def matrices(entries, n):
    return entries.reshape((*entries.shape[:-1], n, n))


def _axis(axis, name):
    if axis not in (0, 1, 2):
        raise ValueError(f"{name}: expected axis 0, 1 or 2, got {axis!r}")
    return int(axis)
