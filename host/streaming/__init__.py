"""Playing on a device: sessions, frames, calibrations and recordings, streams by the device's clock, and asyncio.

This room stands on any lines; it neither looks for devices nor changes their firmware.
"""
