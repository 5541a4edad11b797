"""The paper's Table 1 beside ours, its strip of frames and what a silhouette's centre costs; `distloc study table1` calls it."""
