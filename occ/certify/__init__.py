"""Lower bounds with their proof: what is printed as certified has been enclosed in ball arithmetic."""

from occ.certify.ends import Ends
from occ.certify.work import Certificate, certify_work, check

__all__ = ["Certificate", "Ends", "certify_work", "check"]
