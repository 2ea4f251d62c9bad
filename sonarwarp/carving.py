"""The improved estimator: contacts placed by what both sonars prove, strays and repeats out, faces of the PS added."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from sonarwarp import specs
from sonarwarp.cloud import PointCloud
from sonarwarp.face_cloud import face_cloud
from sonarwarp.settings import ReconstructionSettings
from sonarwarp.survey import Survey, group_rows
from sonarwarp_kernels import arcs, crowd, free_depth, fronts, repeats, sides, slots, tops
from sonarwarp_kernels.estimate import Estimates
from sonarwarp_kernels.particles import Contacts, Reading
from sonarwarp_kernels.specs import Grid


class Carver:
    """Free depths of a batch, and what follows from them.

    Args:
        survey: frames and pings.
        settings: of the reconstruction.
        grid: cells, on their device.
        contacts: critical points of all frames; read, never written.
        world_from_head: pose of every ping's head, shape [ping].
        footprint: footprints of every ping; read, never written; shape [ping, footprint].
        frame_slots: slots of a round of frames.
        threads: CPU threads.
    """

    def __init__(
        self,
        survey: Survey,
        settings: ReconstructionSettings,
        grid: Grid,
        contacts: Contacts,
        world_from_head: wp.array,
        footprint: wp.array,
        frame_slots: int,
        threads: int,
    ) -> None:
        device = grid.origin.device
        self._survey = survey
        self._settings = settings
        self._grid = grid
        self._contacts = contacts
        self._threads = threads
        self._device = device
        self._fan = survey.rig.fls.fan(device)
        self._carving = specs.carving(settings)
        self._model = specs.arc_model(settings)
        self._sides = specs.side_model(settings)
        self._front_model = specs.front_model(settings, survey.rig.ps)
        shape = (survey.trajectories, grid.nx, grid.ny, grid.nz)
        self._free_depth = wp.zeros(shape, dtype=float, device=device)
        self._count = wp.zeros(shape, dtype=int, device=device)
        self._top = wp.full(shape[:3], tops.NO_TOP, dtype=int, device=device)
        self._level = wp.zeros(contacts.critical_range.shape, dtype=float, device=device)
        self._slot_level = wp.zeros((frame_slots, survey.rig.fls.beams), dtype=float, device=device)
        self._surest = wp.zeros(repeats.SLOTS * contacts.critical_range.size, dtype=int, device=device)
        self.quality = wp.zeros(contacts.critical_range.shape, dtype=int, device=device)
        self.hits = wp.zeros(contacts.critical_range.shape, dtype=int, device=device)
        self._order, self._first_frame = self._by_trajectory(survey.frames.trajectory)
        self._profiles = self._plan_profiles(world_from_head, footprint)
        self._fronts = self._plan_fronts(footprint.shape)

    def _plan_profiles(self, world_from_head: wp.array, footprint: wp.array) -> fronts.Profiles:
        pings = self._survey.pings
        order, first = self._by_trajectory(pings.trajectory)
        profiles = fronts.Profiles()
        profiles.trajectory = wp.array(pings.trajectory, dtype=int, device=self._device)
        profiles.world_from_head = world_from_head
        profiles.footprint = footprint
        profiles.seabed = wp.array(_seabed_under_pings(self._survey), dtype=float, device=self._device)
        profiles.order, profiles.first = order, first
        return profiles

    def _by_trajectory(self, trajectory: np.ndarray) -> tuple[wp.array, wp.array]:
        """Rows by trajectory, shape [row], and where each begins among them, shape [trajectory + 1]."""
        rows = group_rows(trajectory, self._survey.trajectories)
        order = np.concatenate([*rows, np.zeros(0, dtype=int)])
        first = np.cumsum([0, *(len(mine) for mine in rows)])
        return wp.array(order, dtype=int, device=self._device), wp.array(first, dtype=int, device=self._device)

    def _plan_fronts(self, shape: tuple[int, ...]) -> fronts.Fronts:
        ps = self._survey.rig.ps
        # At the window's end the fan is widest.
        across = 2.0 * float(ps.range_edge[-1]) * math.radians(ps.fan_beamwidth_deg) / 2.0
        columns = math.ceil(across / self._settings.faces.spacing) + 1
        found = fronts.Fronts()
        for name, dtype in fronts.FRONT_TYPES.items():
            setattr(found, name, wp.zeros((*shape, columns), dtype=dtype, device=self._device))
        return found

    def look(self, slot_frame: wp.array, images: wp.array, critical_bin: wp.array) -> None:
        """Keep of a round's images how bright their contacts are.

        Args:
            slot_frame: frame of each slot, shape [slot].
            images: shape [slot, beam, bin].
            critical_bin: shape [slot, beam].
        """
        length = self._settings.free_space.side_bins
        on = {"device": self._device, "threads": self._threads}
        sides.measure_onsets(images, critical_bin, length, self._slot_level, **on)
        slots.scatter_rows(slot_frame, self._slot_level, self._level, device=self._device)

    def conclude(self, log_odds: wp.array, reading: Reading, estimates: Estimates) -> None:
        """Measure what is empty, place all contacts, take strays out, find faces and take repeats out; only launches.

        Args:
            log_odds: the PS's field, shape [trajectory, x, y, z].
            reading: how it is read.
            estimates: written.
        """
        on = {"device": self._device, "threads": self._threads}
        grid, fan, contacts, hypotheses = self._grid, self._fan, self._contacts, self._settings.free_space.hypotheses
        self._free_depth.fill_(free_depth.UNASKED)
        free_depth.ask_arcs(grid, fan, contacts, hypotheses, self._free_depth, **on)
        columns = self._fronts.found.shape[2]
        fronts.ask_sheets(grid, self._front_model, self._profiles, columns, self._free_depth, device=self._device)
        free_depth.measure_free_depth(
            grid, fan, self._carving, contacts, self._order, self._first_frame, self._free_depth, **on
        )
        arcs.estimate_arcs(
            fan, grid, reading, self._model, contacts, log_odds, self._free_depth, hypotheses, estimates, **on
        )
        trajectory, point = contacts.trajectory, estimates.likely
        wp.copy(self.quality, estimates.quality)
        sides.drop_sides(self._sides, contacts.critical_range, self._level, self.quality, **on)
        self._count.zero_()
        crowd.count_points(grid, trajectory, self.quality, point, self._count, device=self._device)
        least = self._settings.free_space.stray_points
        crowd.drop_strays(grid, trajectory, point, self._count, least, self.quality, **on)
        self._top.fill_(tops.NO_TOP)
        tops.raise_tops(grid, trajectory, self.quality, point, self._top, device=self._device)
        fronts.find_fronts(grid, self._front_model, self._profiles, self._free_depth, self._top, self._fronts, **on)
        self._drop_repeats(estimates)

    def _drop_repeats(self, estimates: Estimates) -> None:
        """Of repeated hits keep the surest; last, for strays and tops are told by all of them."""
        self.hits.fill_(1)
        contacts, spacing = self._contacts, self._settings.free_space.hit_spacing
        if spacing == 0.0:
            return
        trajectory, point = contacts.trajectory, estimates.likely
        self._surest.fill_(repeats.NO_CONTACT)
        repeats.find_surest(
            trajectory,
            self.quality,
            point,
            contacts.critical_range,
            estimates.elevation_deviation,
            spacing,
            self._surest,
            device=self._device,
        )
        repeats.drop_repeats(trajectory, point, self._surest, spacing, self.hits, self.quality, device=self._device)

    def faces(self) -> PointCloud:
        """Points of the faces that :meth:`conclude` found."""
        found = {name: getattr(self._fronts, name).numpy() for name in fronts.FRONT_TYPES}
        return face_cloud(
            self._survey,
            found,
            spacing=self._settings.faces.spacing,
            registration=math.radians(self._settings.free_space.registration_deg),
        )


def _seabed_under_pings(survey: Survey) -> np.ndarray:
    """Height of the seabed under every ping [m], from the altitude of the last frame before it, shape [ping].

    Of the first frame where there is none before: what comes later must not change what a ping has shown.
    """
    frames, pings = survey.frames, survey.pings
    height = np.zeros(len(pings))
    seabed = frames.pose[:, 2] - frames.altitude
    for index in range(survey.trajectories):
        mine, theirs = frames.trajectory == index, pings.trajectory == index
        if mine.any():
            last = np.searchsorted(frames.time[mine], pings.time[theirs], side="right") - 1
            height[theirs] = seabed[mine][np.maximum(last, 0)]
    return height
