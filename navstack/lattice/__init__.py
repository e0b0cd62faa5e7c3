"""State lattices: primitive files in Nav2's format, and their generation for a turning radius, cells and a motion model."""

from navstack.lattice.generate import generate_lattice, lattice_headings
from navstack.lattice.geometry import Connections, Piece, connect, connection_pieces, sample, scaled
from navstack.lattice.lattice import MOTION_MODELS, Lattice, MotionModel, Primitive
from navstack.lattice.lattice_file import read_lattice, write_lattice

__all__ = [
    "MOTION_MODELS",
    "Connections",
    "Lattice",
    "MotionModel",
    "Piece",
    "Primitive",
    "connect",
    "connection_pieces",
    "generate_lattice",
    "lattice_headings",
    "read_lattice",
    "sample",
    "scaled",
    "write_lattice",
]
