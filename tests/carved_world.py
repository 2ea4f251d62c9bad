"""A small imaging sonar and the cells that it looks at, for tests of what is empty and where contacts lie."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import warp as wp

from sonarwarp_kernels import arcs, estimate, free_depth, proof
from tests.arc_world import UNDETECTED, ArcWorld, struct
from tests.reference.geometry import rotation, sonar_rotation

ASKED = float(free_depth.ASKED)
UNASKED = float(free_depth.UNASKED)

UNEVEN = np.float32([-0.5, -0.42, -0.3, 0.1, 0.15, 0.4])
"""Beams' centres with wide and narrow gaps."""

DOUBT = {
    "proven": -0.2,
    "solid": 1.0,
    "deviation": 0.1,
    "odds_power": 0.7,
    "range_deviation": 0.3,
    "least_height": 0.1,
    "sharpness": 1.0,
    "registration": 0.0,
}

ATTITUDES = {
    "level": np.eye(3),
    "tilted": rotation("y", 0.7),
    "rolled": rotation("x", 1.2),
    "upside down": rotation("x", np.pi),
    "straight down": rotation("y", np.pi / 2),
    "upwards": sonar_rotation(-0.4, -0.8, 2.0),
}


@dataclass(frozen=True)
class CarvedWorld(ArcWorld):
    """An :class:`ArcWorld` whose beams have borders and whose trajectories have boxes of their own sizes."""

    size: np.ndarray = field(default_factory=lambda: np.int32([[20, 24, 16], [26, 16, 20]]))  # [trajectory, 3]
    border: np.ndarray | None = None  # [beam + 1]; half-way between the beams where none are given
    reach: float = 1.0
    guard: float = 0.05
    margin: float = 0.03
    doubt: dict = field(default_factory=lambda: DOUBT)
    certain: float = 0.1  # most standard deviation of an informed elevation [rad]

    @classmethod
    def around(cls, attitude: np.ndarray, seed: int = 70, frames: int = 12, **changed: Any) -> "CarvedWorld":
        """Frames of two trajectories, some tenths of a radian and of a metre off one attitude and place."""
        rng = np.random.default_rng(seed)
        azimuth = changed.get("azimuth", UNEVEN)
        size = np.int32([[20, 24, 16], [26, 16, 20]])
        position = rng.uniform(-0.3, 0.3, (frames, 3)).astype(np.float32)
        turn = [sonar_rotation(*rng.uniform(-0.25, 0.25, 3)) for _ in range(frames)]
        critical = rng.uniform(1.5, 3.5, (frames, len(azimuth))).astype(np.float32)
        critical[rng.random(critical.shape) < 0.25] = UNDETECTED
        seabed = rng.uniform(1.5, 5.0, critical.shape).astype(np.float32)
        seabed[rng.random(critical.shape) < 0.1] = np.inf
        middle = attitude @ [2.5, 0.0, 0.0]
        made = cls(
            orientation=attitude @ np.array(turn),
            position=position,
            critical=critical,
            seabed=seabed,
            key=np.zeros(frames, dtype=np.uint64),
            trajectory=(np.arange(frames) % 2).astype(np.int32),
            counts=np.zeros((2, *size.max(axis=0)), dtype=np.int32),
            origin=(middle - 0.5 * 0.12 * size + [[0.1, 0, 0.2], [0, 0.05, -0.1]]).astype(np.float32),
            cell=0.12,
            azimuth=azimuth,
            range_edge=np.linspace(0.5, 4.0, 71, dtype=np.float32),
            half_elevation=0.3,
            size=size,
        )
        return replace(made, **changed)

    @property
    def borders(self) -> np.ndarray:
        if self.border is not None:
            return self.border
        azimuth = self.azimuth.astype(np.float64)
        inner = 0.5 * (azimuth[1:] + azimuth[:-1])
        outer = 2 * azimuth[[0, -1]] - inner[[0, -1]]
        return np.array([outer[0], *inner, outer[1]], dtype=np.float32)

    def selected(self, frames: Any) -> "CarvedWorld":
        """The same with some of the frames only, in this order."""
        names = ("orientation", "position", "critical", "seabed", "key", "trajectory")
        return replace(self, **{name: getattr(self, name)[frames] for name in names})

    def inside(self) -> np.ndarray:
        """Cells that lie in their trajectory's own box, shape [trajectory, x, y, z]."""
        index = np.indices(self.counts.shape[1:])
        return np.all(index[None] < self.size[:, :, None, None, None], axis=1)

    def inputs(self, device: str, slots: Any = ()) -> dict[str, Any]:
        made = super().inputs(device, list(slots))
        made["fan"].column_azimuth = wp.array(self.borders, dtype=float, device=device)
        made["grid"].size = wp.array(self.size, dtype=wp.vec3i, device=device)
        return made

    def carving(self) -> proof.Carving:
        return struct(proof.Carving, reach=self.reach, guard=self.guard, margin=self.margin)

    def model(self) -> arcs.ArcModel:
        return struct(arcs.ArcModel, reach=self.reach, informed=self.certain, **self.doubt)

    def rows(self, device: str, order: Any = None) -> dict[str, wp.array]:
        """Frames by trajectory, each trajectory's in the order that ``order`` puts all frames in."""
        order = np.arange(self.frames) if order is None else np.asarray(order)
        owner = self.trajectory[order]
        first = np.searchsorted(np.sort(owner), np.arange(len(self.origin) + 1))
        by_trajectory = order[np.argsort(owner, kind="stable")]
        return {
            "order": wp.array(by_trajectory, dtype=int, device=device),
            "first_frame": wp.array(first, dtype=int, device=device),
        }

    def ask(self, device: str, hypotheses: int = 16, content: float = UNASKED, threads: int = 1) -> np.ndarray:
        """Cells after the arcs were asked for, shape [trajectory, x, y, z]."""
        inputs = self.inputs(device)
        cells = wp.full(self.counts.shape, content, dtype=float, device=device)
        on = {"device": device, "threads": threads}
        free_depth.ask_arcs(inputs["grid"], inputs["fan"], inputs["contacts"], hypotheses, cells, **on)
        return cells.numpy()

    def measure(self, device: str, cells: np.ndarray, order: Any = None, threads: int = 1) -> np.ndarray:
        """``cells`` after those asked for were measured."""
        inputs = self.inputs(device)
        out = wp.array(cells, dtype=float, device=device)
        free_depth.measure_free_depth(
            inputs["grid"],
            inputs["fan"],
            self.carving(),
            inputs["contacts"],
            **self.rows(device, order),
            free_depth_out=out,
            device=device,
            threads=threads,
        )
        return out.numpy()

    def estimate_arcs(
        self, device: str, cells: np.ndarray, hypotheses: int = 64, threads: int = 1
    ) -> dict[str, np.ndarray]:
        """All estimates by name, given free depths, shape [frame, beam, ...], 7 where untouched."""
        shape = (self.frames, self.beams)
        made = {name: wp.full(shape, 7, dtype=dtype, device=device) for name, dtype in estimate.ESTIMATE_TYPES.items()}
        inputs = self.inputs(device)
        arcs.estimate_arcs(
            **{name: inputs[name] for name in ("fan", "grid", "reading", "contacts", "log_odds")},
            model=self.model(),
            free_depth=wp.array(cells, dtype=float, device=device),
            hypotheses=hypotheses,
            estimates_out=struct(estimate.Estimates, **made),
            device=device,
            threads=threads,
        )
        return {name: array.numpy() for name, array in made.items()}
