"""What cases share: steps that many take, a stage for what plays, and blocks, frames and images that are wrong.

What is wrong is made here from the specification's words, not by the encoders of the protocol's own room.
"""

from __future__ import annotations
