"""Published and exact solutions that check rod solvers."""

CANTILEVER = {
    0.5: (0.16214, 0.01592, 0.24453),
    1.0: (0.30172, 0.05643, 0.46135),
    2.0: (0.49346, 0.16064, 0.78175),
    5.0: (0.71379, 0.38763, 1.21537),
    10.0: (0.81061, 0.55500, 1.43029),
}
"""Transverse dead tip load, alpha = P L^2 / EI: deflection / L, shortening / L, tip angle in rad.

Bisshopp and Drucker 1945, Mattiasson 1981.
"""
MOMENT_TIPS = {
    "z": (1.14411346, -0.17192108, 1.14191490),
    "x": (0.47451539, 0.22922810, 1.14411346),
}
"""Tip of a rod with EI = 2 and length 2 under the tip moment (3, 0, 4), by its first tangent; exact for any GJ."""
BEND_45 = {300.0: (22.2448, 58.7791, 40.1919), 600.0: (15.6848, 47.1504, 53.4749)}
"""Arc of 45 degrees and radius 100, EI = GJ = 8.333e5, under a load out of its plane (Bathe and Bolourchi 1979),
converged. Tip toward the arc's centre, along the first tangent, along the load."""
