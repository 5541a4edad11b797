"""Films in MPEG-TS with MISB ST 0601 metadata, to a flight."""
