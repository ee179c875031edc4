"""What a pipeline refuses before it works."""

from __future__ import annotations

import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.pipeline.inputs import require_limits


@pytest.mark.parametrize("mass", [0.0, -1.0, 5e-4, 2e4, float("nan"), float("inf")])
def test_no_mass_in_another_unit_is_taken(mass):
    with pytest.raises(ConfigError, match=r"0\.001 to 10000 kg"):
        require_limits(0, None, mass)


@pytest.mark.parametrize("mass", [None, 1e-3, 8, 1e4])
def test_masses_of_debris_are_taken(mass):
    require_limits(0, None, mass)
