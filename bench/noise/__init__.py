"""The noise coefficients measured against truth, the Cramér–Rao bound and common tools."""
