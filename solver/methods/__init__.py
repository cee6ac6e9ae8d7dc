"""From control points to drives: the methods, one by one and as a stream, and drives that take turns."""
