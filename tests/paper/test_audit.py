"""The audit: verdicts follow from numbers, and other numbers give other verdicts."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import OptimizeResult
from typer.testing import CliRunner

from occ.cli import app
from occ.integration import IntegrationError
from occ.model.presets import YouBot
from occ.paper.audit import COLUMNS, audit_numbers
from occ.paper.degenerate_formulas import degenerate_checks
from occ.paper.formula import Check, Judgement
from occ.paper.model_formulas import model_checks
from occ.paper.printed import PARAMETERS, Printed
from occ.paper.symbols import Symbols

COMMITTED = Path(__file__).parents[2] / "reports" / "audit"
SEVEN = {
    "R~_B [m]": ("0.647403193343", {"0.65": "agrees", "0.6485": "explained by rounding"}),
    "V~_B [m/s]": ("26.5482182534", {"26.58": "explained by rounding"}),
    "psi~_s, stable, at R_B = 0.7 m [rad]": ("-0.478863232355", {"-0.48": "agrees"}),
    "psi~_s = -alpha at R_B = R~_B [rad]": ("-0.0887386943436", {"-0.10": "not explained"}),
    "b_X [cm]": ("0.0753166689804", {"0.09": "not explained"}),
    "b_Y [cm]": ("0.0927672480453", {"0.1": "agrees"}),
    "V~_B at the point (4.20) [km/s]": ("3.372", {"2.9": "not explained"}),
}
"""By quantity: the published computed value, and the verdict on each printed one that its interval implies."""
ERRATA = (
    "C_gamma = -",
    "mu_2 C_gamma",
    "S_p of the platform and S_i",
    "Pi_C are the control forces",
    "zeta_Y b_X V_BY",
    "lambda_2 = m_a",
    "the stable root is psi~_s = -alpha + sign(omega_B) arccos(R~_B/R_B)",
    "sign(omega_B) eps K",
    "rho cos(psi~ + alpha)",
    "0 < psi~(0) + alpha < 2 pi",
    "unwrapping",
    "2 arth(1/argument)",
    "R_c(omega_B)",
    "the most preferable",
)
"""What the right form of each misprint says."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("audit")
    result = CliRunner().invoke(app, ["audit", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "explained by rounding" in result.output
    return out


@pytest.fixture(scope="module")
def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "audit.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def verdicts(parameters: dict[str, Printed]) -> dict[tuple[str, str], str]:
    return {(row.quantity, row.printed): str(row.verdict) for row in audit_numbers(parameters)}


def test_the_columns_and_words_of_the_contract(rows: list[dict[str, str]]) -> None:
    assert tuple(rows[0]) == COLUMNS
    assert {row["verdict"] for row in rows} == {str(word) for word in Judgement}
    for row in rows:
        numbers = [row[name] for name in ("printed", "computed", "reachable_low", "reachable_high")]
        assert all(numbers) or not any(numbers), row
        assert row["equation"]
        assert row["quantity"]


@pytest.mark.parametrize("quantity", SEVEN)
def test_printed_numbers_get_the_verdicts_that_their_intervals_imply(
    rows: list[dict[str, str]], quantity: str, printed: Callable[[str], object]
) -> None:
    value, expected = SEVEN[quantity]
    found = [row for row in rows if row["quantity"] == quantity]
    assert {row["printed"]: row["verdict"] for row in found} == expected
    for row in found:
        computed, low, high = (float(row[name]) for name in ("computed", "reachable_low", "reachable_high"))
        assert computed == printed(value)
        assert low < computed < high
        digits = Printed(row["printed"])
        implied = "agrees" if digits.holds(computed) else "not explained"
        if implied != "agrees" and low <= digits.number + digits.half and digits.number - digits.half <= high:
            implied = "explained by rounding"
        assert row["verdict"] == implied


def test_the_speed_at_the_singular_point_is_explained_by_the_rounded_point_only(rows: list[dict[str, str]]) -> None:
    (row,) = (row for row in rows if "as printed, b =" in row["quantity"])
    # V~_B = xi_3 J_a R^2/(4 J_1 |b|): by hand from the numbers of (2.17).
    s = Symbols.of(YouBot())
    b = 0.0009, 0.001
    drag = s.mu_Omega + s.zeta_X * b[1] ** 2 + s.zeta_Y * b[0] ** 2
    assert float(row["computed"]) == pytest.approx(drag * s.R**2 / (4 * s.J_1 * math.hypot(*b)) / 1000, rel=1e-9)
    assert row["verdict"] == "explained by rounding"


def test_other_digits_of_one_parameter_change_verdicts() -> None:
    alpha, radius = ("psi~_s = -alpha at R_B = R~_B [rad]", "-0.10"), ("R~_B [m]", "0.6485")
    as_printed = verdicts(dict(PARAMETERS))
    assert as_printed[alpha] == "not explained"
    assert as_printed[radius] == "explained by rounding"
    # One digit less of the roller radius leaves room for the printed angle.
    assert verdicts({**PARAMETERS, "roller_radius": Printed("0.01")})[alpha] == "explained by rounding"
    # One digit more, and another one, moves the critical radius out of reach.
    assert verdicts({**PARAMETERS, "roller_radius": Printed("0.0135")})[radius] == "not explained"


@pytest.mark.parametrize("words", ERRATA)
def test_every_misprint_is_a_row_with_its_right_form(rows: list[dict[str, str]], words: str) -> None:
    found = [row for row in rows if words in row["quantity"] and "right" in row["quantity"]]
    assert [row["verdict"] for row in found] == ["misprint"]


def test_the_second_line_of_the_yaw_inertia_needs_what_is_not_printed(rows: list[dict[str, str]]) -> None:
    (row,) = (row for row in rows if "second line" in row["equation"])
    assert "(2.17) gives neither" in row["quantity"]


def test_the_verdict_on_the_most_preferable_law_rests_on_the_published_works(rows: list[dict[str, str]]) -> None:
    (row,) = (row for row in rows if "the most preferable" in row["quantity"])
    assert row["verdict"] == "misprint"
    lap = 2 * math.pi / 0.4
    # Published check values: the law's work, the steady powers of best rotation and law over a lap, the best heading.
    for number in ("1.1488", f"{201.389773055:.2f}", f"{12.3827824586 * lap:.2f}", f"{12.4027335158 * lap:.2f}"):
        assert number in row["quantity"]
    works = next(row["quantity"] for row in rows if "four motions of Fig. 10" in row["quantity"])
    assert "201.39" in works
    assert "385.43" in works


def test_a_wrong_coefficient_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Symbols, "mu_Omega", property(lambda s: 4 * s.mu_1 * (s.l + s.h) ** 2 / s.R**2))
    found = {check.equation: check.verdict for check in model_checks(YouBot())}
    assert found["after (2.11)"] == "not explained"
    assert found["(2.13)-(2.15)"] == "not explained"
    assert found["(3.9), (3.10)"] == "not explained"
    assert found["(2.12)"] == "agrees"


def test_a_right_form_that_fails_too_is_no_misprint() -> None:
    assert Check("", "", as_printed=0.1, right=1e-12).verdict == "misprint"
    assert Check("", "", as_printed=0.1, right=0.1).verdict == "not explained"
    assert Check("", "", as_printed=0.1).verdict == "not explained"
    assert Check("", "", as_printed=1e-12, right=1e-12).verdict == "agrees"


def test_the_code_produces_the_committed_audit(folder: Path, rows: list[dict[str, str]]) -> None:
    with (COMMITTED / "audit.csv").open(newline="") as file:
        committed = list(csv.DictReader(file))
    assert len(committed) == len(rows)
    for before, after in zip(committed, rows, strict=True):
        for name in COLUMNS:
            if name in ("computed", "reachable_low", "reachable_high") and before[name]:
                assert float(after[name]) == pytest.approx(float(before[name]), rel=1e-8)
            else:
                assert after[name] == before[name]
    assert (folder / "audit.md").read_text() == (COMMITTED / "audit.md").read_text()


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("")
    result = CliRunner().invoke(app, ["paper", "--figure", "3", "--out", str(taken)])
    assert result.exit_code == 2
    assert len(result.output.splitlines()) == 1
    assert "cannot be written" in result.output


def test_an_integration_that_stops_is_no_check(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object, **__: object) -> OptimizeResult:
        return OptimizeResult(success=False, t=np.zeros(0), y=np.zeros((1, 0)))

    monkeypatch.setattr("scipy.integrate.solve_ivp", stopped)
    with pytest.raises(IntegrationError, match="degenerate equation cannot be followed any further at t = 0 s"):
        degenerate_checks()
