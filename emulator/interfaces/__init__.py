"""What lines see of the device: its USB side, its serial lines and their console. They know no transport."""
