"""What the command line offers of the host, the options that its commands share, and where their frames come from."""
