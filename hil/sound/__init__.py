"""Sound from captured bits: what an array emits, and what arrives in air over time."""
