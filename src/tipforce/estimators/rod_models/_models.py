"""The rod models of thesis table 2 as methods, by their names."""

from functools import partial

from ...mechanics import ConstantCurvature, LargeDeflection, LinearBeam, MassSpring, PseudoRigidBody, RigidLinks
from ._estimator import RodModelEstimator


class Beam(RodModelEstimator):
    """Linear finite elements of a Bernoulli-Euler beam (Gao et al.; thesis table 2, continuum)."""

    name = "beam"
    model = LinearBeam
    breaks = (
        "The tip of a linear beam moves on a straight line instead of turning back, so its axial shift, and with it "
        "the axial force, is read wrongly as soon as the shaft bends."
    )


class Links(RodModelEstimator):
    """Rigid links with torsion springs (Guo, Wang; thesis table 2, multi-body dynamics)."""

    name = "links"
    model = RigidLinks
    breaks = (
        "Ten links bend as the shaft does to 0.25 %, but their stiffness is one number: a shaft that stiffens "
        "as it bends reads too soft or too stiff at all loads but one."
    )


class MassSprings(RodModelEstimator):
    """Particles with stretch and bending springs (Lenoir; thesis table 2, particle-based)."""

    name = "mass-spring"
    model = MassSpring
    breaks = (
        "Its springs give along the shaft, and their stiffness is a matter of taste; with those of a "
        "solid round section it errs as the links do."
    )


class Elastica(RodModelEstimator):
    """Large deflection of a Bernoulli-Euler beam from the tip's pose (Khoshnam et al.; thesis table 2, continuum)."""

    name = "elastica"
    model = LargeDeflection
    breaks = (
        "It sees the tip's pose alone, so an error of the assumed pre-curvature or of the base goes into the "
        "force as it is."
    )
    stations = 2


class Arcs(RodModelEstimator):
    """One arc of constant curvature: the kinematics by which catheter robots are steered."""

    name = "arcs"
    model = ConstantCurvature
    breaks = (
        "One arc has one degree of freedom, so its shape determines one component and the other is left at zero; "
        "under a small force it deflects by 3/4 of the deflection of a shaft."
    )


class StrainArcs(RodModelEstimator):
    """Four arcs: the strain parametrisation of a Cosserat rod (Back et al.; thesis table 2, differential geometry)."""

    name = "strain"
    model = partial(ConstantCurvature, arcs=4)
    breaks = (
        "Four arcs follow the shaft closely; as for all of these models, play of the knob is read as a "
        "lateral force, and an axial force on a nearly straight shaft is not seen."
    )


class PseudoRigid(RodModelEstimator):
    """Howell's pseudo-rigid body with one hinge, from the tip's position."""

    name = "pseudo-rigid"
    model = PseudoRigidBody
    breaks = (
        "One hinge has one degree of freedom, so the tip determines one component and the other is left at zero; "
        "nothing remains to distinguish a force from a wrong pre-curvature."
    )
    stations = 1
