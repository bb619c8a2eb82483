"""The reference ray caster, and VTK's."""
