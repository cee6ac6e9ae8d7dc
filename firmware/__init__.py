"""Programs that run on the hardware: the chain processors', and kernels of the controller (SPEC.md, chapters CHN, BUD)."""
