"""Forming images from few rays: error against cost, beside putting every ray whole into one bin.

The reference has 65,536 rays a beam, jointly stratified over azimuth and elevation and all distinct. Error is RMS of
the difference over RMS of the reference, noise off, whole window. Time is the best of several runs over all frames.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from sonarwarp.poses import compose
from sonarwarp.scene_table import DeviceScenes
from sonarwarp.sonar import FLS, PRESETS, PS
from sonarwarp_kernels import echo, forming, keys, raycast
from sonarwarp_scenes import BRICK, CONCRETE, TABLE_2, Extent, Roughness, Scene, flat_seabed, rough_seabed

EXTENT = Extent(x_min=-1.0, x_max=8.0, y_min=-2.5, y_max=2.5)

REFERENCE_COLUMNS = 256
REFERENCE_ROWS = 256


def _brick() -> Scene:
    return Scene.join(flat_seabed(EXTENT), BRICK.scene(CONCRETE).moved((4.0, 0.0, 0.0)))


def _wedges() -> Scene:
    wedge = TABLE_2[2].scene(CONCRETE)
    return Scene.join(flat_seabed(EXTENT), wedge.moved((3.6, -0.35, 0.0)), wedge.moved((4.2, 0.35, 0.0)))


def _rough() -> Scene:
    return rough_seabed(EXTENT, Roughness(spacing=0.0375))


def _fine() -> Scene:
    return rough_seabed(EXTENT, Roughness(spacing=0.01))


def _ball() -> Scene:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.4)
    solid = Scene(vertices=ball.vertices, faces=ball.faces, impedance=np.full(len(ball.faces), CONCRETE))
    return Scene.join(flat_seabed(EXTENT), solid.moved((4.2, 0.1, 0.3)))


@dataclass(frozen=True, kw_only=True)
class FormingCase:
    """A scene, and where it is seen from."""

    name: str
    """Name in results."""
    scene: Callable[[], Scene]
    """Builds the scene."""
    preset: str = "paper simulation"
    """Rig, of ``sonarwarp.sonar.PRESETS``."""
    sonar: type[FLS] | type[PS] = FLS
    """Which sonar of the rig."""
    altitude: float = 3.5
    """Of the vehicle [m]."""
    seed: int = 1
    """Of the poses."""


CASES = (
    FormingCase(name="brick", scene=_brick),
    FormingCase(name="brick, field test", scene=_brick, preset="paper field", altitude=1.8),
    FormingCase(name="wedges", scene=_wedges),
    FormingCase(name="rough seabed", scene=_rough),
    FormingCase(name="rough seabed, field test", scene=_rough, preset="paper field", altitude=1.8),
    FormingCase(name="rough seabed, 0.9 million triangles", scene=_fine),
    FormingCase(name="ball of 1,280 triangles", scene=_ball),
    FormingCase(name="profile of wedges", scene=_wedges, sonar=PS),
    FormingCase(name="profile of a rough seabed", scene=_rough, sonar=PS),
)

FLS_INTERVALS = (16, 32, 48, 64, 96)
PS_INTERVALS = (10, 20, 40)

# Columns and rows of rays a beam for binning ray by ray.
GRIDS = ((1, 64), (2, 256), (4, 512), (8, 1024))


def _vehicle_poses(frames: int, altitude: float, seed: int) -> np.ndarray:
    """A vehicle that rolls, pitches, yaws and strays, shape [frame, 7]."""
    x, y, z, roll, pitch, yaw = np.random.default_rng(seed).uniform(-1.0, 1.0, (6, frames))
    position = np.stack([0.4 * x, 0.2 * y, altitude + 0.05 * z], axis=-1)
    pose = np.concatenate([position, np.tile([0.0, 0.0, 0.0, 1.0], (frames, 1))], axis=-1)
    for axis, angle in ((2, 0.1 * yaw), (1, 0.02 * pitch), (0, 0.03 * roll)):
        turn = np.zeros((frames, 7))
        turn[:, 3 + axis], turn[:, 6] = np.sin(angle / 2), np.cos(angle / 2)
        pose = compose(pose, turn)
    return pose


def sensor_poses(case: FormingCase, frames: int) -> np.ndarray:
    """Poses of the FLS, or of the PS's head over its sector, world from sensor, shape [frame, 7]."""
    rig = PRESETS[case.preset]
    vehicle = _vehicle_poses(frames, case.altitude, case.seed)
    if case.sonar is FLS:
        return compose(vehicle, rig.fls_mount.vehicle_from_sensor())
    angle = np.linspace(-0.5, 0.5, frames) * math.radians(rig.ps.sector_deg)
    head = np.zeros((frames, 7))
    head[:, 5], head[:, 6] = np.sin(angle / 2), np.cos(angle / 2)
    return compose(compose(vehicle, rig.ps_mount.vehicle_from_sensor()), head)


