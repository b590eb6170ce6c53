"""The energies of a platform on a circle in ball arithmetic, from the platform's numbers and from nothing else.

Each number is a ball that holds the true value: the platform's and the task's numbers are exact, every operation widens
the ball by its own rounding.  The derivation is independent of `occ.theory`: wheel and roller rates from the contact
condition (2.2) projected on the roller's axis and on the axle, the matrices A and Z of eq. (2.16) as sums over wheels.

Source: Johansson, Arb: efficient arbitrary-precision midpoint-radius interval arithmetic (python-flint).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from flint import acb, arb

from occ.task import Task
from occ.theory.dissipation import circle_of

Ball = Any
"""`flint.arb`, or `flint.acb` where a function is integrated."""
Matrix = list[list[Ball]]


class Refused(Exception):
    """The data do not prove a bound; the message says which step fails."""


@dataclass(frozen=True)
class Polynomial:
    """c_0 + c_1 cos x + s_1 sin x + c_2 cos 2x + s_2 sin 2x with balls for coefficients."""

    c_0: Ball
    c_1: Ball
    s_1: Ball
    c_2: Ball
    s_2: Ball

    def __call__(self, x: Ball) -> Ball:
        """Its value at a ball, real or complex."""
        c, s = x.cos(), x.sin()
        return self.c_0 - self.c_2 + c * (self.c_1 + 2 * (self.c_2 * c + self.s_2 * s)) + self.s_1 * s

    def derivative(self) -> Polynomial:
        """d/dx."""
        return Polynomial(arb(0), self.s_1, -self.c_1, 2 * self.s_2, -2 * self.c_2)

    def __add__(self, other: Polynomial) -> Polynomial:
        return Polynomial(*(a + b for a, b in zip(self.coefficients, other.coefficients, strict=True)))

    def scaled(self, factor: Ball) -> Polynomial:
        """factor p."""
        return Polynomial(*(factor * a for a in self.coefficients))

    @property
    def coefficients(self) -> tuple[Ball, ...]:
        """The five balls."""
        return self.c_0, self.c_1, self.s_1, self.c_2, self.s_2

    def largest_bend(self) -> Ball:
        """An upper bound of |p''|."""
        return abs(self.c_1) + abs(self.s_1) + 4 * (abs(self.c_2) + abs(self.s_2))

    def on(self, box: Ball) -> Ball:
        """Its values on a real box, by the mean value form of order two."""
        middle, radius = arb(box.mid()), arb(box.rad())
        swing = abs(self.derivative()(middle)) * radius + self.largest_bend() * radius * radius / 2
        return self(middle) + _symmetric(swing)

    def remainder_on(self, x: Ball, e: Ball) -> Ball:
        """2 (p(x + e) - p(x) - p'(x) e) / e^2 for x and e in boxes; e may hold 0."""
        total = arb(0)
        for k, c, s in ((1, self.c_1, self.s_1), (2, self.c_2, self.s_2)):
            cosine, sine = (k * x).cos(), (k * x).sin()
            even, odd = c * cosine + s * sine, s * cosine - c * sine
            z = k * e
            total -= k * k * (even * square((z / 2).sinc()) + 2 * odd * z * _sine_rest(z))
        return total


def square(z: Ball) -> Ball:
    """z^2; the power of the library is undefined on a ball around 0."""
    return z * z


def _sine_rest(z: Ball) -> Ball:
    """(z - sin z) / z^3, between 1/6 - z^2/120 and 1/6."""
    if abs(z) > arb(0.5):
        return (1 - z.sinc()) / square(z)
    return arb(1) / 6 - arb(0).union(arb((z * z).abs_upper())) / 120


def _symmetric(size: Ball) -> Ball:
    upper = arb(size.abs_upper())
    return (-upper).union(upper)


@dataclass(frozen=True)
class EnclosedTask:
    """Everything that the work on a circle from a given start depends on, as balls.

    Args:
        friction: [N m s] Z.
        rate: [rad/s] omega_B.
        power: [W] U.
        swing: [J] 2 G, whose slope is 2 d_2.
        rest: [J] T_min, the least kinetic energy at an angle.
        inertia: [kg m^2] J_a.
        coupling: [N m s] k_1.
        translation: [J] k_0, the kinetic energy at Omega = 0.
        start: [rad] psi~(0).
        start_rate: [rad/s] Omega(0).
        duration: [s].
    """

    friction: Ball
    rate: Ball
    power: Polynomial
    swing: Polynomial
    rest: Polynomial
    inertia: Ball
    coupling: Polynomial
    translation: Polynomial
    start: Ball
    start_rate: Ball
    duration: Ball

    def kinetic_energy(self, x: Ball, yaw_rate: Ball) -> Ball:
        """T(psi~, Omega) [J]."""
        return self.inertia * square(yaw_rate) / 2 + self.coupling(x) * yaw_rate + self.translation(x)

    @property
    def start_energy(self) -> Ball:
        """[J] Kinetic energy at the start."""
        return self.kinetic_energy(self.start, self.start_rate)

    def end_cost(self, x: Ball) -> Ball:
        """phi(x) = 2 Z omega_B (x - psi~(0)) + 2 G(x) - 2 G(psi~(0)) + T_min(x) [J]."""
        return 2 * self.friction * self.rate * (x - self.start) + self.of_end(x) - self.swing(self.start)

    @property
    def of_end(self) -> Polynomial:
        """2 G + T_min [J]."""
        return self.swing + self.rest


def enclose(task: Task) -> EnclosedTask:
    """The task's energies in balls.

    Args:
        task: on a circle.

    Returns:
        Balls that hold the true values.

    Raises:
        InputError: the motion is not a circle.
    """
    circle = circle_of(task)
    inertia, friction, *_ = matrices(task)
    direction = [arb(task.point[1]), -arb(task.point[0]), arb(1)]
    rate = arb(circle.rate)
    speed = arb(circle.radius) * rate
    drag, z = _times(friction, direction), _form(friction, direction)
    coupling, j = _times(inertia, direction), _form(inertia, direction)
    zero = arb(0)
    d_2 = Polynomial(zero, speed * drag[1], speed * drag[0], zero, zero)
    power = (
        _translation(friction).scaled(square(speed)) + d_2.scaled(2 * rate) + Polynomial(z * square(rate), *[zero] * 4)
    )
    # G' = d_2.
    swing = Polynomial(zero, -2 * d_2.s_1, 2 * d_2.c_1, zero, zero)
    cosine, sine = speed * coupling[1], speed * coupling[0]
    first, second = square(cosine), square(sine)
    turned = Polynomial((first + second) / 2, zero, zero, (first - second) / 2, cosine * sine)
    kinetic = _translation(inertia).scaled(square(speed) / 2)
    return EnclosedTask(
        friction=z,
        rate=rate,
        power=power,
        swing=swing,
        rest=kinetic + turned.scaled(-1 / (2 * j)),
        inertia=j,
        coupling=Polynomial(zero, cosine, sine, zero, zero),
        translation=kinetic,
        start=arb(task.start.heading) - arb(circle.phase),
        start_rate=arb(task.start.heading_rate),
        duration=arb(task.duration),
    )


class Matrices(NamedTuple):
    """What eq. (2.16) is made of; pi' = (V_X, V_Y, Omega) of the centre O."""

    inertia: Matrix  # (3, 3) A
    friction: Matrix  # (3, 3) Z
    wheels: Matrix  # (3, 3) C_phi^T C_phi
    mass: Ball  # [kg] of platform and wheels
    moment: tuple[Ball, Ball]  # [kg m] mass times the place of its centre


def matrices(task: Task) -> Matrices:
    """The matrices of a task's platform in balls.

    Args:
        task: any.

    Returns:
        Balls that hold the true values.
    """
    platform = task.platform
    mass, s_x, s_y = (arb(platform.mass), *(arb(platform.mass) * arb(a) for a in platform.mass_center))
    friction = [[arb(0)] * 3 for _ in range(3)]
    spin = [[arb(0)] * 3 for _ in range(3)]
    wheels = [[arb(0)] * 3 for _ in range(3)]
    for wheel in platform.wheels:
        x, y = (arb(value) for value in wheel.position)
        rolling, angle = arb(wheel.mounting_angle), arb(wheel.roller_angle)
        axis = rolling + angle
        mass += arb(wheel.mass)
        s_x, s_y = s_x + arb(wheel.mass) * x, s_y + arb(wheel.mass) * y
        # v_P along the roller's axis is what the wheel turns with, along the axle what the roller turns with.
        wheel_row = _row(axis.cos(), axis.sin(), x, y, arb(wheel.radius) * angle.cos())
        roller_row = _row(-rolling.sin(), rolling.cos(), x, y, -arb(wheel.roller_radius) * angle.cos())
        _add(friction, arb(wheel.friction), wheel_row)
        _add(friction, arb(wheel.roller_friction), roller_row)
        _add(spin, arb(wheel.spin_inertia), wheel_row)
        _add(wheels, arb(1), wheel_row)
    rigid = [[mass, arb(0), -s_y], [arb(0), mass, s_x], [-s_y, s_x, arb(platform.yaw_inertia)]]
    inertia = [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(rigid, spin, strict=True)]
    return Matrices(inertia, friction, wheels, mass, (s_x, s_y))


def _row(e_x: Ball, e_y: Ball, x: Ball, y: Ball, lever: Ball) -> list[Ball]:
    """(e . v) / lever for the velocity v = (V_X - Omega y, V_Y + Omega x) of a point."""
    return [e_x / lever, e_y / lever, (x * e_y - y * e_x) / lever]


def _add(matrix: Matrix, factor: Ball, row: list[Ball]) -> None:
    for i in range(3):
        for k in range(3):
            matrix[i][k] = matrix[i][k] + factor * row[i] * row[k]


def _times(matrix: Matrix, vector: list[Ball]) -> list[Ball]:
    return [sum((a * b for a, b in zip(row, vector, strict=True)), arb(0)) for row in matrix]


def _form(matrix: Matrix, vector: list[Ball]) -> Ball:
    return sum((a * b for a, b in zip(_times(matrix, vector), vector, strict=True)), arb(0))


def _translation(m: Matrix) -> Polynomial:
    """m_XX sin^2 + 2 m_XY sin cos + m_YY cos^2."""
    zero = arb(0)
    return Polynomial((m[0][0] + m[1][1]) / 2, zero, zero, (m[1][1] - m[0][0]) / 2, m[0][1])


def integral(function: Any, a: Ball, b: Ball, digits: int = 18) -> Ball:
    """A ball that holds the integral of an analytic function over a real interval.

    Args:
        function: (z, analytic) -> value, for complex balls z.
        a: lower end.
        b: upper end.
        digits: asked for; what is reached is in the ball.

    Returns:
        A real ball.
    """
    tolerance = arb(10) ** -digits
    return acb.integral(function, acb(a), acb(b), rel_tol=tolerance, abs_tol=tolerance).real


def positive_definite(rows: list[list[Ball]]) -> bool:
    """Cholesky's method in balls: whether every matrix inside is positive definite, as far as it is to be seen.

    Args:
        rows: lower triangle, row by row.

    Returns:
        True only if it is certain.
    """
    lower: list[list[Ball]] = []
    for a, row in enumerate(rows):
        new: list[Ball] = []
        for b in range(a):
            rest = row[b]
            for x, y in zip(new, lower[b], strict=False):
                rest -= x * y
            new.append(rest / lower[b][b])
        pivot = row[a]
        for x in new:
            pivot -= x * x
        if not pivot > 0:
            return False
        new.append(pivot.sqrt())
        lower.append(new)
    return True
