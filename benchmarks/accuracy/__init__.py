"""Accuracy of forces, contacts and slip against the ground truth."""
