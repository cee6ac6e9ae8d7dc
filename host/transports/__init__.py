"""How bytes reach a device and come back: lines by URL, over USB and serial ports, real or emulated, traced or not.

This room knows packets, frames and requests, and what goes wrong with them; what blocks are for is not its business.
"""
