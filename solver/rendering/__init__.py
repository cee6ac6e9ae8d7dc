"""From what should be felt to drives over time: four ways to move and modulate foci, and means to make them quiet."""
