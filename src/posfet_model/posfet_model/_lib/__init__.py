"""Private numerics: argument checks, reductions of small arrays, first-order systems. Imports no other room."""
