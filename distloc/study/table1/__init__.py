"""The paper's Table 1 and ours, its strip of frames, what a silhouette's centre costs; `study table1` calls it."""
