"""Times of single steps within one process."""
