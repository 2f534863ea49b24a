"""Speed of the stack: `make bench`. One subject a module, each with a function `measure(full) -> Outcome`."""
