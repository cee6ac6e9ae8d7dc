"""What can be felt as control points: the points, the curves of shapes, shapes by name, and files of points."""
