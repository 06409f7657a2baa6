"""ClimRT: a siamese tracker that imagines the frame between two frames. Knows nothing of drones."""
