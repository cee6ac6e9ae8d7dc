"""Recorded traffic between a host and a device, and what its bytes mean."""
