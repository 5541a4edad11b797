"""Stages, frame to report, and a whole service under load; the bench calls it."""
