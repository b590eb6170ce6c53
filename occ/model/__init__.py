"""The platform: data, symbolic dynamics by Appell's equations, servo-constraint."""
