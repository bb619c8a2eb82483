"""Fields on a lattice, gathered along rays."""
