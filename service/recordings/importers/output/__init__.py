"""An imported flight to a recording on disk: its telemetry as MAVLink, its frames, its config."""
