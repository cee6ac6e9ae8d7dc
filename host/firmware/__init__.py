"""New firmware for a device: DFU as a host speaks it, one image to one device, image files, and keys to sign them.

This room stands on lines only; what a device plays is over before it comes in.
"""
