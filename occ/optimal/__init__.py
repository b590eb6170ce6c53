"""Direct collocation: transcription, meshes, nonlinear programs, and the player that uses them."""
