"""`study fleets`: two to five drones report one fire or two; is what is fused of it honest, and better than the best?"""
