"""What a device plays: sessions, frames, calibrations and recordings, streams by the device's clock, and asyncio.

This room stands on lines, whichever they are; it neither looks for devices nor changes their firmware.
"""
