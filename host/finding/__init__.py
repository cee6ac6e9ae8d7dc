"""Which devices there are, and what is wrong with a computer or a device: the search over all lines, and the doctor."""
