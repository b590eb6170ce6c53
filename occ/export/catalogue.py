"""What can be exported.  To add an export: one `Export` here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from occ.export.arguments import ORDER
from occ.export.shares import box_torque, least_peak
from occ.export.symbols import PROGRAM, Symbols
from occ.model.constraint import servo_yaw_acceleration
from occ.objectives import OBJECTIVES, Objective

WRENCH = ("N", "N", "N m")
PLANE_RATE = ("m/s^2", "m/s^2", "rad/s^2")


@dataclass(frozen=True, kw_only=True)
class Export:
    """One expression with its description.

    Args:
        name: as after `occ export`.
        meaning: in words.
        equation: for people.
        source: equation of the paper, or book and chapter.
        arguments: names in any order; ``program_velocity`` and ``program_acceleration`` stand for a program motion.
        result: name of the value.
        units: of the value, one for each row or one for all.
        symbol: of the value, LaTeX.
        build: the expression, from the symbols of all arguments.
    """

    name: str
    meaning: str
    equation: str
    source: str
    arguments: tuple[str, ...]
    result: str
    units: tuple[str, ...]
    symbol: str
    build: Callable[[Symbols], ca.SX]


def _of_model(name: str, *arguments: str) -> Callable[[Symbols], ca.SX]:
    # The model's matrices take a state that they do not depend on.
    return lambda s: s.model(name, *(s[argument] for argument in arguments or ("state",)))


def _constraint_rate(s: Symbols) -> ca.SX:
    acceleration = s["acceleration"]
    return (acceleration - s.on_program.direction * acceleration[2] - s.on_program.rest)[:2]


def _servo_wrench(s: Symbols) -> ca.SX:
    motion = s.on_program
    yaw_acceleration = servo_yaw_acceleration(s.matrices, motion)
    return s.matrices.wrench(motion.velocity, motion.direction * yaw_acceleration + motion.rest)


_MODEL = (
    Export(
        name="kinematics",
        meaning="velocity of O on the floor and yaw rate",
        equation="(x_O', y_O', psi') = (V_X cos psi - V_Y sin psi, V_X sin psi + V_Y cos psi, Omega)",
        source="paper, eq. (2.1)",
        arguments=("state",),
        result="velocity",
        units=("m/s", "m/s", "rad/s"),
        symbol=r"\dot{q}",
        build=lambda s: s.model("forward", s["state"], ca.SX.zeros(s.wheel_count))[:3],
    ),
    Export(
        name="wheel_rates",
        meaning="rates of the wheels",
        equation="phi' = C_phi pi'",
        source="paper, eq. (2.4)",
        arguments=("state",),
        result="rates",
        units=("rad/s",),
        symbol=r"\dot{\varphi}",
        build=_of_model("wheel_rates", "state"),
    ),
    Export(
        name="roller_rates",
        meaning="rates of the rollers in contact",
        equation="gamma' = C_gamma pi'",
        source="paper, eq. (2.4); the sign of C_gamma is that of (2.4)",
        arguments=("state",),
        result="rates",
        units=("rad/s",),
        symbol=r"\dot{\gamma}",
        build=_of_model("roller_rates", "state"),
    ),
    Export(
        name="input_map",
        meaning="wrench of unit wheel torques",
        equation="Pi_C = C_phi^T M",
        source="paper, eq. (2.12)",
        arguments=(),
        result="map",
        units=("1/m", "1/m", "1"),
        symbol=r"C_\varphi^{\mathsf T}",
        build=_of_model("input_map"),
    ),
    Export(
        name="inertia_matrix",
        meaning="inertia matrix with the spin of the wheels",
        equation="A = d^2 S / d(pi'')^2",
        source="paper, eq. (2.16)",
        arguments=(),
        result="inertia",
        units=("kg, kg, kg m", "kg, kg, kg m", "kg m, kg m, kg m^2"),
        symbol="A",
        build=_of_model("inertia_matrix"),
    ),
    Export(
        name="gyroscopic",
        meaning="gyroscopic terms",
        equation="f = dS/d(pi'') at pi'' = 0",
        source="paper, eq. (2.16)",
        arguments=("state",),
        result="wrench",
        units=WRENCH,
        symbol="f",
        build=_of_model("gyroscopic", "state"),
    ),
    Export(
        name="friction",
        meaning="viscous friction of wheels and rollers",
        equation="Pi_F = -(zeta_X V_X, zeta_Y V_Y, mu_Omega Omega) for the platform of the paper",
        source="paper, eq. (2.11) with mu_2 in its second term",
        arguments=("state",),
        result="wrench",
        units=WRENCH,
        symbol=r"\Pi_{F}",
        build=_of_model("friction", "state"),
    ),
    Export(
        name="forward",
        meaning="forward dynamics: rate of the state from the wheel torques",
        equation="A pi'' + f - Pi_F = C_phi^T M, solved for pi''",
        source="paper, eqs. (2.1), (2.16)",
        arguments=("state", "torque"),
        result="state_rate",
        units=("m/s", "m/s", "rad/s", *PLANE_RATE),
        symbol=r"\dot{x}",
        build=_of_model("forward", "state", "torque"),
    ),
    Export(
        name="inverse",
        meaning="inverse dynamics: wrench of an acceleration",
        equation="Pi_C = A pi'' + f - Pi_F",
        source="paper, eqs. (2.13)-(2.15)",
        arguments=("state", "acceleration"),
        result="wrench",
        units=WRENCH,
        symbol=r"\Pi_{C}",
        build=_of_model("inverse", "state", "acceleration"),
    ),
    Export(
        name="wheel_power",
        meaning="power of each wheel",
        equation="P_i = M_i phi_i'",
        source="paper, eqs. (2.4), (2.12)",
        arguments=("state", "torque"),
        result="power",
        units=("W",),
        symbol="P",
        build=_of_model("wheel_power", "state", "torque"),
    ),
    Export(
        name="power",
        meaning="power of all wheels",
        equation="P = sum M_i phi_i'",
        source="paper, section 5",
        arguments=("state", "torque"),
        result="power",
        units=("W",),
        symbol="P",
        build=_of_model("power", "state", "torque"),
    ),
    Export(
        name="kinetic_energy",
        meaning="kinetic energy",
        equation="T = 1/2 pi'^T A pi'",
        source="paper, section 2.2",
        arguments=("state",),
        result="energy",
        units=("J",),
        symbol="T",
        build=_of_model("kinetic_energy", "state"),
    ),
)

_LAW = (
    *(
        Export(
            name=f"program_{name}",
            meaning=f"program {name} of B on the floor",
            equation=equation,
            source="paper, before eq. (4.1), for the circle",
            arguments=("t", "motion"),
            result=name,
            units=(unit,),
            symbol=symbol,
            build=lambda s, derivative=derivative: s.program(derivative),  # type: ignore[misc]  # a default of a lambda has no type
        )
        for derivative, (name, unit, equation, symbol) in enumerate(
            (
                ("position", "m", "r_B*(t)", "r_B^*"),
                ("velocity", "m/s", "d r_B*/dt", r"\dot{r}_B^*"),
                ("acceleration", "m/s^2", "d^2 r_B*/dt^2", r"\ddot{r}_B^*"),
            )
        )
    ),
    Export(
        name="constraint",
        meaning="residual of the servo-constraint, body axes",
        equation="B pi' - V_B*",
        source="paper, eqs. (3.2), (3.3)",
        arguments=("program_velocity", "state", "point"),
        result="residual",
        units=("m/s",),
        symbol="g",
        build=lambda s: (s["state"][3:] - s.on_program.velocity)[:2],
    ),
    Export(
        name="constraint_rate",
        meaning="time derivative of the servo-constraint's residual, body axes",
        equation="B pi'' - dV_B*/dt",
        source="paper, eqs. (3.3), (3.7)",
        arguments=(*PROGRAM, "state", "acceleration", "point"),
        result="residual_rate",
        units=("m/s^2",),
        symbol=r"\dot{g}",
        build=_constraint_rate,
    ),
    Export(
        name="servo_yaw_acceleration",
        meaning="the law's yaw equation, with V_X and V_Y by eq. (3.6)",
        equation="C^T A C Omega' + C^T (A dV*/dt + f - Pi_F) = 0, solved for Omega'",
        source="paper, eqs. (3.8), (3.9)",
        arguments=(*PROGRAM, "state", "point"),
        result="yaw_acceleration",
        units=("rad/s^2",),
        symbol=r"\dot{\Omega}",
        build=lambda s: servo_yaw_acceleration(s.matrices, s.on_program),
    ),
    Export(
        name="servo_wrench",
        meaning="the law's wrench, with V_X and V_Y by eq. (3.6)",
        equation="Pi_C = B^T lambda = A pi'' + f - Pi_F on the program motion",
        source="paper, eqs. (3.11)-(3.13)",
        arguments=(*PROGRAM, "state", "point"),
        result="wrench",
        units=WRENCH,
        symbol=r"\Pi_{C}",
        build=_servo_wrench,
    ),
    Export(
        name="servo_torque",
        meaning="the law's wheel torques of least norm, with V_X and V_Y by eq. (3.6)",
        equation="M = C_phi (C_phi^T C_phi)^-1 Pi_C",
        source="paper, after eq. (3.13)",
        arguments=(*PROGRAM, "state", "point"),
        result="torque",
        units=("N m",),
        symbol="M",
        build=lambda s: s.matrices.min_norm @ _servo_wrench(s),
    ),
)

_ALLOCATION = (
    Export(
        name="min_norm_torque",
        meaning="wheel torques of least norm for a wrench",
        equation="M = C_phi (C_phi^T C_phi)^-1 Pi",
        source="paper, after eq. (3.13)",
        arguments=("wrench",),
        result="torque",
        units=("N m",),
        symbol="M",
        build=_of_model("min_norm_torque", "wrench"),
    ),
    Export(
        name="box_torque",
        meaning="wheel torques of least norm within a limit; beyond it where least_peak_torque is beyond it",
        equation="min |M|^2, C_phi^T M = Pi, |M_i| <= limit: M = M_min + nu n, nu = 0 clipped to what the limit leaves",
        source="occ.allocation.closed_form: the null space of C_phi^T of four wheels has one dimension",
        arguments=("wrench", "limit"),
        result="torque",
        units=("N m",),
        symbol="M",
        build=lambda s: box_torque(s.matrices, s["wrench"], s["limit"]),
    ),
    Export(
        name="least_peak_torque",
        meaning="least possible largest wheel torque for a wrench: it is in reach of a limit that is not below",
        equation="min over C_phi^T M = Pi of max |M_i| = max over i < j of |M_i n_j - M_j n_i| / (|n_i| + |n_j|)",
        source="occ.allocation.input_map; duality of the largest and the sum norm",
        arguments=("wrench",),
        result="peak",
        units=("N m",),
        symbol=r"M_{\text{peak}}",
        build=lambda s: least_peak(s.matrices, s["wrench"]),
    ),
)


def _integrand(item: Objective) -> Export:
    return Export(
        name=f"integrand_{item.name}",
        meaning=f"integrand of the objective {item.name}",
        equation=item.equation,
        source="occ.objectives",
        arguments=("state", "torque"),
        result="integrand",
        units=(f"{item.unit} per second",),
        symbol=r"\ell",
        build=lambda s: item.integrand(s["torque"], s.model("wheel_rates", s["state"])),
    )


EXPORTS: dict[str, Export] = {
    export.name: export
    for export in (
        *_MODEL,
        *_LAW,
        *_ALLOCATION,
        *(_integrand(item) for item in OBJECTIVES.values() if not item.largest),
    )
}


def listing() -> str:
    """What can be exported, as text: name, arguments, meaning, equation and source."""
    from occ.experiment.documentation import aligned

    rows = [
        (item.name, f"({', '.join(_shown(item))})", f"{item.meaning}; {item.equation} [{item.source}]")
        for item in EXPORTS.values()
    ]
    return "\n".join(["exports (occ export NAME ...)", *aligned(rows, "  ")])


def _shown(item: Export) -> list[str]:
    """The arguments with a program motion."""
    names = set(item.arguments) | ({"t", "motion"} if set(item.arguments) & set(PROGRAM) else set())
    return [name for name in ORDER if name in names and name not in PROGRAM]
