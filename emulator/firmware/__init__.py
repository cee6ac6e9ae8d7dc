"""The flash, the boot loader that starts what lies in it, and DFU mode, which writes it."""
