"""First contacts: on a flat seabed the lower edge meets it first, at r_emin."""

import numpy as np

from sonarwarp import FLS, Rig, plan_survey
from sonarwarp.truth import first_contacts
from sonarwarp_scenes import Extent, flat_seabed, straight_trajectory


def test_the_lower_edge_meets_a_flat_seabed_first(device):
    rig = Rig(fls=FLS(azimuth_edge=np.radians([-2.0, 0.0, 2.0])))
    run = straight_trajectory((0.0, 0.0, 3.0), heading=0.0, speed=0.5, length=1.0)
    survey = plan_survey(rig, [run])
    scene = flat_seabed(Extent(x_min=-5.0, x_max=12.0, y_min=-5.0, y_max=5.0))
    found = first_contacts(survey, [scene], elevations=700, device=device)
    half = np.radians(7.0)
    step = np.radians(14.0) / 700
    # The lowest ray stands half a step above the beam's edge.
    assert np.allclose(found.elevation, -half + 0.5 * step, atol=1e-6)
    assert np.allclose(found.range, 3.0 / np.sin(np.radians(40.0) + half), rtol=3e-3)
    assert (found.face >= 0).all()


def test_nothing_in_the_window_is_an_infinite_range(device):
    rig = Rig(fls=FLS(azimuth_edge=np.radians([-2.0, 2.0])))
    run = straight_trajectory((0.0, 0.0, 9.0), heading=0.0, speed=0.5, length=0.2)
    scene = flat_seabed(Extent(x_min=-5.0, x_max=22.0, y_min=-5.0, y_max=5.0))
    found = first_contacts(plan_survey(rig, [run]), [scene], elevations=16, device=device)
    assert np.isinf(found.range).all()
    assert (found.face == -1).all()
