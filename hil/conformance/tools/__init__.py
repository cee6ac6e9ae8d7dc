"""What cases share: common steps, a player, and invalid blocks, frames and images.

Invalid data are made here from the specification's words, not by the encoders of `protocol`.
"""

from __future__ import annotations
