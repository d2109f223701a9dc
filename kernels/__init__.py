"""Device code (floor 0 of the house): imports Warp and its siblings only.

Every kernel is written once over the lane type of :mod:`warpdeform.kernels.lanes` and made by a cached factory for a
precision and a lane width, each factory call in a named Warp module of its own.
"""
