"""What accuracy costs: every setting of a scene's solver, its error against a reference and its time (design 6)."""
