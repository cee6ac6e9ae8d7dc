"""Where hands meet objects: sections 4.1 and 4.2 of the paper.

This room cuts meshes with the sixteen quadrilaterals of each hand, joins the cuts to arcs, and places control points on
them. It knows geometry alone: no file, no tracker, no array and no device.
"""

from __future__ import annotations
