"""The law and its allocation in C at 1 kHz against the forward dynamics, all of it exported from the model.

    python experiments/c_controller/run.py [FOLDER]

exports, compiles, runs and prints; FOLDER keeps the files.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from occ.export.export import export
from occ.export.languages.base import first_tool
from occ.export.languages.c import COMPILERS, FLAGS
from occ.export.request import Request

HERE = Path(__file__).resolve().parent
NAMES = ("servo_wrench", "box_torque", "forward", "constraint", "power", "program_position", "program_velocity")
WORK = 201.389773055
"""[J] of the law in continuous time over this lap, without a limit of the torques."""


def main(folder: Path) -> None:
    """Export, compile, run and print."""
    for line in export(Request(NAMES, (), ("c",)), folder).lines:
        print(line)
    compiler = first_tool(COMPILERS)
    if compiler is None:
        sys.exit("no C compiler on this machine")
    sources = [str(HERE / "main.c"), *(f"occ_{name}.c" for name in NAMES)]
    subprocess.run([compiler, *FLAGS, "-O2", "-I.", *sources, "-lm", "-o", "controller"], cwd=folder, check=True)
    output = subprocess.run(["./controller"], cwd=folder, check=True, capture_output=True, text=True).stdout
    found = {name: float(number) for name, number in (line.split() for line in output.splitlines())}
    print(
        f"law and allocation: {found['controller_ns']:.0f} ns a call, {found['ticks']:.0f} calls in one lap of 15.708 s"
    )
    print(f"largest velocity error of B: {found['velocity_error_m_s']:.2e} m/s")
    print(f"largest position error of B: {found['position_error_m']:.2e} m")
    print(f"largest wheel torque: {found['peak_torque_Nm']:.4f} N m, limit 1.2 N m")
    print(f"work: {found['work_J']:.6f} J, of the law in continuous time {WORK} J")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
