"""All that runs on chips: a portable core in C with its ports, the programs of the XMOS boards, and their tools."""
