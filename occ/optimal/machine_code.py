"""Functions of CasADi as compiled C: the same operations on the same numbers, many times faster.

Each C routine works on `LANES` points at a time.  The C code is the key: what has been compiled once on a machine is
found again by every later process.  No result needs it: without a compiler, or with one that fails, CasADi evaluates
the functions itself, to the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from occ.compiler import NotInC, library

LANES = 2
"""What the registers of every 64-bit processor hold, without a word about its model."""
FORMS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_NEG: "-{0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
}
LIBRARY = {
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_SQRT: "sqrt",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_FABS: "fabs",
}
HEADER = [
    "#include <math.h>",
    f"typedef double lanes __attribute__((vector_size({8 * LANES})));",
    *(
        f"static lanes of_{name}(lanes x) {{ for (int k = 0; k < {LANES}; ++k) x[k] = {name}(x[k]); return x; }}"
        for name in LIBRARY.values()
    ),
]


class Source:
    """C code in the making: routines on lanes, and external functions for CasADi that call them."""

    def __init__(self) -> None:
        self._lines = list(HEADER)
        self._names: list[str] = []

    def routine(self, function: ca.Function, name: str, shared: Sequence[int] = ()) -> None:
        """`static void name(a0, a1, .., result)` from a function of SX with dense columns and one output.

        Args:
            function: what it does.
            name: in C.
            shared: places of the arguments that are numbers, the same for all lanes.

        Raises:
            NotInC: an operation that is not in the tables.
        """
        arguments = [f"const {'double' if i in shared else 'lanes'}* a{i}" for i in range(function.n_in())]
        self._lines.append(f"static void {name}({', '.join(arguments)}, lanes* result) {{")
        names: dict[int, str] = {}
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            into, of = function.instruction_output(k), function.instruction_input(k)
            if operation == ca.OP_OUTPUT:
                self._lines.append(f"  result[{into[1]}] = {names[of[0]]};")
                continue
            if operation == ca.OP_CONST:
                form = _all_lanes(float(function.instruction_constant(k)).hex())
            elif operation == ca.OP_INPUT:
                form = f"a{of[0]}[{of[1]}]"
                form = _all_lanes(form) if of[0] in shared else form
            elif operation in FORMS:
                form = FORMS[operation].format(*(names[place] for place in of))
            elif operation in LIBRARY:
                form = f"of_{LIBRARY[operation]}({names[of[0]]})"
            else:
                raise NotInC(f"operation {operation}")
            self._lines.append(f"  const lanes x{k} = {form};")
            names[into[0]] = f"x{k}"
        self._lines.append("}")

    def write(self, *lines: str | Sequence[str]) -> None:
        """Lines of C as they are; those in a sequence are set in."""
        for line in lines:
            self._lines += [line] if isinstance(line, str) else [f"  {each}" for each in line]

    def external(
        self, name: str, sizes: Sequence[int], shared: Sequence[int], result: int, body: Sequence[str]
    ) -> None:
        """A function that CasADi can load: arguments (k, `LANES`), those that are shared (k, 1).

        Args:
            name: in C.
            sizes: rows of each argument.
            shared: places of the shared ones.
            result: rows of the result.
            body: statements from a0, a1, .. to ``result``.
        """
        lines = [f"int {name}(const double** arg, double** res, long long* iw, double* w, int mem) {{"]
        for i, size in enumerate(sizes):
            if i in shared:
                lines.append(f"  const double* a{i} = arg[{i}];")
                continue
            parts = ", ".join(f"arg[{i}][{lane * size} + k]" for lane in range(LANES))
            lines.append(f"  lanes a{i}[{max(size, 1)}];")
            lines.append(f"  for (int k = 0; k < {size}; ++k) a{i}[k] = (lanes){{{parts}}};")
        lines += [f"  lanes result[{max(result, 1)}];", *(f"  {line}" for line in body)]
        lines += [
            f"  for (int k = 0; k < {result}; ++k) res[0][{lane * result} + k] = result[k][{lane}];"
            for lane in range(LANES)
        ]
        shapes = ", ".join(f"{{{size}, {1 if i in shared else LANES}, 1}}" for i, size in enumerate(sizes))
        self._lines += [
            *lines,
            "  return 0;",
            "}",
            f"long long {name}_n_in(void) {{ return {len(sizes)}; }}",
            f"long long {name}_n_out(void) {{ return 1; }}",
            # The third number says that a matrix is dense.
            f"static const long long {name}_inputs[{len(sizes)}][3] = {{{shapes}}};",
            f"static const long long {name}_output[3] = {{{result}, {LANES}, 1}};",
            f"const long long* {name}_sparsity_in(long long i) {{ return {name}_inputs[i]; }}",
            f"const long long* {name}_sparsity_out(long long i) {{ return {name}_output; }}",
        ]
        self._names.append(name)

    @property
    def text(self) -> str:
        """All that has been written."""
        return "\n".join([*self._lines, ""])

    def load(self) -> dict[str, ca.Function]:
        """The external functions, compiled now if it is the first time.

        Raises:
            NotInC: no working compiler.
        """
        path = library(self.text)
        try:
            return {name: ca.external(name, str(path)) for name in self._names}
        except RuntimeError as error:
            raise NotInC(str(error)) from error


def at_many(function: ca.Function, arguments: Sequence[ca.MX], shared: Sequence[int]) -> ca.MX:
    """An external function at N points.

    Args:
        function: for `LANES` points.
        arguments: (k, N) each; those that are shared (k,).
        shared: places of the shared ones.

    Returns:
        (m, N).
    """
    count = next(a.shape[1] for i, a in enumerate(arguments) if i not in shared)
    missing = -count % LANES
    if missing:
        # The last point once more.
        arguments = [
            a if i in shared else ca.horzcat(a, ca.repmat(a[:, -1], 1, missing)) for i, a in enumerate(arguments)
        ]
    mapped = function.map("points", "serial", (count + missing) // LANES, list(shared), [])
    values = mapped.call(list(arguments))[0]
    return values[:, :count] if missing else values


def _all_lanes(value: str) -> str:
    return "(lanes){" + ", ".join([value] * LANES) + "}"
