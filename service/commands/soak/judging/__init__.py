"""What a soak measures, draws and concludes; the soak calls it."""
