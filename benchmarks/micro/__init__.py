"""Run times of single steps within one process."""
