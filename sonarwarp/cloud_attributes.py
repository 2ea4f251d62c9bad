"""Vectors and matrices as a cloud's attributes, one value per point each, and back."""

from __future__ import annotations

import numpy as np

from sonarwarp.cloud import NORMAL, PointCloud

_COVARIANCE = (
    ("covariance_xx", 0, 0),
    ("covariance_yy", 1, 1),
    ("covariance_zz", 2, 2),
    ("covariance_xy", 0, 1),
    ("covariance_xz", 0, 2),
    ("covariance_yz", 1, 2),
)


def normal_attributes(vectors: np.ndarray) -> dict[str, np.ndarray]:
    """Attributes ``cloud.NORMAL`` of unit normals, world, shape [point, 3]."""
    return {name: values.astype(np.float32) for name, values in zip(NORMAL, vectors.T, strict=True)}


def normals_of(cloud: PointCloud) -> np.ndarray:
    """Unit normals of a cloud, world, 0 where not known, shape [point, 3]; the inverse of :func:`normal_attributes`."""
    return np.stack([cloud.attributes[name] for name in NORMAL], axis=1)


def covariance_attributes(matrices: np.ndarray) -> dict[str, np.ndarray]:
    """Attributes ``covariance_xx`` to ``covariance_yz`` of covariances, world [m2], shape [point, 3, 3]."""
    return {name: matrices[:, row, column].astype(np.float32) for name, row, column in _COVARIANCE}


def covariances_of(cloud: PointCloud) -> np.ndarray:
    """Covariances of a cloud, world [m2], shape [point, 3, 3]; the inverse of :func:`covariance_attributes`."""
    matrices = np.empty((len(cloud), 3, 3))
    for name, row, column in _COVARIANCE:
        matrices[:, row, column] = matrices[:, column, row] = cloud.attributes[name]
    return matrices


def deviation_along(covariance: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Standard deviation [m], shape [point], along unit vectors, [point, 3], by covariances [m2], [point, 3, 3]."""
    return np.sqrt(np.einsum("pi,pij,pj->p", direction, covariance, direction))
