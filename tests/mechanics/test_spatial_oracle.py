"""Another program's rod, PyElastica, comes to rest where this one stands."""

from importlib.util import find_spec

import numpy as np
import pytest
from bench.settle_pyelastica import LOADS, apart


@pytest.mark.skipif(find_spec("elastica") is None, reason="needs PyElastica: pip install -e '.[oracle]'")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("load", LOADS)
def test_pyelastica_settles_at_the_same_tip(load):
    theirs, ours = apart(*(np.array(part) for part in LOADS[load]))
    # 20 elements, and a rod that shears and stretches by parts in ten thousand
    np.testing.assert_allclose(theirs, ours, atol=1.5e-3)
