"""What the ports play and how it is seen: clocks, segments, bits, drives, exports.

It knows neither messages nor who decides what plays.
"""
