"""Fields as pictures, and as files for ParaView."""
