"""What the command can be told by name. What is measured is named without importing it, which would take JAX."""

PARTS = {"tau": "torque", "f": "force", "w": "angular velocity", "v": "velocity"}
OPERATIONS = "shift_force", "shift_velocity", "shift_acceleration", "cross_motion", "cross_force", "dot"
ALGORITHMS = "inverse_dynamics", "forward_dynamics"
DTYPES = "float16", "bfloat16", "float32", "float64"
PRECISIONS = "fast", "reproducible", "compensated", "faithful"
# Numbers of wrenches to stream: the least, and how many unless told otherwise.
SMALLEST, LARGEST = 1_000, 1_000_000
