"""The paper's scenes as OpenUSD files, on flat seabeds: the brick, the six objects of Table 1, the misaligned pairs.

``python -m sonarwarp_scenes.assets FOLDER`` writes them anew. With a rough seabed a scene is a few megabytes: call
:func:`~sonarwarp_scenes.write_deployment` for one.
"""

from __future__ import annotations

import math
from pathlib import Path

from sonarwarp_scenes.deployments import Deployment, brick_deployment, pair_deployment, slope_deployment
from sonarwarp_scenes.shapes import TABLE_1, TABLE_2
from sonarwarp_scenes.usd_write import SonarOutline, write_deployment

# Height of the profiling sonar over the imaging sonar [m]. Ours: the paper gives no lever arms.
_PS_HEIGHT = 0.15


def paper_sonars(*, tilt_deg: float, window_start: float) -> tuple[SonarOutline, SonarOutline]:
    """Outlines of the paper's sonars: the imaging one (FLS), and the sector of the profiling one (PS) laid on its side.

    Args:
        tilt_deg: turn of both downwards [deg].
        window_start: slant range at which the imaging sonar's 5 m begin [m].
    """
    down = 0.5 * math.radians(tilt_deg)
    half_turn = math.sqrt(0.5)
    fls = SonarOutline(
        name="FLS",
        vehicle_from_sensor=(0.0, 0.0, 0.0, 0.0, math.sin(down), 0.0, math.cos(down)),
        half_azimuth=math.radians(14.5),
        half_elevation=math.radians(7.0),
        range_min=window_start,
        range_max=window_start + 5.0,
    )
    # The tilt about y after a quarter turn about x.
    lying = (half_turn * math.cos(down), half_turn * math.sin(down), -half_turn * math.sin(down))
    ps = SonarOutline(
        name="PS",
        vehicle_from_sensor=(0.0, 0.0, _PS_HEIGHT, *lying, half_turn * math.cos(down)),
        half_azimuth=math.radians(30.0),
        half_elevation=math.radians(10.0),
        range_min=0.3,
        range_max=10.0,
    )
    return fls, ps


def paper_deployments() -> dict[str, tuple[Deployment, tuple[SonarOutline, SonarOutline]]]:
    """The paper's deployments on flat seabeds and the sonars of each, by name."""
    series, pairs = paper_sonars(tilt_deg=30.0, window_start=0.42), paper_sonars(tilt_deg=40.0, window_start=0.42)
    runs = [(brick_deployment(), paper_sonars(tilt_deg=25.0, window_start=0.83))]
    runs += [(slope_deployment(shape), series) for shape in TABLE_1]
    runs += [(pair_deployment(shape, "misaligned"), pairs) for shape in TABLE_2]
    return {deployment.name: (deployment, sonars) for deployment, sonars in runs}


def write_assets(folder: str | Path) -> list[Path]:
    """Write every deployment of :func:`paper_deployments` as ``NAME.usda`` into a folder, and return the files.

    Raises:
        OSError: the folder does not exist, may not be written, or its disk is full.
        ModuleNotFoundError: usd-core is not installed.
    """
    files = []
    for name, (deployment, sonars) in paper_deployments().items():
        files.append(Path(folder) / f"{name}.usda")
        write_deployment(files[-1], deployment, sonars=sonars)
    return files


def asset(name: str) -> Path:
    """The file of one of the paper's deployments, such as ``brick``, ``slope_60`` or ``pair_60_misaligned``.

    Raises:
        ValueError: no such deployment.
    """
    path = Path(__file__).with_name(f"{name}.usda")
    if not path.is_file():
        names = ", ".join(sorted(file.stem for file in path.parent.glob("*.usda")))
        raise ValueError(f"name: {name!r}, must be one of {names}")
    return path
