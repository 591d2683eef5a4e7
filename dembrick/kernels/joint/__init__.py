"""Laws of a joint: return mapping of friction, torsion-shear limit surface, no-tension pressure, utilisation."""
