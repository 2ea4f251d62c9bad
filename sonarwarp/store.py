"""What a log on disk looks like: one Zarr store (format 3), a group per sonar that xarray opens as a Dataset.

``xarray.open_zarr(path, group="fls")`` needs nothing of ours. Groups:

========= ==========================================================================================
``/``     attributes only: version, rig (TOML), noise and reconstruction settings (TOML) where known,
          and how far the log is complete
``fls``   the imaging sonar, dimensions frame, beam, bin
``ps``    the profiling sonar, dimensions ping, bin
``truth`` simulated logs only: true poses; first contacts of every beam where they were asked for
========= ==========================================================================================

Names and attributes follow the ICES SONAR-netCDF4 convention, version 2.0, where it has them:

=============================== ====================================================================
its name                        here
=============================== ====================================================================
backscatter_r                   echo amplitude (Eq. 36), [frame, beam, bin] and [ping, bin], a plain
                                array instead of vectors of variable length; NaN where not recorded
ping_time                       time of a frame or ping; float64 seconds since 1970 instead of whole
                                nanoseconds, so that times come back to the bit. A simulation's clock
                                starts at 1970-01-01
beam                            number of the beam, from right to left
beamwidth_receive_major, _minor horizontal and vertical width [arc_degree]
rx_beam_rotation_phi, _theta,   direction of a beam: turns about x forward, y starboard, z down that
_psi                            take the platform's z axis to the beam's; psi is 0. [beam] and [ping]
platform_pitch, platform_roll   attitude of the vehicle, bow up and starboard down [arc_degree]
transducer_offset_x, _y, _z     lever arm; forward, starboard, down [m]
beam_mode                       horizontal and vertical
=============================== ====================================================================

Ours, because the convention has nothing for them: the dimension words; ``range`` and ``azimuth`` of bins and beams, as
recorded sonars are neither uniform nor known by a sound speed; ``trajectory`` and ``number``; ``sensor_position`` and
``sensor_quaternion`` in a local world, z up (no latitude, longitude or heading: it has no north); ``altitude``;
``head_angle``; the group ``truth``. Where both say the same, ours is what is read back.

A log is written from front to back, frames and pings in the order of the survey. ``frames_complete`` and
``pings_complete`` say how many are on disk; they are replaced as one file after the data, so that a writer that is
killed at any instant leaves a log that says what is there. Every chunk carries a checksum.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp.sonar import Rig

VERSION = 1
"""Of the layout; a reader refuses any other."""

VERSION_ATTRIBUTE = "sonarwarp_log_version"

# Bytes and rows that a chunk of images takes at most: 3 to 6 s of a sonar at 10 Hz.
_CHUNK_BYTES = 8 << 20
_CHUNK_ROWS = 64

# Rows of columns, whose entries are small.
_COLUMN_ROWS = 1 << 16

TRUTHS = ("none", "poses", "poses and first contacts")
"""What the attribute ``truth`` says that there is."""

CONTACTS = ("range", "azimuth", "elevation", "face")
"""Fields of ``FirstContacts``, stored as ``first_contact_range`` and so on."""


class StoreError(ValueError):
    """A log that cannot be written or read. The message is one line: file, what is wrong, and the way out."""


@contextmanager
def refusing(path: Path, what: str, way_out: str) -> Iterator[None]:
    """Turn whatever zarr and the file system raise into a :class:`StoreError` of one line.

    Zarr raises what its parsers happen to meet (KeyError, TypeError, AttributeError, RuntimeError of a codec and more),
    so every exception counts; interrupts pass.
    """
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{path}: {what}: {error.strerror or one_line(error)}; {way_out}") from error
    except Exception as error:
        raise StoreError(f"{path}: {what}: {one_line(error)}; {way_out}") from error


def one_line(error: BaseException) -> str:
    """An error's message without line breaks, cut where it goes on and on."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 300 else f"{text[:297]}..."


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One array of a group."""

    name: str
    dims: tuple[str, ...]
    dtype: str
    units: str
    long_name: str
    attributes: dict[str, Any]

    @property
    def fill(self) -> float | int:
        """What stands where nothing was written."""
        return np.nan if np.dtype(self.dtype).kind == "f" else -2

    def shape(self, sizes: dict[str, int]) -> tuple[int, ...]:
        """Shape, from the sizes of the dimensions."""
        return tuple(sizes[name] for name in self.dims)

    def chunks(self, sizes: dict[str, int]) -> tuple[int, ...]:
        """Shape of a chunk: some rows, all of each."""
        shape = self.shape(sizes)
        if not shape:
            return ()
        if len(shape) == 1 or self.dims[1] in _PARTS:
            rows = _COLUMN_ROWS
        else:
            # Of frames by what an image takes, also in arrays beside the images: they are written together.
            row = 4 * sizes["bin"] * (sizes["beam"] if self.dims[0] == "frame" else 1)
            rows = min(_CHUNK_ROWS, max(_CHUNK_BYTES // row, 1))
        return (max(min(rows, shape[0]), 1), *shape[1:])


# Dimensions of vectors, with their sizes.
_PARTS = {"axis": 3, "quaternion": 4}


def dimensions(rig: Rig, group: str, frames: int, pings: int) -> dict[str, int]:
    """Sizes of a group's dimensions."""
    bins = rig.ps.bins if group == "ps" else rig.fls.bins
    return {"frame": frames, "ping": pings, "beam": rig.fls.beams, "bin": bins, **_PARTS}


