"""Makes the frame of a log on disk: folders, arrays, columns and attributes, before any image is there."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp.durable import settle
from sonarwarp.settings import Noise, ReconstructionSettings
from sonarwarp.store import (
    CONTACT_VARIABLES,
    COORDINATES,
    ECHOES,
    FLS_COLUMNS,
    IMAGES,
    PS_COLUMNS,
    TRUTH_COLUMNS,
    TRUTHS,
    VERSION,
    VERSION_ATTRIBUTE,
    StoreError,
    Variable,
    dimensions,
    refusing,
)
from sonarwarp.store_scratch import put_in_place, scratch_folder, sweep
from sonarwarp.store_values import fls_columns, ps_columns, scans_vertically, truth_columns
from sonarwarp.survey import Survey, check_same_rows
from sonarwarp.toml_text import toml_text

# Times beyond are no time stamps of 64-bit nanoseconds, which xarray makes of them: the year 2262 [s].
_LATEST = 9.2e9


def create_log(
    path: Path,
    survey: Survey,
    *,
    truth: Survey | None,
    contacts: bool,
    noise: Noise | None,
    reconstruction: ReconstructionSettings | None,
    overwrite: bool,
) -> None:
    """Make a log with nothing complete, in one step: until it is whole it has another name, with a dot before.

    A process that is killed by then leaves a folder of that name, which the next one to make a log here removes.

    Arguments and errors are those of ``sonarwarp.store_write.StoreWriter``.
    """
    _check(path, survey, truth, contacts)
    sweep(path)
    _refuse_existing(path, overwrite)
    attributes = _root_attributes(survey, noise, reconstruction)
    attributes["truth"] = TRUTHS[0 if truth is None else 1 + contacts]
    with (
        refusing(path, "cannot be created", "choose a folder that exists, can be written and has space"),
        scratch_folder(path) as scratch,
    ):
        _create(scratch, survey, truth, contacts, attributes)
        settle(scratch)
        put_in_place(scratch, path)


def _check(path: Path, survey: Survey, truth: Survey | None, contacts: bool) -> None:
    for name, time in (("frames", survey.frames.time), ("pings", survey.pings.time)):
        latest = float(np.abs(time).max(initial=0.0))
        if latest > _LATEST:
            raise StoreError(
                f"{path}: survey.{name}.time: {latest:g} s, must be within {_LATEST:g} s of 1970; give seconds"
            )
    if contacts and truth is None:
        raise StoreError(f"{path}: contacts: given without truth, must come with the true poses")
    if truth is not None:
        try:
            check_same_rows("truth", truth, "survey", survey)
        except ValueError as error:
            raise StoreError(f"{path}: {error}") from error


def _is_log(path: Path) -> bool:
    """Whether a log of ours lies at ``path``, in whatever version and state."""
    try:
        return VERSION_ATTRIBUTE in json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _refuse_existing(path: Path, overwrite: bool) -> None:
    if not os.path.lexists(path):
        return
    if not overwrite:
        raise StoreError(f"{path}: exists already, choose another name or ask to overwrite it")
    if path.is_symlink() or not _is_log(path):
        raise StoreError(f"{path}: exists and is no log, which is never overwritten; remove it or choose another name")


def _root_attributes(
    survey: Survey, noise: Noise | None, reconstruction: ReconstructionSettings | None
) -> dict[str, Any]:
    attributes = {
        VERSION_ATTRIBUTE: VERSION,
        "Conventions": "CF-1.7",
        "sonar_convention_authority": "ICES",
        "sonar_convention_name": "SONAR-netCDF4",
        "sonar_convention_version": "2.0",
        "comment": "names and attributes of SONAR-netCDF4 where it has them; groups and dimensions are sonarwarp's",
        "title": "Log of an imaging and a profiling sonar",
        "summary": f"{len(survey.frames)} frames and {len(survey.pings)} pings of {survey.trajectories} trajectories",
        "keywords": "forward-looking sonar, profiling sonar",
        "date_created": datetime.now(UTC).isoformat(timespec="seconds"),
        "rig": toml_text(rig=survey.rig),
        "frames_complete": 0,
        "pings_complete": 0,
    }
    if noise is not None:
        attributes["noise"] = toml_text(noise=noise)
    if reconstruction is not None:
        attributes["reconstruction"] = toml_text(reconstruction=reconstruction)
    return attributes


def _create(path: Path, survey: Survey, truth: Survey | None, contacts: bool, attributes: dict[str, Any]) -> None:
    import zarr
    from zarr.storage import LocalStore

    store = LocalStore(path)
    root = zarr.create_group(store, attributes=attributes)
    scan = "vertical" if scans_vertically(survey.rig.ps_mount) else "horizontal"
    _create_group(root, "fls", survey, FLS_COLUMNS, fls_columns(survey), (IMAGES,), "horizontal")
    _create_group(root, "ps", survey, PS_COLUMNS, ps_columns(survey), (ECHOES,), scan)
    if truth is not None:
        filled = CONTACT_VARIABLES if contacts else ()
        _create_group(root, "truth", survey, TRUTH_COLUMNS, truth_columns(truth), filled, None)
    with warnings.catch_warnings():
        # Not in the specification yet, but what xarray looks for: without it every opening warns and lists folders.
        warnings.simplefilter("ignore")
        for name in (*root.group_keys(), ""):
            zarr.consolidate_metadata(store, path=name or None)


def _create_group(
    root: Any,
    name: str,
    survey: Survey,
    columns: Iterable[Variable],
    values: dict[str, np.ndarray],
    filled: Iterable[Variable],
    beam_mode: str | None,
) -> None:
    from zarr.codecs import BloscCodec, Crc32cCodec

    attributes = {} if beam_mode is None else {"beam_mode": beam_mode, "coordinates": COORDINATES[name]}
    group = root.create_group(name, attributes=attributes)
    sizes = dimensions(survey.rig, name, len(survey.frames), len(survey.pings))
    for variable in (*columns, *filled):
        array = group.create_array(
            variable.name,
            shape=variable.shape(sizes),
            dtype=variable.dtype,
            chunks=variable.chunks(sizes),
            # Of eleven measured, the fastest and within a tenth of the smallest; noise does not compress.
            compressors=[BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), Crc32cCodec()],
            fill_value=variable.fill,
            dimension_names=variable.dims,
            attributes={"units": variable.units, "long_name": variable.long_name, **variable.attributes},
        )
        if variable.name in values:
            array[...] = values[variable.name]
