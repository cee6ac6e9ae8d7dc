"""End-to-end checks: what was asked for, compared with what a device plays and what arrives."""
