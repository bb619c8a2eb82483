"""Mutation tests: small faults are put into the sources, and tests have to fail."""
