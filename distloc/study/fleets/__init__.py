"""`study fleets`: two to five drones report one fire or two; is what is fused honest, and better than the best?"""
