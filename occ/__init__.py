"""occ: how close is a control law for an omnidirectional platform to energy-optimal?"""
