"""How strongly materials weaken X-rays, per metre.

80 kVp behind 3 mm of aluminium and a chest is weakened like a single energy near 50 keV. Values: mass attenuation
coefficients at 50 keV (NIST XCOM / Hubbell and Seltzer 1995; mixtures by weight) times the usual densities. One energy
for all: beam hardening is left out.
"""

__all__ = ["ATTENUATION_PER_M", "loaded_polymer_per_m"]

_BARIUM_SULPHATE = (8.252, 4.50)
_POLYETHER_BLOCK_AMIDE = (0.2067, 1.01)
"""Mass attenuation in cm^2/g, density in g/cm^3."""

ATTENUATION_PER_M: dict[str, float] = {
    "platinum": 100 * 6.954 * 21.45,
    "copper": 100 * 2.613 * 8.96,
    "steel": 100 * 1.957 * 7.90,
    "nitinol": 100 * (0.55 * 2.475 + 0.45 * 1.213) * 6.45,
    "tungsten": 100 * 5.951 * 19.30,
    "cortical_bone": 100 * 0.4242 * 1.92,
    "spongy_bone": 100 * 0.2950 * 1.18,
    "soft_tissue": 100 * 0.2264 * 1.06,
    "lung": 100 * 0.2270 * 0.26,
    "polymer": 100 * _POLYETHER_BLOCK_AMIDE[0] * _POLYETHER_BLOCK_AMIDE[1],
}
"""Linear attenuation at 50 keV, 1/m."""


def loaded_polymer_per_m(barium_sulphate: float) -> float:
    """Linear attenuation, 1/m, of a catheter's polymer with this share by weight of barium sulphate.

    >>> round(loaded_polymer_per_m(0.0), 1), round(loaded_polymer_per_m(0.3), 1)
    (20.9, 344.9)
    """
    share, rest = barium_sulphate, 1.0 - barium_sulphate
    density = 1.0 / (share / _BARIUM_SULPHATE[1] + rest / _POLYETHER_BLOCK_AMIDE[1])
    return 100 * density * (share * _BARIUM_SULPHATE[0] + rest * _POLYETHER_BLOCK_AMIDE[0])
