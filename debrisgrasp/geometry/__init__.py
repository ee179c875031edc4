"""Layer 1: space, cameras and clouds; knows nothing about robots."""

from .camera import Intrinsics
from .cloud import Bounds, PointCloud
from .cloud_normals import neighborhood_normals
from .content import SolidContent
from .field import MAX_CELLS, MAX_REACH, DistanceField, Space
from .hulls import hull_of, hull_volume
from .image_normals import depth_facets, depth_normals
from .lattice import lattice
from .neighbors import by_place, voxel_cells, voxel_count, voxel_downsample
from .sampling import fibonacci_sphere, perturbed, random_rotations
from .se3 import SE3
from .sight import DepthSight, LineOfSight, PanoramicSight, sight_points
from .solids import Box, Capsule, Cylinder, Solid, Sphere

__all__ = [
    "MAX_CELLS",
    "MAX_REACH",
    "SE3",
    "Bounds",
    "Box",
    "Capsule",
    "Cylinder",
    "DepthSight",
    "DistanceField",
    "Intrinsics",
    "LineOfSight",
    "PanoramicSight",
    "PointCloud",
    "Solid",
    "SolidContent",
    "Space",
    "Sphere",
    "by_place",
    "depth_facets",
    "depth_normals",
    "fibonacci_sphere",
    "hull_of",
    "hull_volume",
    "lattice",
    "neighborhood_normals",
    "perturbed",
    "random_rotations",
    "sight_points",
    "voxel_cells",
    "voxel_count",
    "voxel_downsample",
]
