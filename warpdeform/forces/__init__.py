"""Energies and loads (floor 2 of the house): one file per term, each the trio energy, gradient, Hessian."""
