"""GoPro's telemetry (GPMF) in a film's own track, to a flight."""
