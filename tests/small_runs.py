"""Short runs of a small rig over the brick, for tests of the drivers."""

from dataclasses import fields, replace

import numpy as np
import warp as wp

import sonarwarp as sw
from sonarwarp_scenes import BRICK, CONCRETE, Extent, PlacedObject, Scene, flat_seabed, straight_trajectory

RIG = sw.Rig(
    fls=sw.FLS(
        azimuth_edge=np.radians(np.linspace(-3.0, 3.0, 13)), range_edge=np.linspace(2.0, 4.5, 161), intervals=16
    ),
    ps=sw.PS(range_edge=np.linspace(1.0, 7.0, 121), sector_deg=18.0, scan_rate_deg=9.0, strips=2, intervals=16),
).tilted(25.0)

CARVED = sw.ReconstructionSettings(likelihood_field=sw.LikelihoodField(cell=0.04, window_sweeps=1.0), particles=32)
"""The default method, of the whole log."""

SETTINGS = replace(CARVED, method="paper", causal=True)
"""The paper's method, online."""


def scene(front_x=0.0):
    """The brick on a flat seabed."""
    ground = flat_seabed(Extent(x_min=-12.0, x_max=12.0, y_min=-4.0, y_max=4.0))
    return Scene.join(ground, PlacedObject(name="brick", shape=BRICK, front_x=front_x, centre_y=0.0).scene(CONCRETE))


def run(start_x=-3.1, length=0.3, speed=0.1, altitude=1.8):
    """A straight run towards the brick."""
    return straight_trajectory((start_x, 0.0, altitude), heading=0.0, speed=speed, length=length)


def stream(
    runs,
    scenes,
    *,
    device,
    noise=sw.NO_NOISE,
    settings=SETTINGS,
    frames=8,
    threads=2,
    keys=None,
    seed=0,
    rig=RIG,
):
    """Simulate and reconstruct by rounds; returns images, echoes, clouds and the reconstructor."""
    survey = sw.plan_survey(rig, runs)
    reconstructor = sw.Reconstructor(rig, settings=settings, device=device, threads=threads)
    schedule = reconstructor.plan_schedule(survey, frames=frames)
    simulator = sw.Simulator(rig, noise=noise, device=device, threads=threads)
    simulator.plan(survey, scenes, schedule, seed=seed, trajectory_keys=keys)
    reconstructor.plan(survey, schedule, seed=seed, trajectory_keys=keys)
    images, echoes = collect(simulator, reconstructor, survey, schedule)
    return images, echoes, reconstructor.read(), reconstructor


def collect(simulator, reconstructor, survey, schedule):
    """All images [frame, ...] and echoes [ping, ...] of a planned batch, working each round into the reconstructor."""
    images = np.zeros((len(survey.frames), *simulator.images.shape[1:]), dtype=np.float32)
    echoes = np.zeros((len(survey.pings), *simulator.echoes.shape[1:]), dtype=np.float32)
    for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
        simulator.step()
        reconstructor.step(simulator.images, simulator.echoes)
        wp.synchronize()
        round_images, round_echoes = simulator.read()
        images[frame[frame >= 0]] = round_images[frame >= 0]
        echoes[ping[ping >= 0]] = round_echoes[ping >= 0]
    return images, echoes


def allocations(call):
    """Warp's report of what a call allocated, on all devices."""
    reports = []
    with wp.ScopedMemoryTracker("call", report_func=reports.append) as tracker:
        tracker.clear()
        call()
    return reports


def none_of(instants):
    """The same kind of frames or pings without any."""
    return replace(instants, **{field.name: getattr(instants, field.name)[:0] for field in fields(instants)})


def same_points(one, other, mask=None):
    """Whether two clouds hold the same bits, the second one's points chosen by ``mask``."""
    chosen = other if mask is None else other.select(mask)
    if not np.array_equal(one.points, chosen.points):
        return False
    names = set(one.attributes) - {"trajectory"}
    return all(np.array_equal(one.attributes[name], chosen.attributes[name]) for name in names)