def _variable(name: str, dims: str, dtype: str, units: str, long_name: str, **attributes: Any) -> Variable:
    return Variable(
        name=name, dims=tuple(dims.split()), dtype=dtype, units=units, long_name=long_name, attributes=attributes
    )


def _instants(row: str, sensor: str) -> tuple[Variable, ...]:
    return (
        _variable(
            *("ping_time", row, "f8", "seconds since 1970-01-01 00:00:00Z", "Time-stamp of each ping"),
            axis="T",
            calendar="gregorian",
            standard_name="time",
        ),
        _variable("trajectory", row, "i8", "1", "Index of the trajectory"),
        _variable("number", row, "i8", "1", "Number within the trajectory"),
        *_poses(row, "sensor", sensor),
        _variable(
            *("platform_pitch", row, "f4", "arc_degree", "pitch angle"),
            standard_name="platform_pitch_angle",
            valid_range=[-90.0, 90.0],
        ),
        _variable(*("platform_roll", row, "f4", "arc_degree", "roll angle"), standard_name="platform_roll_angle"),
    )


def _poses(row: str, prefix: str, sensor: str) -> tuple[Variable, ...]:
    return (
        _variable(f"{prefix}_position", f"{row} axis", "f8", "m", f"Position of {sensor} in the world: x, y, z up"),
        _variable(
            *(f"{prefix}_quaternion", f"{row} quaternion", "f8", "1"),
            f"Attitude of {sensor}, world from sensor (x forward, y left, z up): x, y, z, w",
        ),
    )


def _beams(row: str) -> tuple[Variable, ...]:
    width = "Half power one-way receive beam width along"
    turn = "receive beam angular rotation about the"
    return (
        _variable("beamwidth_receive_major", row, "f4", "arc_degree", f"{width} major (horizontal) axis of beam"),
        _variable("beamwidth_receive_minor", row, "f4", "arc_degree", f"{width} minor (vertical) axis of beam"),
        _variable("rx_beam_rotation_phi", row, "f4", "arc_degree", f"{turn} x axis", valid_range=[-180.0, 180.0]),
        _variable("rx_beam_rotation_theta", row, "f4", "arc_degree", f"{turn} y axis", valid_range=[-90.0, 90.0]),
        _variable("rx_beam_rotation_psi", row, "f4", "arc_degree", f"{turn} z axis", valid_range=[-180.0, 180.0]),
        *(
            _variable(
                *(f"transducer_offset_{axis}", "", "f4", "m"),
                f"{axis}-axis distance from the platform coordinate system origin to the sonar transducer",
            )
            for axis in "xyz"
        ),
    )


_AMPLITUDE = {"comment": "echo amplitude, linear; the gain of the rig is in it"}
_SEABED = "Height of the sonar above the seabed"
_HEAD = "Angle of the head about its z axis from mid-sector"
_RANGE = _variable("range", "bin", "f8", "m", "Slant range of the bins' centres")

IMAGES = _variable(
    "backscatter_r", "frame beam bin", "f4", "1", "Raw backscatter measurements (real part)", **_AMPLITUDE
)
"""The imaging sonar's images."""

ECHOES = _variable("backscatter_r", "ping bin", "f4", "1", "Raw backscatter measurements (real part)", **_AMPLITUDE)
"""The profiling sonar's echo profiles."""

FLS_COLUMNS = (
    *_instants("frame", "the sonar"),
    _variable("altitude", "frame", "f8", "m", _SEABED, standard_name="height_above_sea_floor"),
    _variable("beam", "beam", "i8", "1", "Beam name"),
    _variable("azimuth", "beam", "f8", "rad", "Azimuth of the beams' centres, positive to port"),
    _RANGE,
    *_beams("beam"),
)
"""Everything else of the group ``fls``."""

PS_COLUMNS = (
    *_instants("ping", "the mount, before the head's turn"),
    _variable("head_angle", "ping", "f8", "rad", _HEAD),
    _RANGE,
    *_beams("ping"),
)
"""Everything else of the group ``ps``."""

TRUTH_COLUMNS = (
    *_poses("frame", "frame", "the FLS"),
    _variable("altitude", "frame", "f8", "m", _SEABED, standard_name="height_above_sea_floor"),
    *_poses("ping", "ping", "the PS's mount, before the head's turn"),
    _variable("head_angle", "ping", "f8", "rad", _HEAD),
)
"""True poses of a simulated log."""

CONTACT_VARIABLES = (
    _variable("first_contact_range", "frame beam", "f4", "m", "Slant range of the nearest surface; infinite for none"),
    _variable("first_contact_azimuth", "frame beam", "f4", "rad", "Azimuth of the nearest surface"),
    _variable("first_contact_elevation", "frame beam", "f4", "rad", "Elevation of the nearest surface"),
    _variable("first_contact_face", "frame beam", "i4", "1", "Face of the scene's mesh; -1 for none"),
)
"""First contacts of a simulated log, in the order of ``CONTACTS``."""

COORDINATES = {
    "fls": "ping_time trajectory number range azimuth",
    "ps": "ping_time trajectory number range head_angle",
    "truth": "",
}
"""Variables of each group that xarray takes as coordinates."""
