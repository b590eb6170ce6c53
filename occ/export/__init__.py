"""Expressions of the model, the law and the allocation with their derivatives, as files for other tools.

To add an export: one `Export` in `occ.export.catalogue`.  To add a language: one module in `occ.export.languages`.
"""