class FormingBench:
    """A case on a device, with its reference image.

    Args:
        case: what is seen.
        frames: frames or pings.
        device: Warp device.
        threads: CPU threads.
    """

    def __init__(self, case: FormingCase, frames: int, device: str, threads: int) -> None:
        rig = PRESETS[case.preset]
        self.sonar = rig.fls if case.sonar is FLS else rig.ps
        self.frames, self.device, self.threads = frames, device, threads
        self._scenes = DeviceScenes([case.scene()], wp.get_device(device))
        self._pose = wp.array(sensor_poses(case, frames).astype(np.float32), dtype=wp.transform, device=device)
        self._scene = wp.zeros(frames, dtype=int, device=device)
        self._key = wp.zeros(frames, dtype=wp.uint64, device=device)
        one = wp.array([case.seed], dtype=wp.uint64, device=device)
        number = wp.array(np.arange(frames), dtype=int, device=device)
        keys.frame_keys(one, one, self._scene, number, keys.FLS_FRAMES, self._key, device=device)
        self.reference, _ = self.bin(REFERENCE_COLUMNS, REFERENCE_ROWS)

    def error(self, image: np.ndarray) -> float:
        """RMS of the difference to the reference over RMS of the reference."""
        return float(np.sqrt(np.mean((image - self.reference) ** 2) / np.mean(self.reference**2)))

    def form(self, intervals: int, repeats: int = 1) -> tuple[np.ndarray, float, float]:
        """Image [frame, beam, bin], seconds for all frames, and flagged cells per frame, by ``echo.form_echoes``."""
        fan = replace(self.sonar, intervals=intervals).fan(self.device)
        scratch = forming.Scratch()
        for name, (shape, dtype) in forming.scratch_shapes(fan, self.frames).items():
            setattr(scratch, name, wp.zeros(shape, dtype=dtype, device=self.device))
        counts = self._counts()

        def launch() -> None:
            echo.form_echoes(
                fan,
                self._scenes.table,
                self._pose,
                self._scene,
                self._key,
                scratch,
                counts,
                device=self.device,
                threads=self.threads,
            )

        seconds = self._best_time(launch, repeats)
        flagged = float(np.sum(scratch.state.numpy() >= int(forming.CELL_FLAGGED))) / self.frames
        return counts.numpy() / fan.fixed_point, seconds, flagged

    def bin(self, columns: int, rows: int, repeats: int = 1) -> tuple[np.ndarray, float]:
        """Image [frame, beam, bin] and seconds for all frames, of ``columns`` x ``rows`` rays a beam, ray by ray.

        Grids of one azimuth per beam, one after another. The elevations of each are shifted by a bit-reversed part of
        a row, so that every stratum of both angles holds one ray.
        """
        fan = self.sonar.fan(self.device)
        border, first = fan.column_azimuth.numpy().astype(np.float64), fan.first_column.numpy()
        lower, width = border[first], border[first + fan.strips] - border[first]
        grid = (self.frames, len(first), rows)
        distance, face, normal = (wp.zeros(grid, dtype=kind, device=self.device) for kind in (float, int, wp.vec3))
        counts = self._counts()
        bits = columns.bit_length() - 1
        angles = []
        for column in range(columns):
            shift = (int(f"{column:0{bits}b}"[::-1], 2) + 0.5) / columns
            part = (np.arange(rows) + shift) / rows
            elevation = fan.elevation_min + (fan.elevation_max - fan.elevation_min) * part
            azimuth = lower + width * (column + 0.5) / columns
            angles.append([wp.array(angle, dtype=float, device=self.device) for angle in (azimuth, elevation)])
        reach = float(fan.range_edge.numpy()[-1])
        table = self._scenes.table

        def launch() -> None:
            counts.zero_()
            for azimuth, elevation in angles:
                raycast.cast_grid(
                    table,
                    azimuth,
                    elevation,
                    fan.cone,
                    reach,
                    self._pose,
                    self._scene,
                    distance,
                    face,
                    normal,
                    device=self.device,
                    threads=self.threads,
                )
                echo.bin_hits(
                    fan,
                    table,
                    self._pose,
                    self._scene,
                    azimuth,
                    elevation,
                    distance,
                    face,
                    normal,
                    1.0 / (columns * rows),
                    counts,
                    device=self.device,
                    threads=self.threads,
                )

        seconds = self._best_time(launch, repeats)
        return counts.numpy() / fan.fixed_point, seconds

    def _counts(self) -> wp.array:
        beams = self.sonar.beams if isinstance(self.sonar, FLS) else 1
        return wp.zeros((self.frames, beams, self.sonar.bins), dtype=int, device=self.device)

    def _best_time(self, launch: Callable[[], None], repeats: int) -> float:
        # The first run compiles and warms up, unless it is the only one.
        seconds = []
        for _ in range(repeats + (repeats > 1)):
            wp.synchronize_device(self.device)
            start = time.perf_counter()
            launch()
            wp.synchronize_device(self.device)
            seconds.append(time.perf_counter() - start)
        return min(seconds[-repeats:])


def run(
    cases: Sequence[FormingCase] = CASES,
    *,
    frames: int = 6,
    grids: Sequence[tuple[int, int]] = GRIDS,
    device: str = "cpu",
    threads: int = 1,
    repeats: int = 5,
) -> Iterator[dict[str, Any]]:
    """Rows of results: error and milliseconds per frame of every case, formed and binned.

    Args:
        cases: what to measure.
        frames: frames or pings of each case.
        grids: columns and rows of rays a beam for binning; columns are powers of two.
        device: Warp device.
        threads: CPU threads.
        repeats: timed runs, of which the best counts.
    """
    for case in cases:
        bench = FormingBench(case, frames, device, threads)
        common = {
            "case": case.name,
            "seed": case.seed,
            "frames": frames,
            "device": device,
            "threads": threads,
            "warp": wp.config.version,
        }
        for intervals in FLS_INTERVALS if case.sonar is FLS else PS_INTERVALS:
            image, seconds, flagged = bench.form(intervals, repeats)
            yield {
                **common,
                "method": "formed",
                "intervals": intervals,
                "error": bench.error(image),
                "ms_per_frame": 1e3 * seconds / frames,
                "flagged_cells": flagged,
            }
        for columns, rows in grids:
            image, seconds = bench.bin(columns, rows, repeats)
            yield {
                **common,
                "method": "binned",
                "rays_per_beam": columns * rows,
                "error": bench.error(image),
                "ms_per_frame": 1e3 * seconds / frames,
            }
