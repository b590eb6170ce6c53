"""Figures, made from stored results alone."""
