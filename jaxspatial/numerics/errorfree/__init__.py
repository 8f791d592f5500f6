"""Single operations: rounded on their own, with their exact error, and out of the compiler's reach."""
