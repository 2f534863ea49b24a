"""The command `posfet`: bring-up of the whole POSFET stack, and its live display."""
