"""Programs for the hardware: that of the chain processors, and kernels of the controller (chapters CHN, BUD)."""
