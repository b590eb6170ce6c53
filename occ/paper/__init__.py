"""The paper as a program: the data behind its figures, and an audit of what it prints."""
