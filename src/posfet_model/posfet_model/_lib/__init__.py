"""Private helpers: argument validation, array types, units, fast reductions, first-order systems. No other imports."""
