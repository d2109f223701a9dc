"""Where methods are stable: integrator, stiffness, time step, density and how disordered the start is."""
