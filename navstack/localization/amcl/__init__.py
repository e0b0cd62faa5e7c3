"""Monte Carlo localization: amcl."""

from navstack.localization.amcl.amcl import Amcl
from navstack.localization.amcl.particles import Clusters, ParticleSet
from navstack.localization.amcl.sensor_model import Readings, SensorModel

__all__ = ["Amcl", "Clusters", "ParticleSet", "Readings", "SensorModel"]
