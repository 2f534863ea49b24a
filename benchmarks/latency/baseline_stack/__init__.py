"""The same board read the ordinary way, to be measured beside the stack: what a tutorial would have you write.

python-can's own slcan and its Notifier, cantools for every frame, messages filled from lists, one process a node on a
SingleThreadedExecutor, scipy.ndimage for the contacts. It does less than the stack: no losses told apart, no
calibration, no zeros followed, no ids of contacts, no variance.
"""
