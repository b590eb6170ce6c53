"""Maps over parameters: where the law is near the optimum and where it is not."""
