"""Search over poses (x, y, heading) for robots with a shape and a turning radius, shared by smac_hybrid and smac_lattice."""
