"""CasADi's own serialised functions, to be loaded by `casadi.Function.load` in Python, MATLAB or C++."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import casadi as ca

from occ.export.about import about
from occ.export.languages.base import Checked, Language
from occ.export.routine import Module, evaluate_function
from occ.export.table import error_of, table_of


class CasadiFunction(Language):
    """CasADi."""

    name: ClassVar[str] = "casadi"

    def files(self, module: Module) -> dict[str, str]:
        """NAME.casadi, one for each function, and NAME.casadi.txt that says what they are."""
        files = {f"{routine.name}.casadi": _saved(routine.function) for routine in module.routines}
        return files | {f"{module.name}.casadi.txt": "\n".join([*about(module, self.name), ""])}

    def check(self, folder: Path, modules: Sequence[Module]) -> Checked:
        """Load every function again and evaluate it."""
        errors: dict[str, float] = {}
        for module in modules:
            for routine in module.routines:
                loaded = ca.Function.load(str(folder / f"{routine.name}.casadi"))
                table = table_of(routine)
                errors[routine.name] = error_of(table, evaluate_function(loaded, table.inputs))
        return Checked(f"CasADi {ca.CasadiMeta.version()}", errors)


def _saved(function: ca.Function) -> str:
    """The content of the file that `casadi.Function.load` reads; what `serialize` returns is another form."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "saved"
        function.save(str(path))
        return path.read_text(encoding="ascii")
