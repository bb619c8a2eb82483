"""Baselines: the reference ray caster, and VTK's."""
