"""Another program's rod, PyElastica, comes to rest where this one stands."""

from importlib.util import find_spec

import numpy as np
import pytest

from tipforce.mechanics import SpatialRod, bend_spatial

LOADS = {
    "across": ((0.0, 0.0, 0.0), (0.0, 2.0, 1.0)),
    "against a bent and twisted shaft": ((0.0, 1.0, 0.5), (-1.0, 1.5, 2.0)),
    "along and across": ((0.7, 1.2, -0.6), (1.0, -2.0, 2.0)),
}


@pytest.mark.skipif(find_spec("elastica") is None, reason="needs PyElastica: pip install 'tipforce[oracle]'")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("load", LOADS)
def test_pyelastica_settles_at_the_same_tip(load):
    from bench.settle_pyelastica import settle

    strain, force = (np.array(part) for part in LOADS[load])
    tip, _, torsion, held = list(settle(strain, force))[-1]
    shape = bend_spatial(SpatialRod(1 - 2 * held, 1.0, held, torsion, strain, segments=100), force)
    # 20 elements, and a rod that shears and stretches by parts in ten thousand
    np.testing.assert_allclose(tip - [held, 0, 0], shape.tip_m, atol=1.5e-3)
