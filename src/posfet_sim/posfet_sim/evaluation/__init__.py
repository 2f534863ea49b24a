"""Scores of reconstructed forces, contacts and slip against the ground truth."""
