"""A small atlas that the tests of this folder change."""

from tests.experiment import tiny

SWEEP = '"motion.radius" = { from = 0.3, to = 1.0, count = 4 }\n"motion.rate" = [-0.4, 0.4, 1.2]\n'


def atlas_text(sweep: str, depth: str = "long_run") -> str:
    """The small experiment with a sweep, at a depth."""
    table = f"[sweep]\n{sweep}" if sweep else ""
    text = tiny(("duration = 0.5", "laps = 1"), more=f'[atlas]\ndepth = "{depth}"\n{table}')
    return text if depth != "comparison" else text.replace("laps = 1", "duration = 0.5")
