"""Parameter models of components that are not plugins: move_base, the costmaps, the simulator."""
