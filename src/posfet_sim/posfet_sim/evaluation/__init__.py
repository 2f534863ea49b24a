"""Scores of reconstructed forces, contacts and slips against the ground truth."""
