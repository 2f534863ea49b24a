"""Baseline implementation for the same board, written as in a tutorial, to be compared with the stack.

slcan and Notifier of python-can, cantools for every frame, messages filled from lists, one process per node with a
SingleThreadedExecutor, scipy.ndimage for the contacts. It does less than the stack: no loss statistics, no
calibration, no baseline tracking, no contact tracks, no variance.
"""
