"""Tables and the written report, made from stored results alone."""
