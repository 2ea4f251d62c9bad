"""A few frames of a small imaging sonar over a field, for tests of particles and of what they say."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import warp as wp

from sonarwarp_kernels import estimate, particles
from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_kernels.specs import Fan, Grid, Mixture
from tests.reference.geometry import quaternion, sonar_rotation

MIXTURE = {
    "weight_hit": 0.90,
    "weight_short": 0.02,
    "weight_random": 0.05,
    "weight_seabed": 0.03,
    "deviation": 0.01,
    "rate_short": 1.0,
    "rate_seabed": 5.0,
}
UNDETECTED = float(NO_DETECTION)
OUTPUTS = ("range_out", "elevation_out", "weight_out")


def struct(kind: Any, **values: Any) -> Any:
    """A Warp struct with these fields."""
    made = kind()
    for name, value in values.items():
        setattr(made, name, value)
    return made


def random_attitude(rng: np.random.Generator) -> np.ndarray:
    """Tilted down, rolled and turned anyhow."""
    return sonar_rotation(rng.uniform(-0.3, 0.3), rng.uniform(0.2, 0.8), rng.uniform(-3, 3))


@dataclass(frozen=True)
class ArcWorld:
    """Frames of a sonar, each with a pose, critical ranges and a field of its trajectory; float32 where kernels are."""

    orientation: np.ndarray  # [frame, 3, 3]
    position: np.ndarray  # [frame, 3]
    critical: np.ndarray  # [frame, beam], NO_DETECTION for none
    seabed: np.ndarray  # [frame, beam]
    key: np.ndarray  # [frame]
    trajectory: np.ndarray  # [frame]
    counts: np.ndarray  # [trajectory, x, y, z]
    origin: np.ndarray  # [trajectory, 3]
    cell: float = 0.1
    azimuth: np.ndarray = field(default_factory=lambda: np.float32([-0.25, -0.1, 0.0, 0.2]))
    range_edge: np.ndarray = field(default_factory=lambda: np.linspace(0.5, 5.5, 101, dtype=np.float32))
    half_elevation: float = 0.12
    cone: int = 0
    mixture: dict = field(default_factory=lambda: MIXTURE)
    low: float = -4.0
    high: float = 6.0
    informed: float = 0.5

    @classmethod
    def random(cls, seed: int = 50, frames: int = 3, trajectories: int = 2, **changed: Any) -> "ArcWorld":
        """Fields of noise that the arcs pass through."""
        rng = np.random.default_rng(seed)
        position = rng.uniform([-1, -1, 3], [1, 1, 4], (frames, 3)).astype(np.float32)
        critical = rng.uniform(2.0, 4.0, (frames, 4)).astype(np.float32)
        made = cls(
            orientation=np.array([random_attitude(rng) for _ in range(frames)]),
            position=position,
            critical=critical,
            seabed=(critical + rng.uniform(-0.2, 1.5, critical.shape)).astype(np.float32),
            key=rng.integers(0, 2**63, frames, dtype=np.uint64) * np.uint64(2),
            trajectory=(np.arange(frames) % trajectories).astype(np.int32),
            counts=rng.integers(-8 * 65536, 8 * 65536, (trajectories, 60, 60, 30)).astype(np.int32),
            origin=np.tile(np.float32([-3, -3, 0.2]), (trajectories, 1)) + np.arange(trajectories)[:, None] * 0.03,
        )
        return replace(made, **changed)

    def empty(self) -> "ArcWorld":
        """The same over fields that know nothing."""
        return replace(self, counts=np.zeros_like(self.counts))

    @property
    def frames(self) -> int:
        return len(self.position)

    @property
    def beams(self) -> int:
        return len(self.azimuth)

    def world_points(self, frame: int, direction: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """World positions of points of a frame, given directions in the sonar's frame."""
        return self.position[frame] + np.asarray(distance)[..., None] * (direction @ self.orientation[frame].T)

    def poses(self) -> np.ndarray:
        return np.array([[*p, *quaternion(o)] for p, o in zip(self.position, self.orientation, strict=True)])

    def inputs(self, device: str, slots: Any) -> dict[str, Any]:
        """Arguments that all of the particles' launchers begin with."""
        fan = struct(
            Fan,
            azimuth=wp.array(self.azimuth, dtype=float, device=device),
            range_edge=wp.array(self.range_edge, dtype=float, device=device),
            elevation_min=-self.half_elevation,
            elevation_max=self.half_elevation,
            cone=self.cone,
        )
        nx, ny, nz = self.counts.shape[1:]
        origin = wp.array(self.origin, dtype=wp.vec3, device=device)
        size = wp.array([[nx, ny, nz]] * len(self.origin), dtype=wp.vec3i, device=device)
        contacts = struct(
            particles.Contacts,
            trajectory=wp.array(self.trajectory, dtype=int, device=device),
            key=wp.array(self.key, dtype=wp.uint64, device=device),
            world_from_sensor=wp.array(self.poses(), dtype=wp.transform, device=device),
            seabed_range=wp.array(self.seabed, dtype=float, device=device),
            critical_range=wp.array(self.critical, dtype=float, device=device),
        )
        return {
            "fan": fan,
            "grid": struct(Grid, origin=origin, size=size, cell=self.cell, nx=nx, ny=ny, nz=nz),
            "mixture": struct(Mixture, **self.mixture),
            "reading": struct(particles.Reading, low=self.low, high=self.high, informed=self.informed),
            "contacts": contacts,
            "slot_frame": wp.array(np.asarray(slots), dtype=int, device=device),
            "log_odds": wp.array(self.counts, dtype=int, device=device),
        }

    def sample(self, device: str, slots: Any = None, number: int = 64, threads: int = 1) -> Any:
        """Ranges, elevations and weights, shape [slot, beam, particle], -7 where untouched."""
        slots = range(self.frames) if slots is None else slots
        shape = (len(slots), self.beams, number)
        out = {name: wp.full(shape, -7.0, dtype=float, device=device) for name in OUTPUTS}
        particles.sample_particles(**self.inputs(device, list(slots)), **out, device=device, threads=threads)
        return tuple(array.numpy() for array in out.values())

    def estimate(self, device: str, slots: Any = None, number: int = 64, threads: int = 1) -> dict[str, np.ndarray]:
        """All estimates by name, shape [frame, beam, ...], 7 where untouched."""
        slots = range(self.frames) if slots is None else slots
        shape = (self.frames, self.beams)
        made = {name: wp.full(shape, 7, dtype=dtype, device=device) for name, dtype in estimate.ESTIMATE_TYPES.items()}
        out = struct(estimate.Estimates, **made)
        inputs = self.inputs(device, list(slots))
        estimate.estimate_points(**inputs, particles=number, estimates_out=out, device=device, threads=threads)
        return {name: array.numpy() for name, array in made.items()}
