"""Parameter models that belong to no plugin: move_base, the costmaps, the simulator."""
