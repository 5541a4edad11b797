"""Foreign logs, films and stills to a recording that the replay, the calibration and the studies read."""
