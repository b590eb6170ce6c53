"""Experiment files: schema, cases, store, run."""
