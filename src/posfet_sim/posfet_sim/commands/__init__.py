"""The commands `posfet sim`, `posfet score` and `posfet calibrate`."""
