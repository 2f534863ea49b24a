"""The whole POSFET stack: what is started together, and what a person sees of it."""
