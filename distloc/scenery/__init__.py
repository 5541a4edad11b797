"""The scenery as a compass: corners followed through the frames tell what the reported attitude is wrong by."""
