"""`study alerts`: how soon after ignition smoke is told of, against false alarms."""
