"""Names that a function of one's own may have."""

from __future__ import annotations

import keyword
import re

from occ.errors import InputError

IDENTIFIER = re.compile(r"[A-Za-z](_?[A-Za-z0-9])*")
"""CasADi takes no name with two underscores side by side, and derivatives add theirs behind one."""

_C = """
    auto break case char const continue default do double else enum extern float for goto if inline
    int long register restrict return short signed sizeof static struct switch typedef union
    unsigned void volatile while main NULL
"""
_CPP = """
    alignas alignof and asm bitand bitor bool catch class constexpr decltype delete dynamic_cast
    explicit export false friend mutable namespace new noexcept not nullptr operator or private
    protected public static_assert template this thread_local throw true try typeid typename using
    virtual wchar_t xor
"""
_MATLAB = """
    end elseif error function global max min otherwise parfor persistent size spmd zeros
"""
_LIBRARY = """
    abort abs acos acosh asin asinh atan atan2 atanh calloc cbrt ceil copysign cos cosh div erf erfc
    exit exp exp2 expm1 fabs floor fma fmax fmin fmod free gamma hypot index j0 j1 jn labs lgamma
    log log10 log1p log2 malloc pow printf remainder rint round scanf sin sinh sqrt tan tanh tgamma
    time trunc y0 y1 yn
"""
WORDS = {
    "C": frozenset(_C.split()),
    "C++": frozenset(_CPP.split()),
    "Python": frozenset({*keyword.kwlist, "np", "check"}),
    "MATLAB": frozenset(_MATLAB.split()),
    "the C library": frozenset(_LIBRARY.split()),
    "CasADi": frozenset({"null", "jac", "hess"}),
}
"""Words that have a meaning of their own where a function is exported to."""


def check_identifier(name: str) -> None:
    """Refuse what cannot name a function in every language.

    Args:
        name: as after the equals sign of ``NAME=OWN``.

    Raises:
        InputError: says why.
    """
    if not IDENTIFIER.fullmatch(name):
        raise InputError(
            f'"{name}" cannot name a function; should be a letter and then letters, digits and single '
            "underscores between them"
        )
    for language, words in WORDS.items():
        if name in words:
            raise InputError(f'"{name}" is a word of {language}; the function should have another name')
