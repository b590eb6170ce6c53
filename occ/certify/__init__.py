"""Lower bounds with their proof: what is printed as certified has been enclosed in ball arithmetic."""

from occ.certify.work import Certificate, Ends, certify_work, check

__all__ = ["Certificate", "Ends", "certify_work", "check"]
