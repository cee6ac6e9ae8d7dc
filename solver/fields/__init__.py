"""The field that drives make: over planes and boxes, at its foci, as other quantities, in files."""
