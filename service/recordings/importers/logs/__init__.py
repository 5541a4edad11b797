"""Readers of flight logs: tables of poses, ArduPilot's, PX4's, and telemetry logs."""
