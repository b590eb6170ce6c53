"""Languages of exported files.  To add one: a module here and its class in `LANGUAGES`."""

from occ.export.languages.base import Checked, Language
from occ.export.languages.c import C
from occ.export.languages.casadi_function import CasadiFunction
from occ.export.languages.json_text import Json
from occ.export.languages.latex import Latex
from occ.export.languages.matlab import Matlab
from occ.export.languages.numpy_code import NumPy

LANGUAGES: dict[str, type[Language]] = {
    language.name: language for language in (C, NumPy, Matlab, Latex, Json, CasadiFunction)
}

__all__ = ["LANGUAGES", "Checked", "Language"]
